#include "steps.h"

#include "counters.h"
#include "load.h"
#include "registers.h"

#define SEGMENTS 4u           /* power of two */

typedef struct {
    uint8_t count[STEP_AXES];   /* pulses */
    uint8_t first[STEP_AXES];   /* way since the last pulse was due, 1 / WAAM_PARTS of a step */
    uint16_t way[STEP_AXES];    /* of the tick, the same */
    uint8_t negative;           /* one bit per axis */
} segment_t;

static segment_t queue[SEGMENTS];
/* segments; pushed is written by the tick, taken by the interrupt; both wrap */
static volatile uint32_t pushed = COUNTER_START(12000), taken = COUNTER_START(12000);
static int64_t planned[STEP_AXES] = {[WAAM_AXES] = POSITION_START(300)}; /* pulses put into the queue */
static int32_t planned_part[STEP_AXES];
static volatile uint32_t given[STEP_AXES] = {[WAAM_AXES] = (uint32_t)POSITION_START(300)}; /* wraps */
static volatile uint32_t starved;

static struct {               /* only the interrupt's */
    uint32_t way[STEP_AXES], phase[STEP_AXES], slot;
    bool moving, primed;
} run = {.slot = STEP_SLOTS};

bool steps_room(void) { return pushed - taken < SEGMENTS; }

/* A pulse is due half way between two steps. Over the tick exactly `count` of these places are passed. */
static void put(segment_t *segment, unsigned axis, int32_t change, int32_t from, int32_t to)
{
    int32_t half = WAAM_PARTS / 2, way = change * WAAM_PARTS + to - from;
    bool negative = change < 0;
    segment->count[axis] = (uint8_t)(negative ? -change : change);
    segment->first[axis] = (uint8_t)(negative ? half - 1 - from : half + from);
    segment->way[axis] = (uint16_t)(negative ? -way : way);
    segment->negative |= (uint8_t)(negative << axis);
}

void steps_push(const int64_t target[STEP_AXES], const int32_t part[STEP_AXES])
{
    segment_t segment = {.negative = 0};
    for (unsigned i = 0; i < STEP_AXES; i++) {
        int64_t left = target[i] - planned[i], most = STEP_SLOTS - 1;
        int32_t change = (int32_t)(left > most ? most : left < -most ? -most : left);
        planned[i] += change;
        put(&segment, i, change, planned_part[i], part[i]);
        planned_part[i] = part[i];
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
        bool moves = more && s->count[i];
        run.way[i] = moves ? s->way[i] : 0;
        run.phase[i] = s->first[i] * STEP_SLOTS;
        if (!moves)
            continue;
        run.moving = true;
        given[i] += negative ? 0u - s->count[i] : (uint32_t)s->count[i];
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
        uint32_t phase = run.phase[i] + run.way[i], due = phase >= STEP_SLOTS * WAAM_PARTS;
        run.phase[i] = due ? phase - STEP_SLOTS * WAAM_PARTS : phase;
        TIM3->CCR[i] = due ? board_pulse : 0;
    }
    load_end(LOAD_STEPS, start);
}
