/* The link alone, against a model of its own: what is taken out is what was put in, in order, each line once. One record per
 * line of the input, chosen by its first byte:
 *
 *     s S x<text>  sealed with CRC-16, CRC-32 or XOR-8          n<text>  the same (CRC-32), after the number that is expected
 *     p            take the oldest line out and accept it      b        refuse it: nothing more until resynchronised
 *     r<digits>    resynchronise                               i        identified with a CRC-32, as a native host
 *     other        the bytes as they are, with the line feed
 */
#include <string.h>

#include "fuzz.h"
#include "waam_link.h"

#define MODEL_LINES 2048u

typedef struct {
    waam_link_t link;
    char line[MODEL_LINES][WAAM_LINE_MAX];
    uint8_t length[MODEL_LINES];
    unsigned put, got;          /* lines of the model */
    char fed[WAAM_LINE_MAX];    /* content of the line that is being fed */
    size_t fed_length;
} rig_t;

static rig_t rig;

static void queued(uint32_t before)
{
    REQUIRE(!rig.link.blocked, "nothing is queued before the host resynchronises");
    REQUIRE(rig.link.received == before + 1, "numbers count up by one");
    REQUIRE(rig.put - rig.got < MODEL_LINES, "the ring holds no more lines than bytes");
    memcpy(rig.line[rig.put % MODEL_LINES], rig.fed, rig.fed_length);
    rig.length[rig.put++ % MODEL_LINES] = (uint8_t)rig.fed_length;
}

static void require_link(uint32_t received_before, waam_rx_t result)
{
    const waam_link_t *l = &rig.link;
    REQUIRE(l->ring_used <= WAAM_RING_BYTES && l->ring_tail < WAAM_RING_BYTES, "ring");
    REQUIRE(l->length <= WAAM_LINE_MAX + 1, "line buffer");
    REQUIRE(l->received - l->accepted == rig.put - rig.got, "waiting lines");
    REQUIRE(result == WAAM_RX_QUEUED || l->received == received_before, "only a queued line counts");
    REQUIRE(result != WAAM_RX_RESEND || (l->resend_code >= WAAM_E_CHECK && l->resend_code <= WAAM_E_NOT_NOW), "code");
    REQUIRE(result != WAAM_RX_RESEND || !l->blocked, "no resend is asked for while blocked");
}

static void feed_byte(uint8_t byte)
{
    uint32_t before = rig.link.received;
    waam_rx_t result = waam_link_byte(&rig.link, byte);
    if (result == WAAM_RX_QUEUED)
        queued(before);
    if (result == WAAM_RX_IMMEDIATE || result == WAAM_RX_MARLIN)
        rig.link.length = 0;
    require_link(before, result);
}

static void feed(const char *bytes, size_t count)
{
    for (size_t i = 0; i < count; i++)
        feed_byte((uint8_t)bytes[i]);
    feed_byte('\n');
}

/* With the content known to the model, in case that the line is queued. */
static void feed_line(const char *line, size_t count)
{
    size_t star = count;
    while (star && line[star - 1] != '*')
        star--;
    rig.fed_length = star ? star - 1 : count;
    rig.fed_length = rig.fed_length < WAAM_LINE_MAX ? rig.fed_length : WAAM_LINE_MAX;
    memcpy(rig.fed, line, rig.fed_length);
    if (rig.link.length)
        feed("", 0); /* the rest of what came before */
    feed(line, count);
}

static void feed_sealed(char how, const char *text, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_bytes(&line, text, count < WAAM_LINE_MAX - 12 ? count : WAAM_LINE_MAX - 12);
    if (how != 'x') {
        waam_text_seal(&line, how == 'S');
        feed_line(line.text, line.length - 1);
        return;
    }
    unsigned parity = 0;
    for (size_t i = 0; i < line.length; i++)
        parity ^= (uint8_t)line.text[i];
    waam_text_char(&line, '*');
    waam_text_uint(&line, parity);
    feed_line(line.text, line.length);
}

static void feed_next(const char *text, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_char(&line, 'N');
    waam_text_uint(&line, (uint64_t)rig.link.received + 1);
    waam_text_char(&line, ' ');
    waam_text_bytes(&line, text, count < WAAM_LINE_MAX - 30 ? count : WAAM_LINE_MAX - 30);
    feed_sealed('S', line.text, line.length);
}

static void take(void)
{
    char line[WAAM_LINE_MAX];
    size_t length = waam_link_next(&rig.link, line);
    REQUIRE((length != 0) == (rig.put != rig.got), "a line waits when one was put in");
    if (!length)
        return;
    unsigned at = rig.got++ % MODEL_LINES;
    REQUIRE(length == rig.length[at] && memcmp(line, rig.line[at], length) == 0, "lines come out as they went in");
    waam_link_accept(&rig.link);
}

static void resynchronise(const char *digits, size_t count)
{
    waam_cursor_t cursor = {digits, count, 0};
    uint64_t next;
    if (!waam_read_uint(&cursor, &next) || next == 0 || next > UINT32_MAX - 1)
        return;
    waam_link_resync(&rig.link, (uint32_t)next);
    rig.got = rig.put;
}

static void record(const char *text, size_t count)
{
    switch (count ? text[0] : '\0') {
    case 's':
    case 'S':
    case 'x': feed_sealed(text[0], text + 1, count - 1); break;
    case 'n': feed_next(text + 1, count - 1); break;
    case 'p': take(); break;
    case 'b': waam_link_block(&rig.link, count > 1); rig.got = rig.put; break;
    case 'r': resynchronise(text + 1, count - 1); break;
    case 'i': rig.link.dialect = WAAM_DIALECT_NATIVE; rig.link.strong = true; break;
    default: feed_line(text, count);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *text = (const char *)data;
    waam_link_init(&rig.link);
    rig.put = rig.got = 0;
    while (size) {
        const char *end = memchr(text, '\n', size);
        size_t length = end ? (size_t)(end - text) : size, used = end ? length + 1 : size;
        record(text, length);
        text += used;
        size -= used;
    }
    while (rig.put != rig.got)
        take();
    return 0;
}
