#include <time.h>

#include "host.h"

#define SLOW_RATE 0.2
#define CATCH_UP_NS 50000000u /* time lost on the wall beyond this is not made up for */

uint64_t wall_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

static uint64_t period_ns(const pace_t *pace, pace_mode_t mode)
{
    static const double most[] = {[PACE_REAL] = 1.0, [PACE_SLOW] = SLOW_RATE};
    double rate = pace->rate;
    if (mode != PACE_FAST && (rate == 0.0 || rate > 1.0))
        rate = most[mode];
    return rate == 0.0 ? 0 : (uint64_t)(pace->step_us * 1e3 / rate);
}

/* Steps that are late, but will be made up for, count as done: a stamp tells the time, not how busy the computer is. */
uint32_t pace_since_us(const pace_t *pace, pace_mode_t mode)
{
    uint64_t period = period_ns(pace, mode), now = wall_ns();
    if (period == 0 || now <= pace->due_ns)
        return 0;
    uint64_t since = now - pace->due_ns;
    return (uint32_t)((double)(since < CATCH_UP_NS ? since : CATCH_UP_NS) / (double)period * pace->step_us);
}

uint64_t pace_left_ns(const pace_t *pace, pace_mode_t mode)
{
    uint64_t due = pace->due_ns + period_ns(pace, mode), now = wall_ns();
    return due > now ? due - now : 0;
}

void pace_step(pace_t *pace, pace_mode_t mode)
{
    uint64_t period = period_ns(pace, mode), now = wall_ns();
    pace->due_ns += period;
    if (period == 0 || pace->due_ns + CATCH_UP_NS < now)
        pace->due_ns = now;
}
