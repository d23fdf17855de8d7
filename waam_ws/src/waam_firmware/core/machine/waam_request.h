/* An immediate line while it is answered, and who does what it asks for. */
#ifndef WAAM_REQUEST_H
#define WAAM_REQUEST_H

#include "waam_internal.h"

typedef struct {
    waam_core_t *core;
    waam_cursor_t args;
    char letter;
    bool has_token;
    uint32_t token;
    waam_code_t code; /* of the refusal */
    bool only_told;   /* nothing was done: the same token may ask again */
    waam_text_t answer;
} waam_request_t;

/* waam_request.c */
void waam_request_begin(waam_request_t *r); /* "$<letter>[@<token>] " */
void waam_request_refuse(waam_request_t *r, waam_code_t code, const char *text);
void waam_request_ok(waam_request_t *r);
/* Exactly `count` numbers and nothing more, or refused. */
bool waam_request_numbers(waam_request_t *r, double *values, int count);
/* Appends "<name>=<value>" of each; nothing is done by that. */
void waam_request_settings(waam_request_t *r, const waam_setting_t *settings, const void *from);

/* between host and controller (waam_session.c) */
void waam_order_identify(waam_request_t *r);
void waam_order_heartbeat(waam_request_t *r);
void waam_order_resync(waam_request_t *r);
void waam_order_telemetry_rate(waam_request_t *r);

/* to the machine (waam_orders.c) */
void waam_order_arm(waam_request_t *r);
void waam_order_disarm(waam_request_t *r);
void waam_order_jog(waam_request_t *r);
void waam_order_jog_wire(waam_request_t *r);
void waam_order_hold(waam_request_t *r);
void waam_order_resume(waam_request_t *r);
void waam_order_stop(waam_request_t *r);
void waam_order_override(waam_request_t *r);
void waam_order_work_offset(waam_request_t *r);
void waam_order_reset(waam_request_t *r);

/* settings (waam_configure.c) */
void waam_order_configure(waam_request_t *r);

/* accelerometer (waam_accelerometer.c) */
void waam_order_measure(waam_request_t *r);

#endif
