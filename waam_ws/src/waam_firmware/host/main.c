/* The virtual controller: feeds the core with time, bytes and inputs. */
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "host.h"

#define FRESH_US 250000u       /* a host further behind than this is late */
#define FINE_RATE 2.0          /* up to here time goes in single ticks, as on a board */

typedef struct {
    options_t options;
    host_harness_t harness;
    pty_t pty;
    plant_t plant;
    pace_t pace;
    events_t events;
} host_t;

static volatile sig_atomic_t quit;
static host_t host;

static void on_signal(int number)
{
    (void)number;
    quit = 1;
}

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    pty_send(&((host_t *)context)->pty, line, bytes, kind);
}

static pace_mode_t pace_mode(const host_t *h);

/* Moves bytes both ways, without waiting; a flood is taken in portions, so that time goes on. */
static void serve_link(void *context)
{
    host_t *h = context;
    char bytes[4096];
    bool before = h->pty.connected;
    size_t count;
    for (int portion = 0; portion < 16 && pty_reads(&h->pty); portion++) {
        count = pty_read(&h->pty, bytes, sizeof bytes);
        if (count == 0)
            break;
        waam_core_clock(&h->harness.core, pace_since_us(&h->pace, pace_mode(h)));
        for (size_t i = 0; i < count; i++)
            waam_core_rx(&h->harness.core, (uint8_t)bytes[i]);
    }
    if (before && !h->pty.connected)
        waam_core_hang_up(&h->harness.core);
    pty_flush(&h->pty);
}

static uint64_t age_us(const host_t *h, uint64_t stamp_us)
{
    return stamp_us ? h->harness.core.now_us - stamp_us : UINT64_MAX;
}

/* How old the news from the host is, where it matters. The lease counts as soon as one is given, not only with the arc on:
 * else time could run so far ahead of a host that works off a backlog that the lease is over when the arc is struck. */
static uint64_t news_age_us(const host_t *h)
{
    const waam_core_t *core = &h->harness.core;
    uint64_t beat = age_us(h, core->beat_us), lease = age_us(h, core->lease_us);
    bool leased = h->harness.outputs.arc || (core->armed && core->lease_us);
    return leased && lease > beat ? lease : beat;
}

/* A host that is late gets time to catch up before a watchdog ends the job, for simulated time costs nothing; a dead one
 * still runs into the watchdog. */
static pace_mode_t pace_mode(const host_t *h)
{
    uint64_t age = news_age_us(h);
    if (!h->pty.connected || (h->options.plant && h->plant.client < 0))
        return PACE_REAL;
    bool moves = h->harness.core.state == WAAM_RUN || waam_wire_jogging(&h->harness.core.wire);
    bool rests = h->options.rests && !moves && !h->harness.core.armed && !h->harness.outputs.arc;
    if (age < FRESH_US)
        return rests || pty_blocked(&h->pty) ? PACE_REAL : PACE_FAST;
    return moves && age < h->harness.config.lease_us ? PACE_SLOW : PACE_REAL;
}

/* Waits until the next step is due; what arrives meanwhile is served and may bring it forward. */
static void wait_for_step(host_t *h)
{
    uint64_t left;
    while (!quit && (left = pace_left_ns(&h->pace, pace_mode(h))) > 0) {
        struct pollfd p = {.fd = h->pty.connected && pty_reads(&h->pty) ? h->pty.fd : -1, .events = POLLIN};
        struct timespec timeout = {.tv_nsec = (long)(left < STEP_US * 1000u ? left : STEP_US * 1000u)};
        if (pty_blocked(&h->pty))
            p = (struct pollfd){.fd = h->pty.fd, .events = POLLOUT};
        ppoll(&p, 1, &timeout, NULL);
        serve_link(h);
    }
    pace_step(&h->pace, pace_mode(h));
}

static void step(host_t *h)
{
    host_sample_t samples[SAMPLES];
    for (unsigned i = 0; i < h->pace.step_us / TICK_US; i++) {
        host_harness_tick(&h->harness);
        events_tick(&h->events, &h->harness.core, &h->harness.outputs);
        samples[i] = host_harness_sample(&h->harness);
    }
    if (h->plant.client >= 0)
        plant_exchange(&h->plant, samples, h->harness.core.now_us, &h->harness.inputs, h->pty.connected ? h->pty.fd : -1,
                       serve_link, h);
    h->harness.contact = h->plant.client >= 0 && h->plant.contact;
    if (h->plant.client < 0)
        h->plant.shaken = (host_shaken_t){.fitted = h->options.null_plant};
    host_harness_shake(&h->harness, &h->plant.shaken);
    plant_accept(&h->plant);
    bool fine = h->plant.client < 0 && h->options.rate > 0.0 && h->options.rate <= FINE_RATE;
    h->pace.step_us = fine ? TICK_US : STEP_US;
}

static int start(host_t *h)
{
    waam_config_t *config = &h->harness.config;
    *config = waam_config_default();
    config->start_us = h->options.epoch_us;
    config->clock_is_ros_time = h->options.clock_is_ros_time;
    if (getrandom(&config->boot_id, sizeof config->boot_id, 0) != sizeof config->boot_id)
        config->boot_id = (uint32_t)wall_ns();
    h->harness.null_plant = h->options.null_plant;
    host_harness_source(&h->harness, STEP_US);
    host_harness_accelerometer(&h->harness);
    config->starts_in_alarm = !h->options.start_idle;
    memcpy(h->harness.start_mm, h->options.start_mm, sizeof h->harness.start_mm);
    h->pace = (pace_t){.rate = h->options.rate, .step_us = STEP_US, .due_ns = wall_ns()};
    waam_core_init(&h->harness.core, config, on_line, h);
    memcpy(config->steps_per_mm, h->options.machine_steps, sizeof config->steps_per_mm);
    if (events_open(&h->events, h->options.events) < 0 || plant_open(&h->plant, h->options.plant) < 0 ||
        pty_open(&h->pty, h->options.pty_link) < 0)
        return -1;
    printf("ready %s\n", h->pty.path);
    fflush(stdout);
    return 0;
}

int main(int argc, char **argv)
{
    struct sigaction action = {.sa_handler = on_signal};
    sigaction(SIGTERM, &action, NULL);
    sigaction(SIGINT, &action, NULL);
    signal(SIGPIPE, SIG_IGN);
    host.options = options_parse(argc, argv);
    host.pty.fd = host.plant.listener = host.plant.client = -1;
    int result = start(&host);
    while (result == 0 && !quit) {
        wait_for_step(&host);
        serve_link(&host);
        step(&host);
        pty_flush(&host.pty);
    }
    pty_close(&host.pty);
    plant_close(&host.plant);
    if (host.events.file)
        fclose(host.events.file);
    if (host.pty.telemetry_dropped)
        fprintf(stderr, "virtual_controller: %llu telemetry lines dropped, the host did not read\n",
                (unsigned long long)host.pty.telemetry_dropped);
    return result == 0 ? 0 : 1;
}
