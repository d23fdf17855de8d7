#include "clock.h"

#include "registers.h"

#define PATIENCE 200000u /* reads of a status register: some 50 ms at the 16 MHz after reset */

static bool becomes(reg_t *reg, uint32_t mask, uint32_t value)
{
    for (uint32_t i = 0; i < PATIENCE; i++)
        if ((*reg & mask) == value)
            return true;
    return false;
}

/* (source / m) * 336 = 336 MHz; / 2 for the core, / 7 for USB. */
static bool run_pll(uint32_t m, bool crystal)
{
    RCC->PLLCFGR = m | 336u << 6 | 0u << 16 | (crystal ? 1u << 22 : 0u) | 7u << 24;
    RCC->CR |= RCC_PLLON;
    if (!becomes(&RCC->CR, RCC_PLLRDY, RCC_PLLRDY))
        return false;
    FLASH_ACR = 5u | 1u << 8 | 1u << 9 | 1u << 10; /* 5 wait states, prefetch, caches */
    RCC->CFGR = 2u | 5u << 10 | 4u << 13;          /* PLL, APB1 / 4, APB2 / 2 */
    return becomes(&RCC->CFGR, 3u << 2, 2u << 2);
}

bool clock_init(void)
{
    RCC->APB1ENR |= 1u << 28;
    PWR_CR |= 1u << 14; /* the core voltage that 168 MHz need */
    RCC->CR |= RCC_HSEON;
    bool crystal = becomes(&RCC->CR, RCC_HSERDY, RCC_HSERDY);
    bool runs = run_pll(crystal ? 8 : 16, crystal);
    if (crystal)
        RCC->CR |= RCC_CSSON; /* a crystal that stops later is a fault, and a fault is safe */
    return crystal && runs;
}
