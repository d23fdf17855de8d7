/* Lines, checks and sequence numbers (docs/link_protocol.md). Knows nothing of G-code. */
#ifndef WAAM_LINK_H
#define WAAM_LINK_H

#include "waam_text.h"

typedef enum {
    WAAM_RX_NONE,      /* no line is complete, or it was dealt with by the link itself */
    WAAM_RX_IMMEDIATE, /* link.line holds the content of a '$' line */
    WAAM_RX_QUEUED,    /* a new line waits in the ring */
    WAAM_RX_DUPLICATE, /* acknowledge again */
    WAAM_RX_RESEND,    /* ask for link.resend_code */
    WAAM_RX_BLOCKED    /* the first line that came while nothing is accepted: say so, once */
} waam_rx_t;

typedef struct {
    char line[WAAM_LINE_MAX + 2];
    size_t length;              /* of the line being received, then of its content */
    bool overlong;
    uint8_t ring[WAAM_RING_BYTES];
    size_t ring_tail, ring_used;
    uint32_t received;          /* last line number in the ring */
    uint32_t accepted;          /* last line number in the planner queue */
    uint32_t gap_last;          /* last number seen after a resend was asked for; 0 = none asked */
    bool blocked;               /* after an error, a stop or an alarm: nothing is accepted until resynchronised */
    bool told;                  /* ... and the host has been told so */
    waam_code_t resend_code;
    bool known;                 /* a line with a good check has come since the other end was gone */
    bool strong;                /* the host identified itself with a CRC-32: numbered lines need one too */
    unsigned check_digits;      /* of the last good line: 5 CRC-16, 10 CRC-32 */
} waam_link_t;

/* Nothing was received; the next line is number 1. */
void waam_link_init(waam_link_t *link);
/* One byte of the stream. Pairs of real-time bytes must have been taken out before. */
waam_rx_t waam_link_byte(waam_link_t *link, uint8_t byte);
/* Oldest waiting line into `line` (WAAM_LINE_MAX bytes); 0 when none waits. It counts as accepted by waam_link_accept. */
size_t waam_link_next(waam_link_t *link, char *line);
/* The line that was just taken is in the planner queue. */
void waam_link_accept(waam_link_t *link);
/* Forgets the lines that wait and takes no others until waam_link_resync. `told`: the host knows already. */
void waam_link_block(waam_link_t *link, bool told);
/* Takes lines again, the next one being `next_line`; those that wait are forgotten. */
void waam_link_resync(waam_link_t *link, uint32_t next_line);
/* Of the ring of waiting lines. */
size_t waam_link_free_bytes(const waam_link_t *link);

#endif
