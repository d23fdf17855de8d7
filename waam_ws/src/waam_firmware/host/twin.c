#include "twin.h"

#include <stdlib.h>
#include <string.h>

struct twin {
    rig_t rig;
    char tx[TWIN_TX_BYTES];
    size_t tx_used;
    twin_done_t done[TWIN_DONE];
    size_t done_count;
    uint32_t last_line;
    uint64_t arc_off_us, arc_off_lease_us;
};

static void on_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    twin_t *t = context;
    size_t most = kind == WAAM_TX_TELEMETRY ? TWIN_TX_BYTES / 2 : TWIN_TX_BYTES;
    if (t->tx_used + bytes > most)
        return;
    memcpy(t->tx + t->tx_used, line, bytes);
    t->tx_used += bytes;
}

twin_t *twin_new(uint32_t boot_id, uint64_t start_us)
{
    twin_t *t = calloc(1, sizeof *t);
    if (!t)
        return NULL;
    t->rig.config = waam_config_default();
    t->rig.config.boot_id = boot_id;
    t->rig.config.start_us = start_us;
    t->rig.config.starts_in_alarm = false;
    t->rig.null_plant = true;
    rig_source(&t->rig, TICK_US);
    for (int i = 0; i < WAAM_AXES; i++)
        t->rig.start_mm[i] = i == 2 ? t->rig.config.limit_max_mm[i] - 5.0 : 5.0;
    waam_core_init(&t->rig.core, &t->rig.config, on_line, t);
    return t;
}

void twin_free(twin_t *twin) { free(twin); }

void twin_rx(twin_t *twin, const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        waam_core_rx(&twin->rig.core, (uint8_t)bytes[i]);
}

void twin_hang_up(twin_t *twin)
{
    twin->tx_used = 0;
    waam_core_hang_up(&twin->rig.core);
}

static void note(twin_t *t, const waam_block_t *block)
{
    if (block->line <= t->last_line || block->line > t->rig.core.executed || t->done_count == TWIN_DONE)
        return;
    twin_done_t *d = &t->done[t->done_count++];
    *d = (twin_done_t){.line = block->line, .kind = block->kind, .wire_mm_s = (float)block->wire_mm_s,
                       .voltage_v = (float)block->voltage_v};
    memcpy(d->end, block->end, sizeof d->end);
    t->last_line = block->line;
}

/* Blocks that left the queue in this tick still stand in its ring. */
static void tick(twin_t *t)
{
    const waam_planner_t *planner = &t->rig.core.planner;
    size_t head = planner->head;
    bool arc = t->rig.outputs.arc;
    uint64_t lease_us = t->rig.core.lease_us;
    rig_tick(&t->rig);
    for (size_t i = 0; i < WAAM_BLOCKS && (head + i) % WAAM_BLOCKS != planner->head; i++)
        note(t, &planner->block[(head + i) % WAAM_BLOCKS]);
    if (arc && !t->rig.outputs.arc) {
        t->arc_off_us = t->rig.core.now_us;
        t->arc_off_lease_us = lease_us;
    }
}

void twin_run(twin_t *twin, uint32_t milliseconds)
{
    while (milliseconds--)
        tick(twin);
}

size_t twin_take(twin_t *twin, char *bytes, size_t size)
{
    size_t count = twin->tx_used < size ? twin->tx_used : size;
    memcpy(bytes, twin->tx, count);
    twin->tx_used = 0;
    return count;
}

size_t twin_executed(twin_t *twin, twin_done_t *done, size_t size)
{
    size_t count = twin->done_count < size ? twin->done_count : size;
    memcpy(done, twin->done, count * sizeof *done);
    twin->done_count = 0;
    return count;
}

void twin_look(const twin_t *twin, twin_view_t *view)
{
    const waam_core_t *core = &twin->rig.core;
    *view = (twin_view_t){.now_us = core->now_us, .arc_off_us = twin->arc_off_us,
                          .arc_off_lease_us = twin->arc_off_lease_us, .state = (int32_t)core->state,
                          .fault = (int32_t)core->fault, .arc = twin->rig.outputs.arc, .homed = core->homed,
                          .queued = (int32_t)core->planner.count};
}
