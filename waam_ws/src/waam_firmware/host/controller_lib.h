/* The controller as a shared library: the same core, bytes in and bytes out, time as fast as the caller asks. For campaigns
 * that need millions of lines, or a fault at an exact moment. */
#ifndef WAAM_CONTROLLER_LIB_H
#define WAAM_CONTROLLER_LIB_H

#include "host_harness.h"

#define CONTROLLER_LIB_TX_BYTES (256u * 1024u)
#define CONTROLLER_LIB_DONE 4096u

/* A block that was executed to its end. */
typedef struct {
    uint32_t line;
    int32_t kind;               /* waam_block_kind_t */
    int32_t end[WAAM_AXES];     /* steps */
    float wire_mm_s, voltage_v;
} controller_lib_done_t;

/* What a look from outside shows. */
typedef struct {
    uint64_t now_us;
    uint64_t arc_off_us;        /* when the arc output last went off */
    uint64_t arc_off_lease_us;  /* the lease then in force */
    int32_t state, fault;
    int32_t arc, homed, queued;
} controller_lib_view_t;

typedef struct controller_lib controller_lib_t;

/* IDLE, away from all limits, its own simple arc source behind it. NULL without memory. */
controller_lib_t *controller_lib_new(uint32_t boot_id, uint64_t start_us);
/* As `virtual_controller --plant --epoch-us` starts: in ALARM, its clock is ROS time, the caller is the cell. */
controller_lib_t *controller_lib_with_cell(uint32_t boot_id, uint64_t start_us);
/* Runs `milliseconds` and writes one sample for each. */
void controller_lib_step(controller_lib_t *lib, uint32_t milliseconds, host_sample_t *samples);
/* What the cell's inputs read from now on: bits as of the plant port, A, V, m/s. */
void controller_lib_answer(controller_lib_t *lib, uint32_t inputs, double current, double voltage, double wire_speed);
/* ... and its distance sensor: number and value of the newest reading (mm, or counts; NaN = no echo). After the answer. */
void controller_lib_distance(controller_lib_t *lib, uint32_t reading, double value);
/* The controller has a converter for the temperature of the part, which reads this, V; NaN = no reading. */
void controller_lib_part(controller_lib_t *lib, double volts);
/* Where the axes stand before anything has moved, mm, machine. The core does not know it until it is homed. */
void controller_lib_place(controller_lib_t *lib, double x, double y, double z);
/* How many steps a mm of the machine really takes, X Y Z, whatever the core takes it for; before anything has moved. */
void controller_lib_machine_steps(controller_lib_t *lib, const double *steps_per_mm);
/* Widens the reach of the axes to what lies between low and high, mm, machine; before anything has moved. */
void controller_lib_widen(controller_lib_t *lib, const double *low_mm, const double *high_mm);
/* `to` becomes what `from` is now, without the bytes that wait: running `to` shows what would come if nothing intervened. */
void controller_lib_copy(controller_lib_t *to, const controller_lib_t *from);
void controller_lib_free(controller_lib_t *lib);
void controller_lib_rx(controller_lib_t *lib, const char *bytes, size_t count);
void controller_lib_hang_up(controller_lib_t *lib);
void controller_lib_run(controller_lib_t *lib, uint32_t milliseconds);
/* What was sent since the last call (`size` at least CONTROLLER_LIB_TX_BYTES); beyond that telemetry is dropped. */
size_t controller_lib_take(controller_lib_t *lib, char *bytes, size_t size);
/* Blocks executed since the last call, at most `size`. */
size_t controller_lib_executed(controller_lib_t *lib, controller_lib_done_t *done, size_t size);
void controller_lib_look(const controller_lib_t *lib, controller_lib_view_t *view);

#endif
