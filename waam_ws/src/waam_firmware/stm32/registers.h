/* Registers of the STM32F407 that the firmware uses, after the reference manual RM0090 and the Cortex-M4 manual. */
#ifndef WAAM_STM32_REGISTERS_H
#define WAAM_STM32_REGISTERS_H

#include <stdint.h>

typedef volatile uint32_t reg_t;

/* ---- core: NVIC, SCB, DWT ---- */
#define NVIC_ISER ((reg_t *)0xE000E100u)
#define NVIC_ISPR ((reg_t *)0xE000E200u)
#define NVIC_IPR ((volatile uint8_t *)0xE000E400u)
#define SCB_CPACR (*(reg_t *)0xE000ED88u)
#define SCB_ICSR (*(reg_t *)0xE000ED04u)
#define SCB_AIRCR (*(reg_t *)0xE000ED0Cu)
#define SCB_SHPR3 (*(reg_t *)0xE000ED20u)
#define SCB_SHCSR (*(reg_t *)0xE000ED24u)
#define SCB_CFSR (*(reg_t *)0xE000ED28u)
#define SCB_HFSR (*(reg_t *)0xE000ED2Cu)
#define SCB_MMFAR (*(reg_t *)0xE000ED34u)
#define SCB_BFAR (*(reg_t *)0xE000ED38u)
#define MPU_CTRL (*(reg_t *)0xE000ED94u)
#define MPU_RNR (*(reg_t *)0xE000ED98u)
#define MPU_RBAR (*(reg_t *)0xE000ED9Cu)
#define MPU_RASR (*(reg_t *)0xE000EDA0u)
#define SCB_DEMCR (*(reg_t *)0xE000EDFCu)
#define DWT_CTRL (*(reg_t *)0xE0001000u)
#define DWT_CYCCNT (*(reg_t *)0xE0001004u)
#define DBGMCU_IDCODE (*(reg_t *)0xE0042000u)
#define DBGMCU_APB1_FZ (*(reg_t *)0xE0042008u)
#define DEVICE_F405_F407 0x413u

#define SCB_ICSR_NMIPENDSET (1u << 31)
#define SCB_ICSR_PENDSVSET (1u << 28)
#define SCB_AIRCR_RESET 0x05FA0004u
#define SCB_SHCSR_FAULTS (7u << 16)                     /* memory, bus and usage faults have handlers of their own */
#define SCB_CFSR_STACKING (1u << 4 | 1u << 5 | 1u << 12 | 1u << 13) /* M(L)STKERR, MLSPERR, STKERR, LSPERR */
#define SCB_CFSR_MMARVALID (1u << 7)
#define SCB_CFSR_BUS (0xFFu << 8)
#define SCB_CFSR_BFARVALID (1u << 15)
#define SCB_CFSR_UNDEFINSTR (1u << 16)
#define MPU_CTRL_ENABLE 1u
#define MPU_CTRL_PRIVDEFENA (1u << 2)
#define MPU_RASR_ENABLE 1u
#define MPU_RASR_XN (1u << 28)

enum { IRQ_PVD = 1, IRQ_TIM2 = 28, IRQ_TIM3 = 29, IRQ_USART1 = 37, IRQ_USART2 = 38, IRQ_COUNT = 82 };

/* ---- reset and clocks ---- */
typedef struct {
    reg_t CR, PLLCFGR, CFGR, CIR, AHB1RSTR, AHB2RSTR, AHB3RSTR, reserved0, APB1RSTR, APB2RSTR, reserved1[2];
    reg_t AHB1ENR, AHB2ENR, AHB3ENR, reserved2, APB1ENR, APB2ENR, reserved3[2];
    reg_t AHB1LPENR, AHB2LPENR, AHB3LPENR, reserved4, APB1LPENR, APB2LPENR, reserved5[2], BDCR, CSR;
} rcc_t;
#define RCC ((rcc_t *)0x40023800u)
enum { RCC_HSEON = 1u << 16, RCC_HSERDY = 1u << 17, RCC_CSSON = 1u << 19, RCC_PLLON = 1u << 24, RCC_PLLRDY = 1u << 25 };
#define FLASH_ACR (*(reg_t *)0x40023C00u)
#define PWR_CR (*(reg_t *)0x40007000u)
#define PWR_CSR (*(reg_t *)0x40007004u)
enum { PWR_PVDE = 1u << 4, PWR_PVD_2V9 = 7u << 5, PWR_PVDO = 1u << 2 };
typedef struct {
    reg_t IMR, EMR, RTSR, FTSR, SWIER, PR;
} exti_t;
#define EXTI ((exti_t *)0x40013C00u)
enum { EXTI_PVD = 1u << 16 };

/* ---- pins ---- */
typedef struct {
    reg_t MODER, OTYPER, OSPEEDR, PUPDR, IDR, ODR, BSRR, LCKR, AFR[2];
} gpio_t;
#define GPIOA ((gpio_t *)0x40020000u)
#define GPIOB ((gpio_t *)0x40020400u)
#define GPIOC ((gpio_t *)0x40020800u)
#define GPIOD ((gpio_t *)0x40020C00u)
#define GPIOE ((gpio_t *)0x40021000u)

/* ---- timers ---- */
typedef struct {
    reg_t CR1, CR2, SMCR, DIER, SR, EGR, CCMR1, CCMR2, CCER, CNT, PSC, ARR, RCR, CCR[4], BDTR;
} tim_t;
#define TIM1 ((tim_t *)0x40010000u)
#define TIM2 ((tim_t *)0x40000000u)
#define TIM3 ((tim_t *)0x40000400u)
#define TIM4 ((tim_t *)0x40000800u)
#define TIM5 ((tim_t *)0x40000C00u)
enum { TIM_UPDATE_TRIGGERS = 2u << 4, TIM_CEN = 1u, TIM_ARPE = 1u << 7, TIM_UIE = 1u, TIM_UG = 1u };
#define TIM_PWM_PAIR 0x6868u /* CCMR: both channels in PWM mode 1 with preload */
#define TIM_ALL_CHANNELS 0x1111u

/* ---- serial ---- */
typedef struct {
    reg_t SR, DR, BRR, CR1, CR2, CR3;
} usart_t;
#define USART1 ((usart_t *)0x40011000u)
#define USART2 ((usart_t *)0x40004400u)
enum { USART_RXNE = 1u << 5, USART_TXE = 1u << 7, USART_RE = 1u << 2, USART_TE = 1u << 3, USART_RXNEIE = 1u << 5,
       USART_UE = 1u << 13, USART_OVER8 = 1u << 15 };

/* ---- analog to digital ---- */
typedef struct {
    reg_t SR, CR1, CR2, SMPR1, SMPR2, JOFR[4], HTR, LTR, SQR1, SQR2, SQR3, JSQR, JDR[4], DR;
} adc_t;
#define ADC1 ((adc_t *)0x40012000u)
#define ADC_CCR (*(reg_t *)0x40012304u)
enum { ADC_OVR = 1u << 5 };
typedef struct {
    reg_t CR, NDTR, PAR, M0AR, M1AR, FCR;
} dma_stream_t;
#define DMA2_LISR (*(reg_t *)0x40026400u)
#define DMA2_LIFCR (*(reg_t *)0x40026408u)
#define DMA2_STREAM0 ((dma_stream_t *)0x40026410u)
#define DMA1_LISR (*(reg_t *)0x40026000u)
#define DMA1_LIFCR (*(reg_t *)0x40026008u)
#define DMA1_HIFCR (*(reg_t *)0x4002600Cu)
#define DMA1_STREAM3 ((dma_stream_t *)0x40026058u)
#define DMA1_STREAM4 ((dma_stream_t *)0x40026070u)
enum { DMA_ENABLE = 1u, DMA_TO_DEVICE = 1u << 6, DMA_INCREMENT = 1u << 10, DMA_STREAM3_COMPLETE = 1u << 27,
       DMA_STREAM3_FLAGS = 0x3Du << 22, DMA_STREAM4_FLAGS = 0x3Du };

/* ---- serial peripheral interface ---- */
typedef struct {
    reg_t CR1, CR2, SR, DR;
} spi_t;
#define SPI2 ((spi_t *)0x40003800u)
enum { SPI_CPHA = 1u, SPI_CPOL = 1u << 1, SPI_MASTER = 1u << 2, SPI_DIVIDE_16 = 3u << 3, SPI_SPE = 1u << 6, SPI_SSI = 1u << 8,
       SPI_SSM = 1u << 9, SPI_RXDMAEN = 1u, SPI_TXDMAEN = 1u << 1 };

/* ---- watchdog and random numbers ---- */
typedef struct {
    reg_t KR, PR, RLR, SR;
} iwdg_t;
#define IWDG ((iwdg_t *)0x40003000u)
typedef struct {
    reg_t CR, SR, DR;
} rng_t;
#define RNG ((rng_t *)0x50060800u)

static inline void irq_enable(unsigned irq, uint8_t priority)
{
    NVIC_IPR[irq] = (uint8_t)(priority << 4);
    NVIC_ISER[irq / 32] = 1u << (irq % 32);
}
static inline uint32_t exception_number(void)
{
    uint32_t number;
    __asm__ volatile("mrs %0, ipsr" : "=r"(number));
    return number;
}
static inline void interrupts_off(void) { __asm__ volatile("cpsid i" ::: "memory"); }
static inline void interrupts_on(void) { __asm__ volatile("cpsie i" ::: "memory"); }
static inline void wait_for_interrupt(void) { __asm__ volatile("wfi" ::: "memory"); }
static inline void barrier(void) { __asm__ volatile("dsb\n isb" ::: "memory"); }

#endif
