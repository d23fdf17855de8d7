/* What stands around the core in every host program: home switches where the axes are, and a plant that does nothing
 * wrong. Shared by the virtual controller and the lib. */
#ifndef WAAM_HOST_HARNESS_H
#define WAAM_HOST_HARNESS_H

#include "adxl345_device.h"
#include "waam_core.h"

#define TICK_US 1000u
#define HOST_SHAKEN 32u /* samples that an accelerometer of 3200/s takes in the 10 ms of a step */

/* What the accelerometer feels in a step, as the cell says it. */
typedef struct {
    bool fitted;                /* there is one */
    uint32_t count;             /* samples, 0 = it is at rest */
    float value[HOST_SHAKEN][3]; /* m/s^2 along x, y, z of the machine, with gravity */
} host_shaken_t;

typedef struct {
    waam_config_t config;       /* of the core at its start; steps_per_mm: what the machine really has, whatever the core takes */
    waam_core_t core;
    waam_inputs_t inputs;
    waam_outputs_t outputs;
    double start_mm[WAAM_AXES]; /* where the axes stand at first, machine; the core does not know it */
    bool null_plant;
    bool contact;               /* the wire touches the work: what the source's sense supply sees */
    uint64_t null_arc_us;       /* null plant: the arc output has been on for this long */
    adxl345_device_t accelerometer; /* config.accelerometer */
    host_shaken_t shaken;       /* what it feels now; without samples it is at rest, with a noise of its own */
    uint32_t shaken_from;       /* samples that it had taken when these came */
    uint8_t bus[WAAM_ADXL345_BYTES];
    size_t bus_bytes;
    uint32_t noise;
} host_harness_t;

/* One millisecond of the outputs, as the plant port sends it (waam_firmware/doc/plant_port.md). */
typedef struct {
    double table_x, table_y, tool_z; /* m, machine; the table moves under the torch */
    double wire_cmd;                 /* m/s */
    double voltage_set;              /* V */
    uint32_t outputs;                /* 1 arc, 2 gas, 4 the accelerometer is on */
    uint32_t padding;
} host_sample_t;

/* Tunes the arc regulator to what is there: a source that follows at once and is seen after `exchange_us`. */
void host_harness_source(host_harness_t *harness, uint32_t exchange_us);
/* The controller has an accelerometer, before waam_core_init. */
void host_harness_accelerometer(host_harness_t *harness);
/* What the accelerometer feels from now on. */
void host_harness_shake(host_harness_t *harness, const host_shaken_t *shaken);
/* Steps from machine zero at which the axes really are. */
void host_harness_steps(const host_harness_t *harness, int64_t at[WAAM_AXES]);
/* One tick of the core with its inputs. */
void host_harness_tick(host_harness_t *harness);
/* What the outputs do now. */
host_sample_t host_harness_sample(const host_harness_t *harness);

#endif
