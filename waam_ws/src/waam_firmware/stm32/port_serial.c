/* The link on USART2 (PA2, PA3), which ST-Link adapters offer to the host as a serial port. 921600 baud, 8N1.
 * Reception is by interrupt; sending is polled by the main loop, which is idle but for the tick. */
#include "board.h"
#include "load.h"
#include "port.h"
#include "registers.h"

#define APB1_HZ 42000000u
#define BAUD 921600u

static uint8_t buffer[4096];
static queue_t arrived = QUEUE(buffer);

void port_start(void)
{
    uint32_t divider = (2 * APB1_HZ + BAUD / 2) / BAUD; /* in eighths, for 8-fold oversampling */
    USART2->BRR = (divider & ~7u) << 1 | (divider & 7u);
    USART2->CR1 = USART_UE | USART_OVER8 | USART_RE | USART_TE | USART_RXNEIE;
    irq_enable(IRQ_USART2, 1);
}

void USART2_IRQHandler(void)
{
    uint32_t begun = load_begin(LOAD_LINK);
    if (USART2->SR & USART_RXNE)
        queue_put(&arrived, (uint8_t)USART2->DR); /* a full queue loses bytes; the check of the line finds it */
    else
        (void)USART2->DR; /* clears an overrun */
    load_end(LOAD_LINK, begun);
}

/* Nobody can tell from the wires whether the host is still there: the link watchdog does. */
bool port_serve(queue_t *received, queue_t *send)
{
    uint8_t byte;
    while (queue_free(received) && queue_get(&arrived, &byte))
        queue_put(received, byte);
    while (USART2->SR & USART_TXE && queue_get(send, &byte))
        USART2->DR = byte;
    return false;
}
