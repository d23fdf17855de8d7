#include "waam_link.h"

void waam_link_init(waam_link_t *link) { *link = (waam_link_t){0}; }

size_t waam_link_free_bytes(const waam_link_t *link) { return WAAM_RING_BYTES - link->ring_used; }

static void ring_put(waam_link_t *link, uint8_t byte)
{
    link->ring[(link->ring_tail + link->ring_used++) % WAAM_RING_BYTES] = byte;
}

static uint8_t ring_get(waam_link_t *link)
{
    uint8_t byte = link->ring[link->ring_tail];
    link->ring_tail = (link->ring_tail + 1) % WAAM_RING_BYTES;
    link->ring_used--;
    return byte;
}

static waam_rx_t resend(waam_link_t *link, waam_code_t code, uint32_t seen)
{
    link->gap_last = seen;
    link->resend_code = code;
    return WAAM_RX_RESEND;
}

/* A line that came too early. One request is enough for all lines that were under way; a number that does not grow shows
 * that the host has gone back and lost the line again. */
static waam_rx_t gap(waam_link_t *link, uint32_t sequence)
{
    if (link->gap_last && sequence > link->gap_last) {
        link->gap_last = sequence;
        return WAAM_RX_NONE;
    }
    return resend(link, WAAM_E_GAP, sequence);
}

static waam_rx_t refused_while_blocked(waam_link_t *link)
{
    bool told = link->told;
    link->told = true;
    return told ? WAAM_RX_NONE : WAAM_RX_BLOCKED;
}

/* The line waits; there is room for it. */
static void store(waam_link_t *link)
{
    ring_put(link, (uint8_t)link->length);
    for (size_t i = 0; i < link->length; i++)
        ring_put(link, (uint8_t)link->line[i]);
    link->received++;
    link->gap_last = 0;
}

static waam_rx_t numbered(waam_link_t *link, uint32_t sequence)
{
    if (link->blocked)
        return refused_while_blocked(link);
    if (sequence <= link->received)
        return WAAM_RX_DUPLICATE;
    if (sequence != link->received + 1)
        return gap(link, sequence);
    if (waam_link_free_bytes(link) < link->length + 1)
        return resend(link, WAAM_E_NOT_NOW, sequence);
    store(link);
    return WAAM_RX_QUEUED;
}

static waam_rx_t failed(waam_link_t *link, waam_code_t code)
{
    return link->blocked ? WAAM_RX_NONE : resend(link, code, link->received + 1);
}

/* "N<number>" of a line whose check holds. */
static waam_rx_t with_number(waam_link_t *link)
{
    waam_cursor_t cursor = {link->line, link->length, 1};
    uint64_t sequence;
    if (link->strong && link->check_digits != 10)
        return failed(link, WAAM_E_CHECK);
    if (link->length < 2 || (link->line[0] != 'N' && link->line[0] != 'n') || link->line[1] == ' ' ||
        !waam_read_uint(&cursor, &sequence) || sequence < 1 || sequence > UINT32_MAX - 1)
        return failed(link, WAAM_E_SYNTAX);
    return numbered(link, (uint32_t)sequence);
}

static waam_rx_t complete(waam_link_t *link)
{
    size_t content;
    if (link->length && link->line[link->length - 1] == '\r')
        link->length--;
    if (link->overlong || link->length > WAAM_LINE_MAX)
        return failed(link, WAAM_E_TOO_LONG);
    if (link->length == 0)
        return WAAM_RX_NONE;
    link->check_digits = waam_check_line(link->line, link->length, &content);
    if (!link->check_digits)
        return failed(link, WAAM_E_CHECK);
    link->length = content;
    link->known = true;
    return link->length && link->line[0] == '$' ? WAAM_RX_IMMEDIATE : with_number(link);
}

waam_rx_t waam_link_byte(waam_link_t *link, uint8_t byte)
{
    if (byte == '\n') {
        waam_rx_t result = complete(link);
        if (result != WAAM_RX_IMMEDIATE)
            link->length = 0;
        link->overlong = false;
        return result;
    }
    if (link->length < WAAM_LINE_MAX + 1)
        link->line[link->length++] = (char)byte;
    else
        link->overlong = true;
    return WAAM_RX_NONE;
}

size_t waam_link_next(waam_link_t *link, char *line)
{
    if (link->ring_used == 0)
        return 0;
    size_t length = ring_get(link);
    for (size_t i = 0; i < length; i++)
        line[i] = (char)ring_get(link);
    return length;
}

void waam_link_accept(waam_link_t *link) { link->accepted++; }

static void forget_waiting(waam_link_t *link)
{
    link->ring_used = 0;
    link->received = link->accepted;
    link->gap_last = 0;
}

void waam_link_block(waam_link_t *link, bool told)
{
    forget_waiting(link);
    link->blocked = true;
    link->told = told;
}

void waam_link_resync(waam_link_t *link, uint32_t next_line)
{
    link->accepted = next_line - 1;
    link->blocked = false;
    forget_waiting(link);
}
