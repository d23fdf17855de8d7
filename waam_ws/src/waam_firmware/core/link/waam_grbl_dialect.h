/* Lines of GRBL senders (Universal Gcode Sender, bCNC, LaserGRBL): no numbers and no checks, one answer for each. Pure. */
#ifndef WAAM_GRBL_DIALECT_H
#define WAAM_GRBL_DIALECT_H

#include "waam_text.h"

#define WAAM_GRBL_RX 1024 /* bytes that a sender may have under way: half of the ring, for an empty line takes two there */
#define WAAM_GRBL_TOO_LONG '\x01' /* content that stands for a line that did not fit */

/* Real-time bytes: they act at once, also within a line, and belong to none. */
typedef enum {
    WAAM_GRBL_RESET = 0x18,
    WAAM_GRBL_HOLD = '!',
    WAAM_GRBL_STATUS = '?',
    WAAM_GRBL_RESUME = '~',
    WAAM_GRBL_DOOR = 0x84,
    WAAM_GRBL_JOG_CANCEL = 0x85,
    WAAM_GRBL_FEED_100 = 0x90,
    WAAM_GRBL_FEED_UP_10,
    WAAM_GRBL_FEED_DOWN_10,
    WAAM_GRBL_FEED_UP_1,
    WAAM_GRBL_FEED_DOWN_1,
    WAAM_GRBL_OVERRIDE_LAST = 0x9F /* of travel, spindle and coolant; they are passed over */
} waam_grbl_byte_t;

/* Is this a question by which such a sender may say hello? None of them moves anything: $ $$ $# $G $I $N. */
bool waam_grbl_asks(const char *line, size_t length);
/* Column from 1 of the first word that is about arc or wire (M3 M4 M82 M83 W E), 0 = there is none. */
size_t waam_grbl_arc_word(const char *line, size_t length);
/* Numbers of "error:<n>" and "ALARM:<n>" as GRBL 1.1 has them. */
unsigned waam_grbl_error(waam_code_t code);
unsigned waam_grbl_alarm(waam_code_t code);

#endif
