#include <errno.h>
#include <inttypes.h>
#include <string.h>

#include "host.h"

int events_open(events_t *events, const char *path)
{
    *events = (events_t){.state = -1};
    if (!path)
        return 0;
    events->file = fopen(path, "w");
    if (!events->file) {
        fprintf(stderr, "virtual_controller: cannot write the event log %s: %s\n", path, strerror(errno));
        return -1;
    }
    return 0;
}

static void edge(events_t *events, bool *before, bool now, const char *name, uint64_t t_us)
{
    if (*before != now)
        fprintf(events->file, "%" PRIu64 " %s %s\n", t_us, name, now ? "on" : "off");
    *before = now;
}

void events_tick(events_t *events, const waam_core_t *core, const waam_outputs_t *outputs)
{
    if (!events->file)
        return;
    edge(events, &events->gas, outputs->gas, "gas", core->now_us);
    bool arc_changed = events->arc != outputs->arc;
    edge(events, &events->arc, outputs->arc, "arc", core->now_us);
    if (arc_changed) /* the lease stamp that was in force */
        fprintf(events->file, "%" PRIu64 " lease %" PRIu64 "\n", core->now_us, core->lease_us);
    edge(events, &events->established, core->arc.established, "established", core->now_us);
    if (events->state != (int)core->state)
        fprintf(events->file, "%" PRIu64 " state %s E%03d\n", core->now_us, waam_state_name(core->state), core->fault);
    events->state = (int)core->state;
    fflush(events->file);
}
