/* port_usb.c on a device that this file plays: bytes both ways, and what happens when the host goes. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "port.h"

static bool open_now;
static uint8_t from_host[256], to_host[4096];
static size_t waiting, sent, accepts = 7;

void waam_usb_start(const uint8_t *id);
bool waam_usb_poll(void);
size_t waam_usb_read(uint8_t *bytes, size_t size);
size_t waam_usb_write(const uint8_t *bytes, size_t size);

void waam_usb_start(const uint8_t *id) { (void)id; }
bool waam_usb_poll(void) { return open_now; }

size_t waam_usb_read(uint8_t *bytes, size_t size)
{
    size_t count = waiting < size ? waiting : size;
    memcpy(bytes, from_host, count);
    memmove(from_host, from_host + count, waiting -= count);
    return count;
}

size_t waam_usb_write(const uint8_t *bytes, size_t size)
{
    size_t count = size < accepts ? size : accepts;
    memcpy(to_host + sent, bytes, count);
    sent += count;
    return count;
}

static uint8_t received_bytes[128], send_bytes[64];
static queue_t received = {.bytes = received_bytes, .size = sizeof received_bytes};
static queue_t to_send = {.bytes = send_bytes, .size = sizeof send_bytes};

static void require(bool holds, const char *what)
{
    if (holds)
        return;
    printf("usb port: %s\n", what);
    exit(1);
}

static void host_sends(const char *text)
{
    memcpy(from_host + waiting, text, strlen(text));
    waiting += strlen(text);
}

static void hear(const char *text)
{
    for (; *text; text++) {
        uint8_t byte = 0;
        require(queue_get(&received, &byte) && byte == (uint8_t)*text, "bytes arrive as they were sent");
    }
    require(queue_used(&received) == 0, "and no others");
}

static void say(const char *text)
{
    for (; *text; text++)
        require(queue_put(&to_send, (uint8_t)*text), "room to send");
}

static void bytes_go_both_ways(void)
{
    open_now = true;
    for (int round = 0; round < 20; round++) { /* so that both rings go round */
        sent = 0;
        host_sends("N1 G1 X1*12345\n");
        say("ok N1 P63 B2048*54321\n");
        while (queue_used(&to_send))
            require(!port_serve(&received, &to_send), "the host is there");
        hear("N1 G1 X1*12345\n");
        require(sent == 22 && memcmp(to_host, "ok N1 P63 B2048*54321\n", sent) == 0, "answers arrive as they were given");
    }
}

static void a_full_queue_keeps_the_rest_with_the_host(void)
{
    for (int i = 0; i < 15; i++)
        host_sends("0123456789");
    port_serve(&received, &to_send);
    require(waiting + queue_used(&received) == 150 && waiting > 0, "what does not fit is not read");
    received.got = received.put;
    while (waiting) {
        port_serve(&received, &to_send);
        received.got = received.put;
    }
}

static void a_host_that_goes_is_told_once_and_forgotten(void)
{
    host_sends("N2 G1 X");
    say("! HOLD");
    open_now = false;
    require(port_serve(&received, &to_send), "the host has gone");
    require(queue_used(&received) == 0 && queue_used(&to_send) == 0, "nothing is kept for the next host");
    require(!port_serve(&received, &to_send), "it goes only once");
    open_now = true;
    require(!port_serve(&received, &to_send), "another one comes");
    host_sends("$I*1\n");
    port_serve(&received, &to_send);
    hear("$I*1\n");
}

int main(void)
{
    bytes_go_both_ways();
    a_full_queue_keeps_the_rest_with_the_host();
    a_host_that_goes_is_told_once_and_forgotten();
    printf("all properties hold\n");
    return 0;
}
