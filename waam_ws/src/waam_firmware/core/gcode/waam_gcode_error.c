/* What is wrong with a line, and where. */
#include "waam_words.h"

bool waam_fail(waam_error_t *error, waam_code_t code, size_t column, const char *text)
{
    error->code = code;
    error->column = column;
    waam_text_clear(&error->text);
    waam_text_add(&error->text, text);
    return false;
}

bool waam_fail_range(waam_error_t *error, const waam_setting_t *setting)
{
    waam_fail(error, WAAM_E_NUMBER, 1, setting->name);
    waam_setting_range(setting, &error->text);
    return false;
}

bool waam_fail_word(waam_error_t *error, waam_code_t code, size_t column, char letter, double number, const char *text)
{
    waam_fail(error, code, column, "");
    waam_text_char(&error->text, letter);
    waam_text_fixed(&error->text, number, 3);
    waam_text_add(&error->text, text);
    return false;
}
