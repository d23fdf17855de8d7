/* The real board: an STM32F407 with an 8 MHz crystal. Pins and scales are listed in the README of the package. */
#include <math.h>

#include "board.h"
#include "clock.h"
#include "converter.h"
#include "registers.h"

#define TIMER_HZ 84000000u
#define PWM_PERIOD 4200u      /* 84 MHz / 4200 = 20 kHz */
#define SOURCE_FULL_V 60.0f   /* source voltage at 10 V of setpoint */
#define WIRE_FULL_MM_S 300.0f /* wire speed at 10 V of setpoint */
#define CELSIUS_PER_V 200.0f  /* thermocouple amplifier, 5 mV/K from 0 */
#define ENCODER_PER_MM 40.0f
#define ENCODER_FILTER 0.05f  /* of each new millisecond: 20 ms */
#define STALE_MAX 10u         /* fast ticks without a new sample */

enum { PIN_ARC = 2, PIN_GAS = 3, PIN_DIRECTION = 4, PIN_DRIVES = 8, PIN_ALIVE = 10, PIN_SENSE = 12 }; /* port E */
enum { IN_ESTOP, IN_LIMIT, IN_GAS, IN_HOT, IN_DRIVE, IN_HOME_X, IN_HOME_Y, IN_HOME_Z, INPUTS };
static const uint8_t input_pin[INPUTS] = {0, 1, 2, 8, 9, 3, 6, 7}; /* port D */

const uint32_t board_pulse = TIMER_HZ / 400000u; /* 2.5 us: what common stepper drivers want */
static volatile uint16_t samples[4]; /* filled by DMA: arc current, arc voltage, temperatures of torch or drives, of the part */
static uint8_t history[INPUTS];
static volatile bool active[INPUTS];
static volatile uint32_t stale;
static volatile float current_a, voltage_v;
static uint16_t encoder_before;
static float wire_mm_s;

/* One write to the set/reset register: an interrupt that switches another pin of the port is not lost. */
static void set_pin(unsigned pin, bool on) { GPIOE->BSRR = 1u << (on ? pin : pin + 16); }

static void pin_mode(gpio_t *port, unsigned pin, unsigned mode, unsigned function)
{
    port->AFR[pin / 8] = (port->AFR[pin / 8] & ~(0xFu << pin % 8 * 4)) | function << pin % 8 * 4;
    port->MODER = (port->MODER & ~(3u << pin * 2)) | mode << pin * 2;
}

static void pins_init(void)
{
    enum { OUTPUT = 1, ALTERNATE = 2, ANALOG = 3 };
    board_safe();
    for (unsigned pin = PIN_ARC; pin <= PIN_DRIVES; pin++)
        pin_mode(GPIOE, pin, OUTPUT, 0);
    pin_mode(GPIOE, PIN_ALIVE, OUTPUT, 0);
    pin_mode(GPIOE, PIN_SENSE, OUTPUT, 0);
    for (unsigned i = 0; i < INPUTS; i++)
        GPIOD->PUPDR |= 1u << input_pin[i] * 2; /* an open contact reads 1 */
    pin_mode(GPIOA, 0, ANALOG, 0);
    pin_mode(GPIOA, 1, ANALOG, 0);
    pin_mode(GPIOA, 4, ANALOG, 0);
    pin_mode(GPIOC, 1, ANALOG, 0);
    pin_mode(GPIOA, 2, ALTERNATE, 7); /* USART2 */
    pin_mode(GPIOA, 3, ALTERNATE, 7);
    pin_mode(GPIOA, 11, ALTERNATE, 10); /* USB */
    pin_mode(GPIOA, 12, ALTERNATE, 10);
    GPIOA->OSPEEDR |= 3u << 22 | 3u << 24;
    for (unsigned pin = 6; pin <= 9; pin++)
        pin_mode(GPIOC, pin, ALTERNATE, 2); /* TIM3: steps */
    pin_mode(GPIOD, 12, ALTERNATE, 2);      /* TIM4: setpoints */
    pin_mode(GPIOD, 13, ALTERNATE, 2);
    pin_mode(GPIOE, 9, ALTERNATE, 1);       /* TIM1: encoder */
    pin_mode(GPIOE, 11, ALTERNATE, 1);
}

static void pwm_init(void)
{
    TIM4->ARR = PWM_PERIOD - 1;
    TIM4->CCMR1 = TIM_PWM_PAIR;
    TIM4->CCER = 0x11;
    TIM4->EGR = TIM_UG;
    TIM4->CR1 = TIM_CEN | TIM_ARPE;
}

static void encoder_init(void)
{
    TIM1->ARR = 0xFFFF;
    TIM1->CCMR1 = 0x3131; /* both inputs, filtered over 8 samples */
    TIM1->SMCR = 3;       /* counts every edge of both */
    TIM1->CR1 = TIM_CEN;
}

/* Four channels, started by TIM2 in every fast tick, 96 cycles of 21 MHz each; DMA stores them in a circle. */
static void adc_init(void)
{
    DMA2_STREAM0->PAR = (uint32_t)&ADC1->DR;
    DMA2_STREAM0->M0AR = (uint32_t)samples;
    DMA2_STREAM0->NDTR = 4;
    DMA2_STREAM0->CR = 1u << 13 | 1u << 11 | 1u << 10 | 1u << 8; /* 16 bit to 16 bit, increment, circular */
    DMA2_STREAM0->CR |= 1;
    ADC_CCR = 1u << 16;                /* 84 MHz / 4 */
    ADC1->SMPR2 = 4u | 4u << 3 | 4u << 12; /* 84 cycles */
    ADC1->SMPR1 = 4u << 3;
    ADC1->SQR1 = 3u << 20;             /* four conversions */
    ADC1->SQR3 = 0u | 1u << 5 | 4u << 10 | 11u << 15;
    ADC1->CR1 = 1u << 8;               /* scan */
    ADC1->CR2 = 1u | 1u << 8 | 1u << 9 | 6u << 24 | 1u << 28; /* on, DMA without end, rising edge of TIM2 */
}

/* Brown-out: the supply detector at 2.9 V raises an interrupt, which ends in the fault handler: outputs off while the
 * processor still works. False: the supply is too low now. */
static bool supply_detector_init(void)
{
    PWR_CR |= PWR_PVD_2V9 | PWR_PVDE;
    EXTI->IMR |= EXTI_PVD;
    EXTI->RTSR |= EXTI_PVD; /* rises when the supply falls */
    for (volatile uint32_t settle = 0; settle < 1000; settle++) {
    }
    EXTI->PR = EXTI_PVD;
    return !(PWR_CSR & PWR_PVDO);
}

bool board_init(void)
{
    bool good = clock_init() && (DBGMCU_IDCODE & 0xFFFu) == DEVICE_F405_F407;
    good = supply_detector_init() && good;
    RCC->AHB1ENR |= 1u << 0 | 1u << 2 | 1u << 3 | 1u << 4 | 1u << 22; /* ports A, C, D, E, DMA2 */
    RCC->AHB2ENR |= 1u << 6 | 1u << 7;                                /* random numbers, USB */
    RCC->APB1ENR |= 1u << 0 | 1u << 1 | 1u << 2 | 1u << 17;           /* TIM2, TIM3, TIM4, USART2 */
    RCC->APB2ENR |= 1u << 0 | 1u << 8;                                /* TIM1, ADC1 */
    SCB_DEMCR |= 1u << 24;
    DWT_CTRL |= 1;
    pins_init();
    pwm_init();
    encoder_init();
    adc_init();
    board_bus_init();
    return good;
}

static void start_timer(tim_t *timer, unsigned irq, uint32_t hz, uint8_t priority)
{
    timer->ARR = TIMER_HZ / hz - 1;
    timer->EGR = TIM_UG;
    timer->SR = 0;
    timer->DIER = TIM_UIE;
    irq_enable(irq, priority);
    timer->CR1 = TIM_CEN | TIM_ARPE;
}

void board_start_timers(void)
{
    TIM3->CCMR1 = TIM3->CCMR2 = TIM_PWM_PAIR;
    TIM3->CCER = TIM_ALL_CHANNELS;
    TIM2->CR2 = TIM_UPDATE_TRIGGERS; /* the converter */
    start_timer(TIM3, IRQ_TIM3, STEP_HZ, 0);
    start_timer(TIM2, IRQ_TIM2, FAST_HZ, 2);
}

void board_start_watchdog(void)
{
    DBGMCU_APB1_FZ |= 1u << 12; /* stands still while a debugger has stopped the core */
    IWDG->KR = 0x5555;
    IWDG->PR = 4;               /* 32 kHz / 64 */
    IWDG->RLR = 250;            /* 500 ms; the oscillator allows 340 to 940 ms */
    IWDG->KR = 0xCCCC;
    irq_enable(IRQ_PVD, 0); /* its handler waits for the watchdog */
}

void board_ranges(waam_config_t *config) { converter_ranges(&config->monitor); }

void board_feed_watchdog(void)
{
    static bool alive;
    alive = !alive;
    IWDG->KR = 0xAAAA;
    set_pin(PIN_ALIVE, alive); /* a safety relay may watch it */
}

void board_idle(void) { wait_for_interrupt(); }

void board_safe(void)
{
    GPIOE->BSRR = (1u << PIN_ARC | 1u << PIN_GAS | 1u << PIN_DRIVES | 1u << PIN_SENSE) << 16;
    TIM4->CCR[0] = TIM4->CCR[1] = 0;
    TIM3->CCER = 0;
}

void board_await_reset(void)
{
    for (;;) {
    }
}

bool board_was_hung(void)
{
    bool watchdog = RCC->CSR & 1u << 29;
    RCC->CSR |= 1u << 24; /* forget the causes */
    return watchdog;
}

uint32_t board_boot_id(void)
{
    static uint32_t starts __attribute__((section(".noinit"))); /* kept over a reset, arbitrary at power-on */
    uint32_t id = ++starts;
    RNG->CR = 1u << 2;
    for (unsigned i = 0; i < 100000; i++)
        if (RNG->SR & 1u)
            return RNG->DR ^ id;
    return id;
}

uint32_t board_clock(void) { return DWT_CYCCNT; }

/* A contact counts when it has been the same four times running. */
static void sample_contacts(void)
{
    uint32_t port = GPIOD->IDR;
    for (unsigned i = 0; i < INPUTS; i++) {
        history[i] = (uint8_t)(history[i] << 1 | (port >> input_pin[i] & 1u)) & 0xFu;
        active[i] = history[i] == 0xFu || (history[i] && active[i]);
    }
}

void board_sample(waam_fast_inputs_t *now)
{
    bool fresh = DMA2_LISR & 1u << 5;
    sample_contacts();
    stale = fresh ? 0 : stale < STALE_MAX ? stale + 1 : STALE_MAX;
    DMA2_LIFCR = 1u << 5;
    current_a = converter_current_a(samples[0]);
    voltage_v = converter_voltage_v(samples[1]);
    *now = (waam_fast_inputs_t){.valid = stale < STALE_MAX, .voltage_v = voltage_v, .current_a = current_a};
}

static void read_encoder(void)
{
    uint16_t now = (uint16_t)TIM1->CNT;
    float speed = (float)(int16_t)(now - encoder_before) * (1e6f / (TICK_US * ENCODER_PER_MM));
    encoder_before = now;
    wire_mm_s += ENCODER_FILTER * (speed - wire_mm_s);
}

void board_inputs(waam_inputs_t *inputs)
{
    read_encoder();
    *inputs = (waam_inputs_t){
        .estop = active[IN_ESTOP], .limit_switch = active[IN_LIMIT], .gas_ok = !active[IN_GAS],
        .home_switch = {active[IN_HOME_X], active[IN_HOME_Y], active[IN_HOME_Z]},
        .process = stale < STALE_MAX ? WAAM_PROCESS_OK : WAAM_PROCESS_LOST,
        .current_a = (double)current_a, .voltage_v = (double)voltage_v, .wire_mm_s = (double)wire_mm_s,
        .over_temperature = active[IN_HOT], .drive_fault = active[IN_DRIVE],
        .temperature_c = (double)((float)samples[2] * (VOLT_PER_COUNT * CELSIUS_PER_V)),
        .part_v = stale < STALE_MAX ? converter_v(samples[3]) : NAN,
    };
}

static uint32_t duty(float share)
{
    return share <= 0.0f ? 0 : share >= 1.0f ? PWM_PERIOD : (uint32_t)(share * PWM_PERIOD);
}

void board_arc(const waam_fast_outputs_t *outputs)
{
    set_pin(PIN_ARC, outputs->arc);
    if (outputs->late)
        TIM4->CCR[0] = 0; /* the feeder: the tick that would stop it does not come */
    TIM4->CCR[1] = outputs->arc ? duty(outputs->voltage_v / SOURCE_FULL_V) : 0;
}

void board_outputs(const waam_outputs_t *outputs)
{
    set_pin(PIN_DRIVES, outputs->drives);
    set_pin(PIN_GAS, outputs->gas);
    set_pin(PIN_SENSE, outputs->sense);
    TIM4->CCR[0] = duty((float)outputs->wire_mm_s / WIRE_FULL_MM_S);
}

void board_direction(unsigned axis, bool negative)
{
    set_pin(PIN_DIRECTION + axis, !negative);
}
