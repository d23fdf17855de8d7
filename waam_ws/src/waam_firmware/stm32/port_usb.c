/* The link over USB: the CDC-ACM device of usb/ (Rust), polled by the main loop. While there is no room for what the host
 * sends, its packets are refused and the host keeps them. */
#include "port.h"

#include <stddef.h>

#define CHIP_ID ((const uint8_t *)0x1FFF7A10u)

void waam_usb_start(const uint8_t *id);
bool waam_usb_poll(void);
size_t waam_usb_read(uint8_t *bytes, size_t size);
size_t waam_usb_write(const uint8_t *bytes, size_t size);

void port_start(void) { waam_usb_start(CHIP_ID); }

static void receive(queue_t *received)
{
    uint8_t bytes[64];
    size_t count;
    while (queue_free(received) >= sizeof bytes && (count = waam_usb_read(bytes, sizeof bytes)) > 0)
        for (size_t i = 0; i < count; i++)
            queue_put(received, bytes[i]);
}

/* As far as the end of the ring; the rest comes with the next round. */
static void transmit(queue_t *send)
{
    uint32_t at = send->got & (send->size - 1), used = queue_used(send), to_end = send->size - at;
    if (used)
        send->got += (uint32_t)waam_usb_write(send->bytes + at, used < to_end ? used : to_end);
}

/* While nobody listens nothing is kept for later: a host that comes identifies first. */
bool port_serve(queue_t *received, queue_t *send)
{
    static bool was_open;
    bool open = waam_usb_poll(), gone = was_open && !open;
    was_open = open;
    receive(received);
    if (open) {
        transmit(send);
        return false;
    }
    send->got = send->put;
    received->got = received->put;
    return gone;
}
