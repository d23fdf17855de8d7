/* Types shared by the modules of the controller core. Lengths are in mm and mm/s (the units of G-code) and say so in
 * their names; positions are whole steps; times are microseconds of the controller clock. */
#ifndef WAAM_TYPES_H
#define WAAM_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define WAAM_AXES 3
#define WAAM_LINE_MAX 160      /* bytes of one line, end of line excluded */
#define WAAM_RING_BYTES 2048   /* receive buffer for checked lines that wait for a free block */
#define WAAM_BLOCKS 64         /* planner queue */
#define WAAM_FIRMWARE_VERSION "0.1.0"

typedef enum { WAAM_IDLE = 0, WAAM_RUN = 1, WAAM_HOLD = 2, WAAM_ALARM = 3 } waam_state_t;

typedef enum {
    WAAM_OK = 0,
    WAAM_E_CHECK = 100,
    WAAM_E_GAP = 101,
    WAAM_E_SYNTAX = 102,
    WAAM_E_UNKNOWN_WORD = 103,
    WAAM_E_NUMBER = 104,
    WAAM_E_CONTRADICTION = 105,
    WAAM_E_TOO_LONG = 106,
    WAAM_E_MISSING_WORD = 107,
    WAAM_E_NOT_NOW = 108,
    WAAM_E_HOLD = 200,
    WAAM_E_LINK = 201,
    WAAM_E_LEASE = 202,
    WAAM_E_UNDERRUN = 203,
    WAAM_E_ARC_LOST = 204,
    WAAM_E_NO_ARC = 205,
    WAAM_E_WIRE = 206,
    WAAM_E_GAS = 207,
    WAAM_E_ESTOP = 300,
    WAAM_E_LIMIT_SWITCH = 301,
    WAAM_E_SOFT_LIMIT = 302,
    WAAM_E_INPUTS = 303,
    WAAM_E_NOT_HOMED = 304,
    WAAM_E_NOT_ARMED = 305
} waam_code_t;

typedef struct {
    uint32_t purge_us;          /* gas before the first strike */
    uint32_t strike_us;         /* wait for current, per try */
    uint32_t retry_pause_us;
    uint32_t tries;
    double established_a;       /* arc current above this means that the arc burns */
    uint32_t established_us;    /* ... for this long */
    uint32_t lost_us;           /* ... and below it for this long means that it is lost */
    double strike_wire_factor;  /* of W while striking */
    double crater_wire_factor;  /* of W while filling the end crater */
    uint32_t crater_us;
    uint32_t burn_back_us;      /* wire stops, source still on, so that the wire does not freeze in the bead */
    uint32_t post_flow_us;
    uint32_t gas_missing_us;
    double wire_fault_ratio;    /* encoder below this share of the command ... */
    uint32_t wire_fault_us;     /* ... for this long is a wire fault */
} waam_arc_config_t;

typedef struct {
    uint32_t boot_id;
    bool clock_is_ros_time;     /* announced as clk=sync */
    uint64_t start_us;          /* controller clock at start */
    int32_t steps_per_mm;
    double limit_min_mm[WAAM_AXES], limit_max_mm[WAAM_AXES];
    double max_speed_mm_s[WAAM_AXES], accel_mm_s2[WAAM_AXES];
    double rapid_mm_s;          /* G0 */
    double junction_deviation_mm;
    int8_t home_direction[WAAM_AXES]; /* -1: switch at the lower limit, +1: at the upper */
    double home_seek_mm_s, home_latch_mm_s, home_backoff_mm;
    double wire_max_mm_s, wire_accel_mm_s2;
    double voltage_max_v;
    waam_arc_config_t arc;
    uint32_t link_timeout_us;   /* no valid line for this long while in RUN: HOLD 201 */
    uint32_t lease_us;          /* the arc is off this long after the lease stamp */
    uint32_t lease_margin_us;   /* the arc end is started this much earlier than its own length asks for */
    uint32_t underrun_grace_us;
    uint32_t telemetry_us;
} waam_config_t;

typedef enum { WAAM_PROCESS_ABSENT = 0, WAAM_PROCESS_OK, WAAM_PROCESS_LOST } waam_process_t;

typedef struct {
    bool estop, limit_switch, gas_ok;
    bool home_switch[WAAM_AXES];
    waam_process_t process;     /* are the five values below connected */
    double current_a, voltage_v, wire_mm_s;
} waam_inputs_t;

typedef struct {
    int32_t pulses[WAAM_AXES];  /* pulses since the start, at the end of this tick; the shell spreads the new ones over it */
    bool arc, gas;
    double wire_mm_s, voltage_v;
} waam_outputs_t;

typedef enum { WAAM_TX_ASSURED, WAAM_TX_TELEMETRY } waam_tx_kind_t;
typedef void (*waam_tx_t)(void *context, const char *line, size_t bytes, waam_tx_kind_t kind);

#endif
