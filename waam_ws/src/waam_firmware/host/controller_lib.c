#include "controller_lib.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEFT 512
#define EXCHANGE_US 10000u /* between two answers of the cell */

struct controller_lib {
    host_harness_t harness;
    char tx[CONTROLLER_LIB_TX_BYTES];
    size_t tx_used;
    controller_lib_done_t done[CONTROLLER_LIB_DONE];
    size_t done_count;
    controller_lib_done_t left[LEFT]; /* their block has left the queue, their motion is not at its end yet */
    size_t left_count;
    uint32_t last_line;
    uint64_t arc_off_us, arc_off_lease_us;
};

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    controller_lib_t *t = context;
    size_t most = kind == WAAM_TX_TELEMETRY ? CONTROLLER_LIB_TX_BYTES / 2 : CONTROLLER_LIB_TX_BYTES;
    if (t->tx_used + bytes > most)
        return;
    memcpy(t->tx + t->tx_used, line, bytes);
    t->tx_used += bytes;
}

static controller_lib_t *configured(uint32_t boot_id, uint64_t start_us)
{
    controller_lib_t *t = calloc(1, sizeof *t);
    if (!t)
        return NULL;
    t->harness.config = waam_config_default();
    t->harness.config.boot_id = boot_id;
    t->harness.config.start_us = start_us;
    return t;
}

controller_lib_t *controller_lib_new(uint32_t boot_id, uint64_t start_us)
{
    controller_lib_t *t = configured(boot_id, start_us);
    if (!t)
        return NULL;
    t->harness.config.starts_in_alarm = false;
    t->harness.null_plant = true;
    host_harness_source(&t->harness, TICK_US);
    for (int i = 0; i < WAAM_AXES; i++)
        t->harness.start_mm[i] = i == 2 ? t->harness.config.limit_max_mm[i] - 5.0 : 5.0;
    waam_core_init(&t->harness.core, &t->harness.config, on_line, t);
    return t;
}

controller_lib_t *controller_lib_with_cell(uint32_t boot_id, uint64_t start_us)
{
    static const double start_mm[WAAM_AXES] = {60.0, 50.0, 150.0}; /* as of host/options.c */
    controller_lib_t *t = configured(boot_id, start_us);
    if (!t)
        return NULL;
    t->harness.config.clock_is_ros_time = true;
    t->harness.config.starts_in_alarm = true;
    host_harness_source(&t->harness, EXCHANGE_US);
    memcpy(t->harness.start_mm, start_mm, sizeof start_mm);
    waam_core_init(&t->harness.core, &t->harness.config, on_line, t);
    return t;
}

void controller_lib_place(controller_lib_t *lib, double x, double y, double z)
{
    const double start_mm[WAAM_AXES] = {x, y, z};
    memcpy(lib->harness.start_mm, start_mm, sizeof start_mm);
}

void controller_lib_machine_steps(controller_lib_t *lib, const double *steps_per_mm)
{
    memcpy(lib->harness.config.steps_per_mm, steps_per_mm, sizeof lib->harness.config.steps_per_mm);
}

void controller_lib_widen(controller_lib_t *lib, const double *low_mm, const double *high_mm)
{
    waam_config_t *config = &lib->harness.core.config;
    for (int i = 0; i < WAAM_AXES; i++) {
        config->limit_min_mm[i] = fmin(config->limit_min_mm[i], low_mm[i]);
        config->limit_max_mm[i] = fmax(config->limit_max_mm[i], high_mm[i]);
        lib->harness.config.limit_min_mm[i] = config->limit_min_mm[i];
        lib->harness.config.limit_max_mm[i] = config->limit_max_mm[i];
    }
}

void controller_lib_copy(controller_lib_t *to, const controller_lib_t *from)
{
    to->harness = from->harness;
    to->harness.core.context = to;
    to->tx_used = to->done_count = to->left_count = 0;
    to->last_line = from->last_line;
}

void controller_lib_free(controller_lib_t *lib) { free(lib); }

void controller_lib_rx(controller_lib_t *lib, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        waam_core_rx(&lib->harness.core, (uint8_t)bytes[i]);
}

void controller_lib_hang_up(controller_lib_t *lib)
{
    lib->tx_used = 0;
    waam_core_hang_up(&lib->harness.core);
}

static void note(controller_lib_t *t, const waam_block_t *block)
{
    if (block->line <= t->last_line || block->line > t->harness.core.planned || t->left_count == LEFT)
        return;
    controller_lib_done_t *d = &t->left[t->left_count++];
    *d = (controller_lib_done_t){.line = block->line, .kind = block->kind, .wire_mm_s = (float)block->wire_mm_s,
                       .voltage_v = (float)block->voltage_v};
    memcpy(d->end, block->end, sizeof d->end);
    t->last_line = block->line;
}

static void note_executed(controller_lib_t *t)
{
    size_t count = 0;
    while (count < t->left_count && t->left[count].line <= t->harness.core.executed)
        count++;
    for (size_t i = 0; i < count && t->done_count < CONTROLLER_LIB_DONE; i++)
        t->done[t->done_count++] = t->left[i];
    t->left_count = t->harness.core.state == WAAM_ALARM ? 0 : t->left_count - count;
    memmove(t->left, t->left + count, t->left_count * sizeof t->left[0]);
}

/* Blocks that left the queue in this tick still stand in its ring. */
static void tick(controller_lib_t *t)
{
    const waam_planner_t *planner = &t->harness.core.planner;
    size_t head = planner->head;
    bool arc = t->harness.outputs.arc;
    uint64_t lease_us = t->harness.core.lease_us;
    host_harness_tick(&t->harness);
    for (size_t i = 0; i < WAAM_BLOCKS && (head + i) % WAAM_BLOCKS != planner->head; i++)
        note(t, &planner->block[(head + i) % WAAM_BLOCKS]);
    note_executed(t);
    if (arc && !t->harness.outputs.arc) {
        t->arc_off_us = t->harness.core.now_us;
        t->arc_off_lease_us = lease_us;
    }
}

void controller_lib_run(controller_lib_t *lib, uint32_t milliseconds)
{
    while (milliseconds--)
        tick(lib);
}

void controller_lib_step(controller_lib_t *lib, uint32_t milliseconds, host_sample_t *samples)
{
    for (uint32_t i = 0; i < milliseconds; i++) {
        tick(lib);
        samples[i] = host_harness_sample(&lib->harness);
    }
}

void controller_lib_answer(controller_lib_t *lib, uint32_t inputs, double current, double voltage, double wire_speed)
{
    lib->harness.contact = inputs & 8;
    lib->harness.inputs = (waam_inputs_t){
        .estop = inputs & 1, .gas_ok = inputs & 2, .limit_switch = inputs & 4, .over_temperature = inputs & 16,
        .drive_fault = inputs & 32,
        .process = WAAM_PROCESS_OK, .current_a = current, .voltage_v = voltage, .wire_mm_s = wire_speed * 1e3,
        .distance_reading = lib->harness.inputs.distance_reading, .distance = lib->harness.inputs.distance,
        .part_v = lib->harness.inputs.part_v,
    };
}

void controller_lib_distance(controller_lib_t *lib, uint32_t reading, double value)
{
    lib->harness.inputs.distance_reading = reading;
    lib->harness.inputs.distance = (float)value;
}

void controller_lib_part(controller_lib_t *lib, double volts)
{
    lib->harness.core.config.part_temperature = true;
    lib->harness.inputs.part_v = (float)volts;
}

size_t controller_lib_take(controller_lib_t *lib, char *bytes, size_t size)
{
    size_t count = lib->tx_used < size ? lib->tx_used : size;
    memcpy(bytes, lib->tx, count);
    lib->tx_used = 0;
    return count;
}

size_t controller_lib_executed(controller_lib_t *lib, controller_lib_done_t *done, size_t size)
{
    size_t count = lib->done_count < size ? lib->done_count : size;
    memcpy(done, lib->done, count * sizeof *done);
    lib->done_count = 0;
    return count;
}

void controller_lib_look(const controller_lib_t *lib, controller_lib_view_t *view)
{
    const waam_core_t *core = &lib->harness.core;
    *view = (controller_lib_view_t){.now_us = core->now_us, .arc_off_us = lib->arc_off_us,
                          .arc_off_lease_us = lib->arc_off_lease_us, .state = (int32_t)core->state,
                          .fault = (int32_t)core->fault, .arc = lib->harness.outputs.arc, .homed = core->homed,
                          .queued = (int32_t)core->planner.count};
}
