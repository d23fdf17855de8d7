/* Runs a harness without libFuzzer: replays the corpus, then mutates it with a fixed seed, so that every run is the same.
 *
 *     fuzz_core_replay CORPUS_FOLDER [runs [seed]]        fuzz_core_replay FILE
 */
#include <dirent.h>
#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fuzz.h"

#define INPUT_MAX 4096u
#define INPUTS_MAX 4096u

typedef struct {
    uint8_t *bytes;
    size_t size;
} input_t;

static input_t inputs[INPUTS_MAX];
static size_t input_count;
static uint64_t random_state;
static const uint8_t *current;
static size_t current_size;

static uint32_t random_below(uint32_t limit) /* xorshift64* */
{
    random_state ^= random_state >> 12;
    random_state ^= random_state << 25;
    random_state ^= random_state >> 27;
    return (uint32_t)((random_state * 0x2545F4914F6CDD1Du) >> 32) % limit;
}

static void load(const char *path)
{
    FILE *file = input_count < INPUTS_MAX ? fopen(path, "rb") : NULL;
    if (!file) {
        fprintf(stderr, "cannot read %s\n", path);
        exit(2);
    }
    input_t *input = &inputs[input_count++];
    input->bytes = malloc(INPUT_MAX);
    if (!input->bytes) {
        fclose(file);
        exit(2);
    }
    input->size = fread(input->bytes, 1, INPUT_MAX, file);
    fclose(file);
}

static int by_content(const void *a, const void *b) /* the order of files in a folder is not the same everywhere */
{
    const input_t *x = a, *y = b;
    int order = memcmp(x->bytes, y->bytes, x->size < y->size ? x->size : y->size);
    return order ? order : (x->size > y->size) - (x->size < y->size);
}

static void load_all(const char *path)
{
    struct stat info;
    DIR *folder = stat(path, &info) == 0 && S_ISDIR(info.st_mode) ? opendir(path) : NULL;
    struct dirent *entry;
    char name[4096];
    if (!folder) {
        load(path);
        return;
    }
    while ((entry = readdir(folder)) != NULL)
        if (entry->d_name[0] != '.') {
            snprintf(name, sizeof name, "%s/%s", path, entry->d_name);
            load(name);
        }
    closedir(folder);
    qsort(inputs, input_count, sizeof inputs[0], by_content);
}

static void put(uint8_t *to, size_t *size, const uint8_t *from, size_t count)
{
    count = count < INPUT_MAX - *size ? count : INPUT_MAX - *size;
    memcpy(to + *size, from, count);
    *size += count;
}

/* A piece of one input is replaced by a piece of another, or bytes are changed, lost or doubled. */
static size_t mutate(uint8_t *to)
{
    const input_t *a = &inputs[random_below((uint32_t)input_count)], *b = &inputs[random_below((uint32_t)input_count)];
    size_t size = 0, cut = random_below((uint32_t)a->size + 1), end = cut + random_below((uint32_t)(a->size - cut) + 1);
    size_t from = random_below((uint32_t)b->size + 1), piece = random_below((uint32_t)(b->size - from) + 1);
    put(to, &size, a->bytes, cut);
    if (random_below(2))
        put(to, &size, b->bytes + from, piece);
    put(to, &size, a->bytes + end, a->size - end);
    for (uint32_t changes = random_below(4); changes && size; changes--) {
        size_t at = random_below((uint32_t)size);
        switch (random_below(3)) {
        case 0: to[at] = (uint8_t)random_below(256); break;
        case 1: to[at] ^= (uint8_t)(1u << random_below(8)); break;
        default: to[at] = to[random_below((uint32_t)size)]; break;
        }
    }
    return size;
}

static void run_copy(const uint8_t *bytes, size_t size) /* exactly as long as the input, so that reading past it is found */
{
    uint8_t *copy = malloc(size ? size : 1);
    if (!copy)
        exit(2);
    memcpy(copy, bytes, size);
    current = copy;
    current_size = size;
    LLVMFuzzerTestOneInput(copy, size);
    free(copy);
}

static void keep_input(int number) /* of a check that failed; as a FILE it shows the failure again */
{
    static const char said[] = "the input is in fuzz_finding\n";
    int file = open("fuzz_finding", O_WRONLY | O_CREAT | O_TRUNC, 0644);
    bool kept = file >= 0 && write(file, current, current_size) == (ssize_t)current_size;
    if (kept && write(STDERR_FILENO, said, sizeof said - 1) < 0)
        _exit(2);
    signal(number, SIG_DFL);
    raise(number);
}

int main(int argc, char **argv)
{
    static uint8_t mutant[INPUT_MAX];
    if (argc < 2 || argc > 4) {
        fprintf(stderr, "usage: %s CORPUS_FOLDER|FILE [runs [seed]]\n", argv[0]);
        return 2;
    }
    unsigned long runs = argc > 2 ? strtoul(argv[2], NULL, 10) : 0;
    random_state = (argc > 3 ? strtoull(argv[3], NULL, 10) : 1) * 0x9E3779B97F4A7C15u + 1;
    signal(SIGABRT, keep_input);
    load_all(argv[1]);
    for (size_t i = 0; i < input_count; i++)
        run_copy(inputs[i].bytes, inputs[i].size);
    for (unsigned long i = 0; i < runs && input_count; i++)
        run_copy(mutant, mutate(mutant));
    printf("%zu inputs and %lu mutations, no finding\n", input_count, runs);
    for (size_t i = 0; i < input_count; i++)
        free(inputs[i].bytes);
    return input_count ? 0 : 2;
}
