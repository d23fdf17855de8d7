/* Immediate lines: "$<letter>[@<token>] <args>", answered at once with the same letter and token. */
#include "waam_request.h"

static const struct {
    char letter;
    void (*handle)(waam_request_t *);
} table[] = {
    {'I', waam_order_identify},
    {'H', waam_order_heartbeat},
    {'A', waam_order_arm},
    {'D', waam_order_disarm},
    {'J', waam_order_jog},
    {'W', waam_order_jog_wire},
    {'P', waam_order_hold},
    {'R', waam_order_resume},
    {'S', waam_order_stop},
    {'V', waam_order_override},
    {'Z', waam_order_work_offset},
    {'X', waam_order_reset},
    {'L', waam_order_resync},
    {'T', waam_order_telemetry_rate},
    {'C', waam_order_configure},
    {'M', waam_order_measure},
};

/* ---- tokens ---- */

/* "@<token>" after the letter; false when there is something else than a blank. */
static bool read_token(waam_request_t *r)
{
    uint64_t token;
    if (r->args.length <= 2 || r->args.text[2] == ' ')
        return true;
    if (r->args.text[2] != '@' || r->args.length < 4 || r->args.text[3] == ' ')
        return false;
    r->args.at = 3;
    if (!waam_read_uint(&r->args, &token) || token > UINT32_MAX)
        return false;
    r->token = (uint32_t)token;
    r->has_token = true;
    return r->args.at >= r->args.length || r->args.text[r->args.at] == ' ';
}

/* What was done is answered again and not done again; a heartbeat and an identification may be done twice. */
static bool repeated(waam_request_t *r)
{
    waam_core_t *core = r->core;
    uint32_t kept = core->recent_count < WAAM_RECENT ? core->recent_count : WAAM_RECENT;
    for (uint32_t i = 0; r->has_token && i < kept; i++) {
        const waam_recent_t *done = &core->recent[i];
        if (done->token != r->token || done->letter != r->letter)
            continue;
        if (done->code)
            waam_request_refuse(r, done->code, "refused already");
        else
            waam_request_ok(r);
        return true;
    }
    return false;
}

static void remember(const waam_request_t *r)
{
    waam_core_t *core = r->core;
    if (!r->has_token || r->letter == 'I' || r->only_told)
        return;
    core->recent[core->recent_count % WAAM_RECENT] = (waam_recent_t){r->token, r->letter, r->code};
    if (++core->recent_count == 2 * WAAM_RECENT)
        core->recent_count = WAAM_RECENT; /* all are in use, and the count never wraps */
}

static void answer(waam_request_t *r)
{
    size_t i = 0, count = sizeof table / sizeof table[0];
    bool token_good = read_token(r);
    while (i < count && table[i].letter != r->letter)
        i++;
    waam_request_begin(r);
    if (i == count || !token_good) {
        r->letter = '?';
        waam_request_refuse(r, WAAM_E_UNKNOWN_WORD, "not a command of this controller");
    } else if (!repeated(r)) {
        table[i].handle(r);
        remember(r);
    }
}

void waam_core_immediate(waam_core_t *core, const char *line, size_t length)
{
    waam_request_t r = {.core = core, .args = {line, length, 2}, .letter = length > 1 ? line[1] : '?'};
    answer(&r);
    if (r.letter != 'H')
        waam_core_stamp(core, &r.answer);
    waam_text_seal(&r.answer, core->link.strong);
    core->send(core->context, r.answer.text, r.answer.length, WAAM_TX_ASSURED);
}
