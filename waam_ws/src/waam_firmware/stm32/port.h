/* The wire to the host: USART2 (port_serial.c) or the USB device (port_usb.c). */
#ifndef WAAM_STM32_PORT_H
#define WAAM_STM32_PORT_H

#include "queue.h"

void port_start(void);
/* From the main loop: moves what fits, both ways. Bytes that arrive are put into `received` while it has room.
 * True once when the host has gone (port closed, USB unplugged); what it had sent last is then forgotten. */
bool port_serve(queue_t *received, queue_t *send);

#endif
