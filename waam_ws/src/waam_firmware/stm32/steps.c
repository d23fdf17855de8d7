#include "steps.h"

#include "counters.h"
#include "load.h"
#include "registers.h"

#define SEGMENTS 4u           /* power of two */

typedef struct {
    uint32_t count[STEP_AXES];
    uint8_t negative;         /* one bit per axis */
} segment_t;

static segment_t queue[SEGMENTS];
/* segments; pushed is written by the tick, taken by the interrupt; both wrap */
static volatile uint32_t pushed = COUNTER_START(12000), taken = COUNTER_START(12000);
static int64_t planned[STEP_AXES] = {[WAAM_AXES] = POSITION_START(300)}; /* pulses put into the queue */
static volatile uint32_t given[STEP_AXES] = {[WAAM_AXES] = (uint32_t)POSITION_START(300)}; /* wraps */
static volatile uint32_t starved;

static struct {               /* only the interrupt's */
    uint32_t count[STEP_AXES], phase[STEP_AXES], slot;
    bool moving, primed;
} run = {.slot = STEP_SLOTS};

bool steps_room(void) { return pushed - taken < SEGMENTS; }

void steps_push(const int64_t target[STEP_AXES])
{
    segment_t segment = {.negative = 0};
    for (unsigned i = 0; i < STEP_AXES; i++) {
        int64_t left = target[i] - planned[i], most = STEP_SLOTS;
        int32_t change = (int32_t)(left > most ? most : left < -most ? -most : left);
        planned[i] += change;
        segment.count[i] = (uint32_t)(change < 0 ? -change : change);
        segment.negative |= (uint8_t)((change < 0) << i);
    }
    queue[pushed % SEGMENTS] = segment;
    barrier();
    pushed++;
}

void steps_given(int32_t at[STEP_AXES])
{
    for (unsigned i = 0; i < STEP_AXES; i++)
        at[i] = (int32_t)given[i];
}

uint32_t steps_starved(void) { return starved; }

/* One whole tick waits in reserve, so that the next may be almost a tick late. */
static bool next_waits(void)
{
    uint32_t waiting = pushed - taken;
    starved += run.primed && run.moving && !waiting;
    run.primed = run.primed ? waiting > 0 : waiting > 1;
    return run.primed;
}

/* Directions change here, one slot before the first pulse of the segment can come. */
static void next_segment(void)
{
    bool more = next_waits();
    const segment_t *s = &queue[taken % SEGMENTS];
    run.moving = false;
    for (unsigned i = 0; i < STEP_AXES; i++) {
        bool negative = s->negative >> i & 1u;
        run.count[i] = more ? s->count[i] : 0;
        run.phase[i] = STEP_SLOTS / 2;
        if (!run.count[i])
            continue;
        run.moving = true;
        given[i] += negative ? 0u - s->count[i] : s->count[i];
        board_direction(i, negative);
    }
    if (!more)
        return; /* looks again in the next slot */
    run.slot = 0;
    taken++;
}

void TIM3_IRQHandler(void)
{
    uint32_t start = load_begin(LOAD_STEPS);
    TIM3->SR = 0;
    if (run.slot == STEP_SLOTS)
        next_segment();
    run.slot += run.slot < STEP_SLOTS;
    for (unsigned i = 0; i < STEP_AXES; i++) {
        uint32_t phase = run.phase[i] + run.count[i], due = phase >= STEP_SLOTS;
        run.phase[i] = due ? phase - STEP_SLOTS : phase;
        TIM3->CCR[i] = due ? board_pulse : 0;
    }
    load_end(LOAD_STEPS, start);
}
