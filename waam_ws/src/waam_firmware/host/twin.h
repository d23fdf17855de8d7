/* The controller as a shared library: the same core, bytes in and bytes out, time as fast as the caller asks. For campaigns
 * that need millions of lines, or a fault at an exact moment. */
#ifndef WAAM_TWIN_H
#define WAAM_TWIN_H

#include "rig.h"

#define TWIN_TX_BYTES (256u * 1024u)
#define TWIN_DONE 4096u

/* A block that was executed to its end. */
typedef struct {
    uint32_t line;
    int32_t kind;               /* waam_block_kind_t */
    int32_t end[WAAM_AXES];     /* steps */
    float wire_mm_s, voltage_v;
} twin_done_t;

/* What a look from outside shows. */
typedef struct {
    uint64_t now_us;
    uint64_t arc_off_us;        /* when the arc output last went off */
    uint64_t arc_off_lease_us;  /* the lease then in force */
    int32_t state, fault;
    int32_t arc, homed, queued;
} twin_view_t;

typedef struct twin twin_t;

twin_t *twin_new(uint32_t boot_id, uint64_t start_us);
void twin_free(twin_t *twin);
void twin_rx(twin_t *twin, const char *bytes, size_t count);
void twin_hang_up(twin_t *twin);
void twin_run(twin_t *twin, uint32_t milliseconds);
/* What was sent since the last call (`size` at least TWIN_TX_BYTES); beyond that telemetry is dropped. */
size_t twin_take(twin_t *twin, char *bytes, size_t size);
/* Blocks executed since the last call, at most `size`. */
size_t twin_executed(twin_t *twin, twin_done_t *done, size_t size);
void twin_look(const twin_t *twin, twin_view_t *view);

#endif
