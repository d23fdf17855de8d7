/* The virtual controller: feeds the core with time, bytes and inputs. */
#include <math.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <unistd.h>

#include "host.h"

#define FRESH_US 250000u       /* a host further behind than this is late */
#define NULL_STRIKE_US 50000u

typedef struct {
    options_t options;
    waam_config_t config;
    waam_core_t core;
    pty_t pty;
    plant_t plant;
    pace_t pace;
    events_t events;
    waam_inputs_t inputs;
    waam_outputs_t outputs;
    uint64_t null_arc_us;      /* null plant: the arc output has been on for this long */
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
        for (size_t i = 0; i < count; i++)
            waam_core_rx(&h->core, (uint8_t)bytes[i]);
    }
    if (before && !h->pty.connected)
        waam_core_rx(&h->core, '\n'); /* ends a line that was cut off */
    pty_flush(&h->pty);
}

static uint64_t age_us(const host_t *h, uint64_t stamp_us)
{
    return stamp_us ? h->core.now_us - stamp_us : UINT64_MAX;
}

/* How old the news from the host is, where it matters. The lease counts as soon as one is given, not only with the arc on:
 * else time could run so far ahead of a host that works off a backlog that the lease is over when the arc is struck. */
static uint64_t news_age_us(const host_t *h)
{
    const waam_core_t *core = &h->core;
    uint64_t beat = age_us(h, core->beat_us), lease = age_us(h, core->lease_us);
    bool leased = h->outputs.arc || (core->armed && core->lease_us);
    return leased && lease > beat ? lease : beat;
}

/* A host that is late gets time to catch up before a watchdog ends the job, for simulated time costs nothing; a dead one
 * still runs into the watchdog. */
static pace_mode_t pace_mode(const host_t *h)
{
    uint64_t age = news_age_us(h);
    if (!h->pty.connected || (h->options.plant && h->plant.client < 0))
        return PACE_REAL;
    if (age < FRESH_US)
        return pty_blocked(&h->pty) ? PACE_REAL : PACE_FAST;
    return h->core.state == WAAM_RUN && age < h->config.lease_us ? PACE_SLOW : PACE_REAL;
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

static void physical_steps(const host_t *h, int64_t at[WAAM_AXES])
{
    for (int i = 0; i < WAAM_AXES; i++)
        at[i] = llround(h->options.start_mm[i] * h->config.steps_per_mm) + h->outputs.pulses[i];
}

static void press_home_switches(host_t *h)
{
    const waam_config_t *c = &h->config;
    int64_t at[WAAM_AXES];
    physical_steps(h, at);
    for (int i = 0; i < WAAM_AXES; i++)
        h->inputs.home_switch[i] = c->home_direction[i] < 0 ? at[i] <= llround(c->limit_min_mm[i] * c->steps_per_mm)
                                                            : at[i] >= llround(c->limit_max_mm[i] * c->steps_per_mm);
}

static void null_plant(host_t *h)
{
    h->null_arc_us = h->outputs.arc ? h->null_arc_us + TICK_US : 0;
    bool burns = h->null_arc_us >= NULL_STRIKE_US;
    h->inputs.process = WAAM_PROCESS_OK;
    h->inputs.gas_ok = h->outputs.gas;
    h->inputs.wire_mm_s = h->outputs.wire_mm_s;
    h->inputs.current_a = burns ? 180.0 : 0.0;
    h->inputs.voltage_v = burns ? 22.0 : h->outputs.arc ? 65.0 : 0.0;
}

static plant_sample_t sample(const host_t *h)
{
    int64_t at[WAAM_AXES];
    double per_m = h->config.steps_per_mm * 1e3;
    physical_steps(h, at);
    return (plant_sample_t){
        .table_x = -(double)at[0] / per_m, .table_y = -(double)at[1] / per_m, .tool_z = (double)at[2] / per_m,
        .wire_cmd = h->outputs.wire_mm_s * 1e-3, .voltage_set = h->outputs.voltage_v,
        .outputs = (h->outputs.arc ? 1u : 0u) | (h->outputs.gas ? 2u : 0u),
    };
}

static void step(host_t *h)
{
    plant_sample_t samples[SAMPLES];
    plant_accept(&h->plant);
    for (unsigned i = 0; i < SAMPLES; i++) {
        press_home_switches(h);
        if (h->options.null_plant)
            null_plant(h);
        waam_core_tick(&h->core, TICK_US, &h->inputs, &h->outputs);
        events_tick(&h->events, &h->core, &h->outputs);
        samples[i] = sample(h);
    }
    if (h->plant.client >= 0)
        plant_exchange(&h->plant, samples, h->core.now_us, &h->inputs, h->pty.connected ? h->pty.fd : -1, serve_link, h);
}

static int start(host_t *h)
{
    h->config = waam_config_default();
    h->config.start_us = h->options.epoch_us;
    h->config.clock_is_ros_time = h->options.clock_is_ros_time;
    if (getrandom(&h->config.boot_id, sizeof h->config.boot_id, 0) != sizeof h->config.boot_id)
        h->config.boot_id = (uint32_t)wall_ns();
    h->pace = (pace_t){.rate = h->options.rate, .due_ns = wall_ns()};
    waam_core_init(&h->core, &h->config, on_line, h);
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
