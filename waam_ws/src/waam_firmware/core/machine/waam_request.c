/* The answer to an immediate line. */
#include "waam_request.h"

void waam_request_begin(waam_request_t *r)
{
    waam_text_clear(&r->answer);
    waam_text_char(&r->answer, '$');
    waam_text_char(&r->answer, r->letter);
    if (r->has_token) {
        waam_text_char(&r->answer, '@');
        waam_text_uint(&r->answer, r->token);
    }
    waam_text_char(&r->answer, ' ');
}

void waam_request_refuse(waam_request_t *r, waam_code_t code, const char *text)
{
    waam_request_begin(r);
    r->code = code;
    waam_text_add(&r->answer, "error E");
    waam_text_uint(&r->answer, code);
    waam_text_char(&r->answer, ' ');
    waam_text_add(&r->answer, text);
}

void waam_request_ok(waam_request_t *r) { waam_text_add(&r->answer, "ok"); }

bool waam_request_numbers(waam_request_t *r, double *values, int count)
{
    for (int i = 0; i < count; i++)
        if (!waam_read_number(&r->args, &values[i]))
            return waam_request_refuse(r, WAAM_E_MISSING_WORD, "a number is missing or malformed"), false;
    if (!waam_at_end(&r->args))
        return waam_request_refuse(r, WAAM_E_SYNTAX, "too many arguments"), false;
    return true;
}

void waam_request_settings(waam_request_t *r, const waam_setting_t *settings, const void *from)
{
    r->only_told = true;
    for (; settings->name; settings++) {
        if (r->answer.text[r->answer.length - 1] != ' ')
            waam_text_char(&r->answer, ' ');
        waam_text_add(&r->answer, settings->name);
        waam_text_char(&r->answer, '=');
        waam_text_fixed(&r->answer, waam_setting_get(settings, from), 4);
    }
}
