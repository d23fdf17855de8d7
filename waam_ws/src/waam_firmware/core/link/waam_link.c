#include "waam_link.h"

#include "waam_grbl_dialect.h"
#include "waam_marlin_dialect.h"

void waam_link_init(waam_link_t *link) { *link = (waam_link_t){0}; }

bool waam_link_stock(const waam_link_t *link)
{
    return link->dialect == WAAM_DIALECT_MARLIN || link->dialect == WAAM_DIALECT_GRBL;
}

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

/* "N<number>" of a line whose check holds; Marlin senders count from where they like. */
static waam_rx_t with_number(waam_link_t *link)
{
    int64_t sequence;
    if (link->strong && link->check_digits != 10)
        return failed(link, WAAM_E_CHECK);
    if (!waam_marlin_number(link->line, link->length, &sequence))
        return failed(link, WAAM_E_SYNTAX);
    if (link->dialect != WAAM_DIALECT_NATIVE && waam_marlin_renumbers(link->line, link->length))
        return WAAM_RX_MARLIN;
    sequence += link->dialect == WAAM_DIALECT_MARLIN ? link->base : 0;
    if (link->dialect == WAAM_DIALECT_MARLIN && sequence < 1 && !link->blocked)
        return WAAM_RX_DUPLICATE;
    if (sequence < 1 || sequence > UINT32_MAX - 1)
        return failed(link, WAAM_E_SYNTAX);
    return numbered(link, (uint32_t)sequence);
}

/* A numbered M110, the one line with a check by which a Marlin sender says hello. */
static bool greets_in_marlin(const waam_link_t *link)
{
    int64_t number;
    return waam_marlin_number(link->line, link->length, &number) && waam_marlin_renumbers(link->line, link->length);
}

/* "$I" with a CRC: the host that the machine belongs to is back. */
static bool identifies(waam_link_t *link)
{
    size_t content;
    unsigned digits = waam_check_line(link->line, link->length, &content);
    if (digits < 5 || content < 2 || link->line[0] != '$' || link->line[1] != 'I')
        return false;
    link->check_digits = digits;
    link->length = content;
    return true;
}

/* Every line gets an answer, an empty one too, and in the order in which they came: so they all wait in the ring. */
static waam_rx_t unchecked(waam_link_t *link)
{
    bool too_long = link->overlong || link->length > WAAM_LINE_MAX;
    if (!too_long && identifies(link))
        return WAAM_RX_IMMEDIATE;
    if (too_long || link->length == 0) {
        link->line[0] = too_long ? WAAM_GRBL_TOO_LONG : ' ';
        link->length = 1;
    }
    if (link->blocked)
        return WAAM_RX_GRBL;
    if (waam_link_free_bytes(link) < link->length + 1)
        return WAAM_RX_OVERRUN;
    store(link);
    return WAAM_RX_QUEUED;
}

static waam_rx_t complete(waam_link_t *link)
{
    size_t content;
    if (link->length && link->line[link->length - 1] == '\r')
        link->length--;
    if (link->dialect == WAAM_DIALECT_GRBL)
        return unchecked(link);
    if (link->overlong || link->length > WAAM_LINE_MAX)
        return failed(link, WAAM_E_TOO_LONG);
    if (link->length == 0)
        return WAAM_RX_NONE;
    if (link->dialect == WAAM_DIALECT_OPEN && waam_grbl_asks(link->line, link->length))
        return WAAM_RX_GRBL;
    if (link->dialect != WAAM_DIALECT_NATIVE &&
        waam_marlin_unnumbered(link->line, link->length, link->dialect == WAAM_DIALECT_MARLIN))
        return WAAM_RX_MARLIN;
    link->check_digits = waam_check_line(link->line, link->length, &content);
    if (!link->check_digits)
        return failed(link, WAAM_E_CHECK);
    link->length = content;
    if (link->dialect == WAAM_DIALECT_OPEN && !greets_in_marlin(link))
        link->dialect = WAAM_DIALECT_NATIVE;
    return link->length && link->line[0] == '$' ? WAAM_RX_IMMEDIATE : with_number(link);
}

waam_rx_t waam_link_byte(waam_link_t *link, uint8_t byte)
{
    if (byte == '\n') {
        waam_rx_t result = complete(link);
        if (result != WAAM_RX_IMMEDIATE && result != WAAM_RX_MARLIN && result != WAAM_RX_GRBL)
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

void waam_link_put_back(waam_link_t *link, size_t length)
{
    link->ring_used += length + 1;
    link->ring_tail = (link->ring_tail + WAAM_RING_BYTES - length - 1) % WAAM_RING_BYTES;
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
