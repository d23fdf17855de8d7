/* The link alone, against a model of its own: what is taken out is what was put in, in order, each line once. One record per
 * line of the input, chosen by its first byte:
 *
 *     s S<text>    sealed with CRC-16 or CRC-32                 n<text>  the same (CRC-32), after the number that is expected
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
} bench_t;

static bench_t bench;

static void queued(uint32_t before)
{
    REQUIRE(!bench.link.blocked, "nothing is queued before the host resynchronises");
    REQUIRE(bench.link.received == before + 1, "numbers count up by one");
    REQUIRE(bench.put - bench.got < MODEL_LINES, "the ring holds no more lines than bytes");
    memcpy(bench.line[bench.put % MODEL_LINES], bench.fed, bench.fed_length);
    bench.length[bench.put++ % MODEL_LINES] = (uint8_t)bench.fed_length;
}

static void require_link(uint32_t received_before, waam_rx_t result)
{
    const waam_link_t *l = &bench.link;
    REQUIRE(l->ring_used <= WAAM_RING_BYTES && l->ring_tail < WAAM_RING_BYTES, "ring");
    REQUIRE(l->length <= WAAM_LINE_MAX + 1, "line buffer");
    REQUIRE(l->received - l->accepted == bench.put - bench.got, "waiting lines");
    REQUIRE(result == WAAM_RX_QUEUED || l->received == received_before, "only a queued line counts");
    REQUIRE(result != WAAM_RX_RESEND || (l->resend_code >= WAAM_E_CHECK && l->resend_code <= WAAM_E_NOT_NOW), "code");
    REQUIRE(result != WAAM_RX_RESEND || !l->blocked, "no resend is asked for while blocked");
}

static void feed_byte(uint8_t byte)
{
    uint32_t before = bench.link.received;
    waam_rx_t result = waam_link_byte(&bench.link, byte);
    if (result == WAAM_RX_QUEUED)
        queued(before);
    if (result == WAAM_RX_IMMEDIATE)
        bench.link.length = 0;
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
    bench.fed_length = star ? star - 1 : count;
    bench.fed_length = bench.fed_length < WAAM_LINE_MAX ? bench.fed_length : WAAM_LINE_MAX;
    memcpy(bench.fed, line, bench.fed_length);
    if (bench.link.length)
        feed("", 0); /* the rest of what came before */
    feed(line, count);
}

static void feed_sealed(char how, const char *text, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_bytes(&line, text, count < WAAM_LINE_MAX - 12 ? count : WAAM_LINE_MAX - 12);
    waam_text_seal(&line, how == 'S');
    feed_line(line.text, line.length - 1);
}

static void feed_next(const char *text, size_t count)
{
    waam_text_t line = {.length = 0};
    waam_text_char(&line, 'N');
    waam_text_uint(&line, (uint64_t)bench.link.received + 1);
    waam_text_char(&line, ' ');
    waam_text_bytes(&line, text, count < WAAM_LINE_MAX - 30 ? count : WAAM_LINE_MAX - 30);
    feed_sealed('S', line.text, line.length);
}

static void take(void)
{
    char line[WAAM_LINE_MAX];
    size_t length = waam_link_next(&bench.link, line);
    REQUIRE((length != 0) == (bench.put != bench.got), "a line waits when one was put in");
    if (!length)
        return;
    unsigned at = bench.got++ % MODEL_LINES;
    REQUIRE(length == bench.length[at] && memcmp(line, bench.line[at], length) == 0, "lines come out as they went in");
    waam_link_accept(&bench.link);
}

static void resynchronise(const char *digits, size_t count)
{
    waam_cursor_t cursor = {digits, count, 0};
    uint64_t next;
    if (!waam_read_uint(&cursor, &next) || next == 0 || next > UINT32_MAX - 1)
        return;
    waam_link_resync(&bench.link, (uint32_t)next);
    bench.got = bench.put;
}

static void record(const char *text, size_t count)
{
    switch (count ? text[0] : '\0') {
    case 's':
    case 'S': feed_sealed(text[0], text + 1, count - 1); break;
    case 'n': feed_next(text + 1, count - 1); break;
    case 'p': take(); break;
    case 'b': waam_link_block(&bench.link, count > 1); bench.got = bench.put; break;
    case 'r': resynchronise(text + 1, count - 1); break;
    case 'i': bench.link.strong = true; break;
    default: feed_line(text, count);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    const char *text = (const char *)data;
    waam_link_init(&bench.link);
    bench.put = bench.got = 0;
    while (size) {
        const char *end = memchr(text, '\n', size);
        size_t length = end ? (size_t)(end - text) : size, used = end ? length + 1 : size;
        record(text, length);
        text += used;
        size -= used;
    }
    while (bench.put != bench.got)
        take();
    return 0;
}
