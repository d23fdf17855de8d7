/* What stands around the core in every host program: home switches where the axes are, and a plant that does nothing
 * wrong. Shared by the virtual controller and the twin. */
#ifndef WAAM_RIG_H
#define WAAM_RIG_H

#include "waam_core.h"

#define TICK_US 1000u

typedef struct {
    waam_config_t config;
    waam_core_t core;
    waam_inputs_t inputs;
    waam_outputs_t outputs;
    double start_mm[WAAM_AXES]; /* where the axes stand at first, machine; the core does not know it */
    bool null_plant;
    bool contact;               /* the wire touches the work: what the source's sense supply sees */
    uint64_t null_arc_us;       /* null plant: the arc output has been on for this long */
} rig_t;

/* Tunes the arc regulator to what is there: a source that follows at once and is seen after `exchange_us`. */
void rig_source(rig_t *rig, uint32_t exchange_us);
/* Steps from machine zero at which the axes really are. */
void rig_steps(const rig_t *rig, int64_t at[WAAM_AXES]);
/* One tick of the core with its inputs. */
void rig_tick(rig_t *rig);

#endif
