/* The host shell of the virtual controller: what a board's shell does with pins, done with files and sockets. */
#ifndef WAAM_HOST_H
#define WAAM_HOST_H

#include <poll.h>
#include <stdio.h>

#include "host_harness.h"

#define STEP_US 10000u   /* one exchange with the plant */
#define SAMPLES (STEP_US / TICK_US)

typedef struct {
    const char *pty_link, *plant, *events;
    bool null_plant, clock_is_ros_time, start_idle;
    bool rests;             /* at most real time while there is nothing to do */
    double rate;            /* simulated seconds per second; 0 = no limit */
    uint64_t epoch_us;
    double start_mm[WAAM_AXES];
    double machine_steps[WAAM_AXES]; /* that a mm of the machine really takes */
} options_t;

/* Exits with a message when the command line is wrong or help was asked for. */
options_t options_parse(int argc, char **argv);

/* ---- pseudo-terminal ---- */
#define TX_BYTES (1024u * 1024u)
#define TX_TELEMETRY_BYTES (512u * 1024u) /* beyond this much unsent (4 s at 1 kHz), telemetry is dropped */
#define TX_INPUT_BYTES (768u * 1024u)     /* beyond this much unsent, nothing is read any more */

typedef struct {
    int fd;
    char path[64];
    const char *link;
    bool connected;
    char tx[TX_BYTES];
    size_t tx_head, tx_used;
    uint64_t telemetry_dropped;
} pty_t;

/* 0, or -1 with a message on stderr. */
int pty_open(pty_t *pty, const char *link);
void pty_close(pty_t *pty);
/* Reads what has arrived (at most `size` bytes); notices when the other end comes or goes. */
size_t pty_read(pty_t *pty, char *bytes, size_t size);
void pty_send(pty_t *pty, const char *bytes, size_t count, waam_tx_kind_t kind);
void pty_flush(pty_t *pty);
bool pty_blocked(const pty_t *pty);
bool pty_reads(const pty_t *pty);

/* ---- plant port ---- */
typedef struct {
    int listener, client;
    const char *path;
    uint64_t inode;
    bool was_connected;
    bool contact;           /* the wire touches the work: seen by the source's sense supply */
    host_shaken_t shaken;   /* what its accelerometer felt in the last step */
} plant_t;

typedef void (*plant_idle_t)(void *context); /* called while an answer is awaited, when the pty has something to say */

/* Listens for the cell; path NULL = no port. 0, or -1 with a message on stderr. */
int plant_open(plant_t *plant, const char *path);
void plant_close(plant_t *plant);
/* Takes one cell; others are refused while it is there. */
void plant_accept(plant_t *plant);
/* Sends one step and waits for the answer. A lost client sets inputs->process to LOST. */
void plant_exchange(plant_t *plant, const host_sample_t samples[SAMPLES], uint64_t t_us, waam_inputs_t *inputs,
                    int pty_fd, plant_idle_t idle, void *context);

/* ---- pacing ---- */
typedef struct {
    double rate;
    uint32_t step_us; /* simulated time of the next step */
    uint64_t due_ns; /* when the step that was done was due on the wall clock */
} pace_t;

/* Steady clock. */
uint64_t wall_ns(void);
/* FAST: as fast as asked for. REAL: at most real time. SLOW: a fifth of it, unless real time or less was asked for. */
typedef enum { PACE_FAST, PACE_REAL, PACE_SLOW } pace_mode_t;

/* Simulated microseconds since the last step was due; 0 where time runs as fast as it can. */
uint32_t pace_since_us(const pace_t *pace, pace_mode_t mode);
/* Nanoseconds until the next step may be done. */
uint64_t pace_left_ns(const pace_t *pace, pace_mode_t mode);
/* A step is about to be done. */
void pace_step(pace_t *pace, pace_mode_t mode);

/* ---- events ---- */
typedef struct {
    FILE *file;
    bool arc, established, gas;
    int state;
} events_t;

/* path NULL = no log. 0, or -1 with a message on stderr. */
int events_open(events_t *events, const char *path);
/* Writes what has changed, stamped with controller time in us. */
void events_tick(events_t *events, const waam_core_t *core, const waam_outputs_t *outputs);

#endif
