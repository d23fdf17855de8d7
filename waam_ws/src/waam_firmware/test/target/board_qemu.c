/* Stands in for the board under QEMU (machine netduinoplus2). The period of its TIM models depends on when they are started,
 * so SysTick takes their place; TIM5 is a good clock of virtual nanoseconds. The machine around it does nothing wrong:
 * switches follow the step pulses, the arc burns 50 ms after it is enabled. USART1 is the hand of a test: a small letter
 * makes a fault, the capital ends it; '?' asks what the pins have done, 'r' for the load every 100 ms; digits and '=' are the
 * counts of the converter for the temperature of the part. */
#include "adxl345_device.h"
#include "board.h"
#include "converter.h"
#include "load.h"
#include "registers.h"
#include "steps.h"

#define STRIKE_TICKS (FAST_HZ / 20)
#define WATCHDOG_TICKS (FAST_HZ / 2)
#define REPORT_NS 100000000u
#define ARC_V 22.0f
#define ARC_GAIN 0.68f

#define SYSTICK ((reg_t *)0xE000E010u) /* control, reload, value */
#define CORE_HZ 168000000u

const uint32_t board_pulse = 1;
static const float start_mm[WAAM_AXES] = {8.0f, 6.0f, 195.0f};
static float arc_v = ARC_V;
static uint32_t arc_ticks, fault_changes;
static volatile uint32_t hungry; /* fast ticks since the watchdog was fed */
static volatile char asked;
static uint32_t idle_loops, loops_per_ms;
static waam_fast_outputs_t arc;
static waam_outputs_t slow;
static bool fault[26];
static volatile uint32_t part_counts;
static adxl345_device_t accelerometer;
static uint8_t bus[WAAM_ADXL345_BYTES];
static size_t bus_bytes;
static uint32_t starts __attribute__((section(".noinit"))), hung __attribute__((section(".noinit")));

static bool faulty(char letter) { return fault[letter - 'a']; }

void board_start_timers(void)
{
    irq_enable(IRQ_TIM3, 0);
    irq_enable(IRQ_TIM2, 2);
    SYSTICK[1] = CORE_HZ / STEP_HZ - 1;
    SYSTICK[2] = 0;
    SYSTICK[0] = 7;
}

void SysTick_Handler(void)
{
    static uint32_t count;
    NVIC_ISPR[0] = 1u << IRQ_TIM3 | (++count % (STEP_HZ / FAST_HZ) == 0 ? 1u << IRQ_TIM2 : 0u);
}

void USART1_IRQHandler(void)
{
    static uint32_t number;
    char byte = (char)USART1->DR, small = (char)(byte | 0x20);
    if (byte >= '0' && byte <= '9') {
        number = 10 * number + (uint32_t)(byte - '0');
    } else if (byte == '=') {
        part_counts = number;
        number = 0;
    } else if (small >= 'a' && small <= 'z') {
        fault[small - 'a'] = byte == small;
        fault_changes++;
    } else {
        asked = byte;
    }
}

static void say(const char *text)
{
    for (; *text; text++)
        USART1->DR = (uint8_t)*text;
}

static void say_number(int64_t value)
{
    waam_text_t text = {.length = 0};
    waam_text_int(&text, value);
    waam_text_char(&text, ' ');
    text.text[text.length] = '\0';
    say(text.text);
}

static void say_pins(void)
{
    int32_t at[STEP_AXES];
    steps_given(at);
    say("pins ");
    for (unsigned i = 0; i < STEP_AXES; i++)
        say_number(at[i]);
    say_number(arc.arc);
    say_number(slow.gas);
    say_number((int64_t)(arc.voltage_v * 1000.0f));
    say_number(steps_starved());
    say_number(fault_changes);
    say_number(slow.drives);
    say("\n");
}

static void say_load(void)
{
    static const char *const names[LOADS] = {"steps ", "link ", "fast ", "tick "};
    static uint32_t before;
    uint32_t now = board_clock();
    if (now - before < REPORT_NS)
        return;
    say("load ");
    say_number(now - before);
    say_number((int64_t)(idle_loops * 1000000ull / loops_per_ms));
    before = now;
    idle_loops = 0;
    for (unsigned i = 0; i < LOADS; i++) {
        load_t load = load_take((load_part_t)i);
        say(names[i]);
        say_number(load.runs);
        say_number((int64_t)load.total);
        say_number(load.longest);
    }
    say("\n");
}

void board_start_watchdog(void) { hungry = 0; }

/* Uses up the stack; what comes after the call keeps the compiler from making a loop of it. */
static __attribute__((noinline)) uint32_t fill_stack(uint32_t depth)
{
    volatile uint32_t frame[64];
    frame[depth % 64] = depth;
    return faulty('o') ? fill_stack(depth + 1) + frame[depth % 64] : 0;
}

static void break_down(void)
{
    if (faulty('u'))
        __asm__ volatile("udf #0");
    if (faulty('b'))
        *(reg_t *)0xA0000000u = 0;
    if (faulty('o'))
        fill_stack(0);
    if (faulty('n'))
        SCB_ICSR = SCB_ICSR_NMIPENDSET;
}

void board_feed_watchdog(void)
{
    char question = asked;
    asked = 0;
    hungry = 0;
    if (question == '?')
        say_pins();
    if (faulty('r'))
        say_load();
    while (faulty('h')) { /* the main loop hangs, interrupts go on */
    }
    if (faulty('i')) { /* it stands still for 50 ms */
        while (hungry < FAST_HZ / 20) {
        }
        fault['i' - 'a'] = false;
    }
    break_down();
}

/* A processor that sleeps would be woken by QEMU some thousand times per second only; one that spins is on time, and the
 * loops tell how much of the processor was left. */
static __attribute__((noinline)) uint32_t spin(uint32_t before, uint32_t most)
{
    uint32_t loops = 0;
    while (before == hungry && loops < most)
        loops++;
    return loops;
}

void board_idle(void) { idle_loops += spin(hungry, 1000000u); }

bool board_init(void)
{
    TIM5->ARR = 0xFFFFFFFFu;
    TIM5->CR1 = TIM_CEN;
    USART1->CR1 = USART_UE | USART_RE | USART_TE | USART_RXNEIE;
    irq_enable(IRQ_USART1, 3);
    board_bus_init();
    uint32_t start = board_clock(), loops = spin(hungry, 100000u);
    loops_per_ms = (uint32_t)(loops * 1000000ull / (board_clock() - start));
    return true;
}

void board_safe(void) { arc = (waam_fast_outputs_t){0}; }

/* The watchdog, which QEMU does not have. */
void board_await_reset(void)
{
    say("watchdog reset\n");
    hung = true;
    for (;;) {
        SCB_AIRCR = SCB_AIRCR_RESET;
        barrier();
    }
}

bool board_was_hung(void)
{
    bool was = hung;
    hung = false;
    return was;
}

uint32_t board_boot_id(void) { return ++starts; }

uint32_t board_clock(void) { return TIM5->CNT; }

void board_ranges(waam_config_t *config) { converter_ranges(&config->monitor); }

static float current(void)
{
    return arc_ticks < STRIKE_TICKS || faulty('c') ? 0.0f : arc_ticks & 1u ? 181.0f : 179.0f;
}

/* As the converter would see them; a sensor that is torn off reads one end of the range. */
static float converted_current(void)
{
    uint32_t count = (uint32_t)((current() / CURRENT_A_PER_V + CURRENT_ZERO_V) / VOLT_PER_COUNT + 0.5f);
    return converter_current_a(faulty('k') ? CONVERTER_TOP : faulty('j') ? 0 : count);
}

/* The arc, k/(T s + 1) with dead time around 22 V: the source is followed with the gain that the schedule has for 180 A, 10 ms late, in 50 ms. */
static void follow_source(void)
{
    static float late[FAST_HZ / 100];
    static unsigned at;
    float *oldest = &late[at++ % (FAST_HZ / 100)];
    if (arc_ticks == 0)
        *oldest = arc_v = ARC_V;
    arc_v += (ARC_V + ARC_GAIN * (*oldest - ARC_V) - arc_v) / (0.05f * FAST_HZ);
    *oldest = arc.arc ? arc.voltage_v : ARC_V;
}

static float voltage(void)
{
    float ripple = arc_ticks & 1u ? 0.1f : -0.1f; /* one that never changes would be a broken sensor */
    if (slow.sense)
        return faulty('s') ? 0.5f : 12.0f;
    return current() > 0.0f ? arc_v + ripple : arc.arc ? 65.0f : 0.0f;
}

static float converted_voltage(void)
{
    uint32_t count = (uint32_t)(voltage() / (ARC_DIVIDER * VOLT_PER_COUNT) + 0.5f);
    return converter_voltage_v(faulty('v') ? CONVERTER_TOP : count);
}

void board_sample(waam_fast_inputs_t *now)
{
    follow_source();
    *now = (waam_fast_inputs_t){.valid = true, .voltage_v = converted_voltage(), .current_a = converted_current()};
    if (++hungry <= WATCHDOG_TICKS)
        return;
    board_safe();
    board_await_reset();
}

void board_arc(const waam_fast_outputs_t *outputs)
{
    if (outputs->late && arc.arc)
        say_number(hungry), say("fast ticks, then the arc went off\n");
    arc = *outputs;
    if (arc.late)
        slow.wire_mm_s = 0.0;
    if (faulty('x')) /* a bad address in an interrupt */
        *(reg_t *)0xA0000000u = 0;
    arc_ticks = arc.arc ? arc_ticks + 1 : 0;
}

void board_bus_init(void) { adxl345_device_start(&accelerometer); }

/* The sensor stands still. */
size_t board_bus_take(uint8_t *in)
{
    const int16_t at_rest[3] = {0, 0, WAAM_ADXL345_PER_G};
    size_t count = bus_bytes;
    accelerometer.torn_off = faulty('a');
    adxl345_device_run(&accelerometer, FAST_US, at_rest);
    if (count)
        adxl345_device_exchange(&accelerometer, bus, in, count);
    bus_bytes = 0;
    return count;
}

void board_bus_begin(const uint8_t *out, size_t count)
{
    for (bus_bytes = 0; bus_bytes < count; bus_bytes++)
        bus[bus_bytes] = out[bus_bytes];
}

void board_outputs(const waam_outputs_t *outputs) { slow = *outputs; }

void board_direction(unsigned axis, bool negative) { (void)axis, (void)negative; }

void board_inputs(waam_inputs_t *inputs)
{
    waam_config_t c = waam_config_default();
    int32_t at[STEP_AXES];
    steps_given(at);
    *inputs = (waam_inputs_t){.estop = faulty('e'), .limit_switch = faulty('l'), .gas_ok = slow.gas && !faulty('g'),
                              .process = faulty('p') ? WAAM_PROCESS_LOST : WAAM_PROCESS_OK,
                              .over_temperature = faulty('t'), .drive_fault = faulty('d'), .wire_mm_s = faulty('w') ? 0.0 : slow.wire_mm_s,
                              .current_a = (double)converted_current(), .part_v = converter_v(part_counts),
                              .voltage_v = (double)converted_voltage()};
    for (unsigned i = 0; i < WAAM_AXES; i++) {
        double mm = (double)start_mm[i] + (double)at[i] / c.steps_per_mm[i];
        inputs->home_switch[i] = c.home_direction[i] < 0 ? mm <= c.limit_min_mm[i] : mm >= c.limit_max_mm[i];
    }
}
