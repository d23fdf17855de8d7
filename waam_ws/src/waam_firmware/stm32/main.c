/* The controller core on the STM32F407: a main loop with three interrupts.
 *
 *     TIM3, 80 kHz   step pulses (steps.c)                       highest priority
 *     USART2         received bytes (port_serial.c)
 *     TIM2, 10 kHz   samples, arc regulator, bus of the accelerometer, time of the tick
 *     main loop      tick of the core, link, watchdog
 * and PendSV below them all, when the main loop stands still (fault.c).
 */
#include "board.h"
#include "counters.h"
#include "fault.h"
#include "load.h"
#include "port.h"
#include "registers.h"
#include "steps.h"

#define TICKS_BEHIND_MAX (WAAM_ORDERS_US / TICK_US) /* later than this is no control any more: ALARM */
#define RX_PER_TICK 256u      /* bytes worked on in one tick, up to the end of a line: planning is what takes time */
#define SEND_RESERVE 1536u    /* kept free for answers to what has been received */

static waam_core_t core;
static waam_inputs_t inputs;
static waam_outputs_t outputs;
static uint8_t received_bytes[2048], send_bytes[8192];
static queue_t received = QUEUE(received_bytes);
static queue_t to_send = QUEUE(send_bytes);
static volatile uint32_t ticks_due = COUNTER_START(12000); /* both wrap after 49.7 days */
static uint32_t ticks_done = COUNTER_START(12000);
static float wire_part;       /* of a step, not given out yet */
static int64_t wire_steps = POSITION_START(300);
static bool trusted;          /* the board is what it should be */
static bool late;

/* Answers always find room, because nothing is read while there is less than SEND_RESERVE; telemetry may be dropped. */
static void send_line(void *context, const char *line, size_t bytes, waam_tx_kind_t kind)
{
    (void)context;
    size_t reserve = kind == WAAM_TX_TELEMETRY ? 2 * SEND_RESERVE : 0;
    if (queue_free(&to_send) < bytes + reserve)
        return;
    for (size_t i = 0; i < bytes; i++)
        queue_put(&to_send, (uint8_t)line[i]);
}

static void accelerometer(void)
{
    static uint8_t bus[WAAM_ADXL345_BYTES];
    size_t count = board_bus_take(bus);
    board_bus_begin(bus, waam_core_accelerometer(&core, bus, count, bus));
}

void TIM2_IRQHandler(void)
{
    uint32_t begun = load_begin(LOAD_FAST);
    static uint32_t part;
    waam_fast_inputs_t in;
    waam_fast_outputs_t out;
    TIM2->SR = 0;
    board_sample(&in);
    waam_core_fast(&core, &in, &out);
    board_arc(&out);
    if (out.late)
        fault_main_loop_stands();
    accelerometer();
    if (++part == TICK_US / FAST_US) {
        part = 0;
        ticks_due++;
    }
    load_end(LOAD_FAST, begun);
}

static void push_steps(void)
{
    int64_t target[STEP_AXES];
    int32_t part[STEP_AXES] = {0};
    for (unsigned i = 0; i < WAAM_AXES; i++) {
        target[i] = outputs.pulses[i];
        part[i] = outputs.part[i];
    }
    wire_part += (float)outputs.wire_mm_s * (WIRE_STEPS_PER_MM * TICK_US * 1e-6f);
    int32_t whole = (int32_t)wire_part;
    wire_part -= (float)whole;
    wire_steps += whole;
    target[WAAM_AXES] = wire_steps;
    steps_push(target, part);
}

static void take_bytes(void)
{
    uint8_t byte = 0;
    for (unsigned i = 0; i < RX_PER_TICK && byte != '\n'; i++) {
        if (queue_free(&to_send) < SEND_RESERVE || !queue_get(&received, &byte))
            return;
        waam_core_rx(&core, byte);
    }
}

static void tick(void)
{
    uint32_t begun = load_begin(LOAD_TICK);
    board_inputs(&inputs);
    inputs.late = late;
    if (!trusted)
        inputs.process = WAAM_PROCESS_LOST;
    take_bytes();
    waam_core_tick(&core, TICK_US, &inputs, &outputs);
    push_steps();
    board_outputs(&outputs);
    late = false;
    fault_main_loop_runs();
    load_end(LOAD_TICK, begun);
}

/* A tick is run when it is due and the steps of those before have been given out. */
static bool tick_due(void)
{
    uint32_t behind = ticks_due - ticks_done;
    if (behind > TICKS_BEHIND_MAX) {
        late = true;
        ticks_done += behind - 1;
    }
    return behind > 0 && steps_room();
}

static void start(void)
{
    trusted = board_init();
    waam_config_t config = waam_config_default();
    config.boot_id = board_boot_id();
    config.reset_reason = fault_take();
    config.watchdog_reset = board_was_hung() || config.reset_reason;
    config.accelerometer = true; /* the driver; whether a sensor answers shows when it is asked for */
    config.part_temperature = true;
    board_ranges(&config);
    waam_core_init(&core, &config, send_line, NULL);
    port_start();
    board_start_timers();
    board_start_watchdog();
    interrupts_on();
}

int main(void)
{
    start();
    for (;;) {
        if (tick_due()) {
            ticks_done++;
            tick();
        }
        if (port_serve(&received, &to_send))
            waam_core_hang_up(&core);
        waam_core_linked(&core);
        if (waam_core_alive(&core))
            board_feed_watchdog();
        if (queue_used(&to_send) == 0)
            board_idle();
    }
}
