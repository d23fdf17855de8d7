/* From reset to main, and the vector table. What has no handler is a fault (fault.c). */
#include "fault.h"
#include "registers.h"

extern uint32_t _stack_top, _data_load, _data_start, _data_end, _bss_start, _bss_end;
int main(void);
void reset_handler(void);
void TIM2_IRQHandler(void);
void TIM3_IRQHandler(void);
void PendSV_Handler(void);
/* where an image has none, the linker takes fault_handler */
void SysTick_Handler(void);
void USART1_IRQHandler(void);
void USART2_IRQHandler(void);

void reset_handler(void)
{
    uint32_t *to = &_data_start;
    SCB_CPACR |= 0xFu << 20; /* the floating-point unit, before anything uses it */
    barrier();
    fault_watch();
    /* cppcheck-suppress comparePointers ; the marks of the linker script are in one piece of memory */
    for (const uint32_t *from = &_data_load; to < &_data_end;)
        *to++ = *from++;
    /* cppcheck-suppress comparePointers ; likewise */
    for (to = &_bss_start; to < &_bss_end;)
        *to++ = 0;
    main();
    fault_handler();
}

typedef struct {
    uint32_t *stack;
    void (*exception[15])(void);
    void (*irq[IRQ_COUNT])(void);
} vectors_t;

__attribute__((section(".vectors"), used)) static const vectors_t vectors = {
    .stack = &_stack_top,
    .exception = {reset_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler,
                  fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, fault_handler, PendSV_Handler,
                  SysTick_Handler},
    .irq = {[0 ... IRQ_TIM2 - 1] = fault_handler, [IRQ_TIM2] = TIM2_IRQHandler, [IRQ_TIM3] = TIM3_IRQHandler,
            [IRQ_TIM3 + 1 ... IRQ_USART1 - 1] = fault_handler, [IRQ_USART1] = USART1_IRQHandler,
            [IRQ_USART2] = USART2_IRQHandler, [IRQ_USART2 + 1 ... IRQ_COUNT - 1] = fault_handler},
};
