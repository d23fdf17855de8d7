#include "load.h"

#include "counters.h"
#include "registers.h"

static load_t loads[LOADS];
/* Each is written by its own part only, so that nothing is lost; they wrap, as the clock does. */
static volatile uint32_t spent[LOADS] = {COUNTER_START(100), COUNTER_START(100), COUNTER_START(100), COUNTER_START(100)};

/* The clock as `part` alone would see it. Read again when an interrupt came in between. */
static uint32_t own_clock(load_part_t part)
{
    uint32_t above, again, now;
    do {
        above = again = 0;
        for (unsigned i = 0; i < part; i++)
            above += spent[i];
        now = board_clock();
        for (unsigned i = 0; i < part; i++)
            again += spent[i];
    } while (above != again);
    return now - above;
}

uint32_t load_begin(load_part_t part) { return own_clock(part); }

void load_end(load_part_t part, uint32_t begun)
{
    load_t *load = &loads[part];
    uint32_t used = own_clock(part) - begun;
    spent[part] += used;
    load->runs++;
    load->total += used;
    if (used > load->longest)
        load->longest = used;
}

load_t load_take(load_part_t part)
{
    interrupts_off();
    load_t taken = loads[part];
    loads[part] = (load_t){0};
    interrupts_on();
    return taken;
}
