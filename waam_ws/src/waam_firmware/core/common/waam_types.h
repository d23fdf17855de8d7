/* Types shared by the modules of the controller core. Lengths are in mm and mm/s (the units of G-code) and say so in
 * their names; positions are whole steps; times are microseconds of the controller clock. */
#ifndef WAAM_TYPES_H
#define WAAM_TYPES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "waam_arc_settings.h"
#include "waam_shaper_settings.h"
#include "waam_standoff_settings.h"
#include "waam_temperature_settings.h"

#define WAAM_AXES 3
#define WAAM_PARTS 128          /* of a step, in which places are told between two steps */
#define WAAM_LINE_MAX 160      /* bytes of one line, end of line excluded */
#define WAAM_RING_BYTES 2048   /* receive buffer for checked lines that wait for a free block */
#define WAAM_BLOCKS 64         /* planner queue */
#define WAAM_RECENT 8          /* immediate lines that are remembered */
#define WAAM_BYTE_HOLD 0x80    /* real-time bytes, two in a row */
#define WAAM_BYTE_RESUME 0x81
#define WAAM_BYTE_STOP 0x82
#define WAAM_FIRMWARE_VERSION "0.3.0"

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
    WAAM_E_STUBBING = 208,
    WAAM_E_BURN_BACK = 209,
    WAAM_E_OVER_TEMPERATURE = 210,
    WAAM_E_WIRE_STUCK = 211,
    WAAM_E_STANDOFF = 212,      /* told, the state stays: the programmed z from here on */
    WAAM_E_ACCELEROMETER = 213, /* told, the state stays: no samples come */
    WAAM_E_ESTOP = 300,
    WAAM_E_LIMIT_SWITCH = 301,
    WAAM_E_SOFT_LIMIT = 302,
    WAAM_E_INPUTS = 303,
    WAAM_E_NOT_HOMED = 304,
    WAAM_E_NOT_ARMED = 305,
    WAAM_E_POWER_UP = 306,
    WAAM_E_WATCHDOG = 307,
    WAAM_E_DRIVE = 308,
    WAAM_E_LATE = 309           /* no tick for 20 ms, or ticks that are so far behind */
} waam_code_t;

/* What can go wrong with the arc; what is done about it is configured (waam_guard.c). */
typedef enum {
    WAAM_FAULT_NO_ARC,
    WAAM_FAULT_ARC_LOST,
    WAAM_FAULT_STUBBING,
    WAAM_FAULT_BURN_BACK,
    WAAM_FAULT_WIRE,
    WAAM_FAULT_GAS,
    WAAM_FAULT_OVER_TEMPERATURE,
    WAAM_FAULT_SENSOR,
    WAAM_FAULT_WIRE_STUCK,
    WAAM_FAULTS,
    WAAM_FAULT_NONE = WAAM_FAULTS
} waam_fault_t;

typedef enum {
    WAAM_REACT_HOLD,            /* slow down, stay where it is, keep the queue: a person decides */
    WAAM_REACT_RETRY,           /* slow down, strike again, go on; HOLD when the tries are used up */
    WAAM_REACT_ALARM            /* outputs off, homing lost */
} waam_reaction_t;

typedef struct {
    waam_reaction_t reaction;
    uint32_t tries;             /* of RETRY, between M3 and M5 */
} waam_policy_t;

typedef struct {
    uint32_t boot_id;
    bool clock_is_ros_time;     /* announced as clk=sync */
    uint64_t start_us;          /* controller clock at start */
    double steps_per_mm[WAAM_AXES]; /* 10 .. 2000 (a position is within 1e6 mm and 32 bits); $C, M92, $100 change it */
    double limit_min_mm[WAAM_AXES], limit_max_mm[WAAM_AXES]; /* $C changes the upper ones */
    double max_speed_mm_s[WAAM_AXES]; /* $C changes it */
    double accel_mm_s2[WAAM_AXES]; /* in force; $C sets them, $120 those of X and Y */
    double accel_most_mm_s2[WAAM_AXES]; /* of the machine: the settings of X and Y stay below */
    double rapid_mm_s;          /* G0; $C changes it */
    double junction_deviation_mm;
    int8_t home_direction[WAAM_AXES]; /* -1: switch at the lower limit, +1: at the upper; $C changes X and Y */
    double home_seek_mm_s, home_latch_mm_s, home_backoff_mm;
    double limit_release_mm;    /* a limit switch must be released after so much way out of it */
    double wire_max_mm_s, wire_accel_mm_s2;
    double wire_delay_s, wire_lag_s;    /* of the feeder: transport delay, time constant of the motor */
    double wire_response_s;             /* time constant that the lead makes of the lag; not below = no lead */
    double voltage_max_v;
    waam_arc_config_t arc;
    waam_regulator_config_t regulator;
    waam_monitor_config_t monitor;
    waam_standoff_config_t standoff; /* $C changes it */
    waam_shaper_config_t shaper;     /* and this */
    waam_policy_t policy[WAAM_FAULTS];
    double temperature_max_c;   /* of torch or drives */
    bool starts_in_alarm;       /* after power-up (306): nothing but a reset leads to IDLE */
    bool watchdog_reset;        /* the shell found that the watchdog had reset the processor (307) */
    const char *reset_reason;   /* what had happened then, told to every host; NULL: not known. Kept by the shell */
    bool drives_off_in_estop;   /* no torque from an emergency stop or a drive's fault to the reset after it */
    bool drives_off_in_alarm;   /* the same for every other ALARM; see doc/stm32f407.md */
    uint32_t link_timeout_us;   /* no valid line for this long while in RUN: HOLD 201 */
    uint32_t lease_us;          /* the arc is off this long after the lease stamp */
    uint32_t lease_margin_us;   /* the arc end is started this much earlier than its own length asks for */
    uint32_t underrun_grace_us;
    uint32_t telemetry_us;
    bool accelerometer;         /* the shell calls waam_core_accelerometer */
    bool part_temperature;      /* the shell has a converter for it: part_v */
    waam_temperature_config_t temperature; /* of the part; $C changes it */
} waam_config_t;

typedef enum { WAAM_PROCESS_ABSENT = 0, WAAM_PROCESS_OK, WAAM_PROCESS_LOST } waam_process_t;

typedef struct {
    bool estop, limit_switch, gas_ok;
    bool late;                  /* the shell is 20 ms behind with its ticks: no control any more */
    bool home_switch[WAAM_AXES];
    waam_process_t process;     /* are the five values below connected */
    double current_a, voltage_v, wire_mm_s; /* current and voltage: not used where the fast tick has them */
    bool drive_fault;           /* FAULT output of a drive: its axis does not follow the pulses any more */
    bool over_temperature;      /* thermal switch of torch, drives or cooling */
    double temperature_c;       /* of torch or drives, where it is measured; else 0 */
    float part_v;               /* at the converter for the temperature of the part; NaN = no reading */
    uint32_t distance_reading;  /* counts up with every reading of the distance sensor */
    float distance;             /* of it: mm, or counts of the infrared sensor; NaN = no echo */
} waam_inputs_t;

typedef struct {
    int64_t pulses[WAAM_AXES];  /* pulses since the start, at the end of this tick; the shell spreads the new ones over it */
    int32_t part[WAAM_AXES];    /* where the axis should be beyond the last pulse, in 1 / WAAM_PARTS of a step, at most a half:
                                 * so the shell knows when the pulses are due, and not only in which tick */
    bool arc, gas;
    bool drives;                /* enable the axes' drives: torque */
    bool sense;                 /* low sense voltage between wire and work instead of the source: stick check */
    double wire_mm_s, voltage_v;
} waam_outputs_t;

typedef enum { WAAM_TX_ASSURED, WAAM_TX_TELEMETRY } waam_tx_kind_t;
typedef void (*waam_tx_t)(void *context, const char *line, size_t bytes, waam_tx_kind_t kind);

#endif
