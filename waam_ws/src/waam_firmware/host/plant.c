#include <errno.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include "host.h"

#define STEP_MAGIC 0x57414D53u
#define ANSWER_MAGIC 0x57414D41u
#define ANSWER_TIMEOUT_NS 2000000000u

/* The layout of docs/link_protocol.md, little-endian like every host that this is built for. */
typedef struct {
    uint32_t magic, samples;
    uint64_t t_us;
    host_sample_t sample[SAMPLES];
} plant_step_t;

typedef struct {
    uint32_t magic, inputs; /* bits: docs/link_protocol.md */
    double current, voltage, wire_speed;
    double distance;        /* mm, or counts; NaN = no echo */
    uint32_t distance_reading, accelerations; /* samples of the accelerometer that follow: three floats each */
} plant_answer_t;

_Static_assert(sizeof(host_sample_t) == 48 && sizeof(plant_step_t) == 16 + 48 * SAMPLES, "step layout");
_Static_assert(sizeof(plant_answer_t) == 48, "answer layout");
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the plant port is little-endian");

static int complain(const char *path, const char *text)
{
    fprintf(stderr, "virtual_controller: --plant %s: %s\n", path, text);
    return -1;
}

/* A socket that nobody listens on is a leftover. */
static int remove_stale(const struct sockaddr_un *address)
{
    struct stat status;
    if (lstat(address->sun_path, &status) < 0)
        return 0;
    if (!S_ISSOCK(status.st_mode))
        return complain(address->sun_path, "exists and is not a socket");
    int probe = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    int result = connect(probe, (const struct sockaddr *)address, sizeof *address);
    close(probe);
    if (result == 0)
        return complain(address->sun_path, "another controller listens there");
    return unlink(address->sun_path);
}

int plant_open(plant_t *plant, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    struct stat status;
    *plant = (plant_t){.listener = -1, .client = -1};
    if (!path)
        return 0;
    if (strlen(path) >= sizeof address.sun_path)
        return complain(path, "the path is too long for a socket (107 characters)");
    strcpy(address.sun_path, path);
    if (remove_stale(&address) < 0)
        return -1;
    plant->listener = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (plant->listener < 0 || bind(plant->listener, (struct sockaddr *)&address, sizeof address) < 0 ||
        listen(plant->listener, 1) < 0 || lstat(path, &status) < 0)
        return complain(path, strerror(errno));
    plant->path = path;
    plant->inode = status.st_ino;
    return 0;
}

void plant_close(plant_t *plant)
{
    struct stat status;
    if (plant->client >= 0)
        close(plant->client);
    if (plant->path && lstat(plant->path, &status) == 0 && status.st_ino == plant->inode)
        unlink(plant->path);
    if (plant->listener >= 0)
        close(plant->listener);
}

void plant_accept(plant_t *plant)
{
    int client = plant->listener >= 0 ? accept4(plant->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK) : -1;
    if (client < 0)
        return;
    if (plant->client >= 0) {
        close(client); /* one cell only */
        return;
    }
    plant->client = client;
    plant->was_connected = true;
}

static void lose(plant_t *plant, const char *why)
{
    fprintf(stderr, "virtual_controller: the cell is gone: %s\n", why);
    close(plant->client);
    plant->client = -1;
}

static bool send_all(int fd, const void *bytes, size_t count)
{
    return send(fd, bytes, count, MSG_NOSIGNAL) == (ssize_t)count;
}

/* Waits for a part of the answer; the link is served meanwhile. Null when it came, else what went wrong. */
static const char *receive(int fd, void *bytes, size_t size, int pty_fd, plant_idle_t idle, void *context)
{
    uint64_t end = wall_ns() + ANSWER_TIMEOUT_NS;
    size_t have = 0;
    while (have < size) {
        uint64_t now = wall_ns();
        struct pollfd p[2] = {{.fd = fd, .events = POLLIN}, {.fd = pty_fd, .events = POLLIN}};
        if (now >= end)
            return "no answer for 2 s";
        if (poll(p, 2, (int)((end - now) / 1000000u) + 1) < 0)
            return "interrupted";
        if (p[1].revents)
            idle(context);
        if (!p[0].revents)
            continue;
        ssize_t count = recv(fd, (char *)bytes + have, size - have, MSG_DONTWAIT);
        if (count == 0)
            return "it closed the connection";
        if (count < 0 && errno != EAGAIN && errno != EINTR)
            return strerror(errno);
        have += count > 0 ? (size_t)count : 0;
    }
    return NULL;
}

/* The answer and the samples behind it. Null when they came, else what went wrong. */
static const char *receive_answer(plant_t *plant, plant_answer_t *answer, int pty_fd, plant_idle_t idle, void *context)
{
    const char *problem = receive(plant->client, answer, sizeof *answer, pty_fd, idle, context);
    if (problem)
        return problem;
    if (answer->magic != ANSWER_MAGIC)
        return "its answer has a wrong magic number";
    if (answer->accelerations > HOST_SHAKEN)
        return "its answer has too many samples of the accelerometer";
    plant->shaken.fitted = answer->inputs & 64;
    plant->shaken.count = answer->accelerations;
    return receive(plant->client, plant->shaken.value, answer->accelerations * sizeof plant->shaken.value[0], pty_fd, idle,
                   context);
}

void plant_exchange(plant_t *plant, const host_sample_t samples[SAMPLES], uint64_t t_us, waam_inputs_t *inputs,
                    int pty_fd, plant_idle_t idle, void *context)
{
    plant_step_t step = {.magic = STEP_MAGIC, .samples = SAMPLES, .t_us = t_us};
    plant_answer_t answer;
    memcpy(step.sample, samples, sizeof step.sample);
    const char *problem = send_all(plant->client, &step, sizeof step)
                              ? receive_answer(plant, &answer, pty_fd, idle, context)
                              : "it does not take the step";
    if (problem) {
        lose(plant, problem);
        *inputs = (waam_inputs_t){.process = WAAM_PROCESS_LOST};
        return;
    }
    plant->contact = answer.inputs & 8;
    *inputs = (waam_inputs_t){
        .estop = answer.inputs & 1, .gas_ok = answer.inputs & 2, .limit_switch = answer.inputs & 4,
        .over_temperature = answer.inputs & 16, .drive_fault = answer.inputs & 32,
        .process = WAAM_PROCESS_OK, .current_a = answer.current, .voltage_v = answer.voltage,
        .wire_mm_s = answer.wire_speed * 1e3, .distance_reading = answer.distance_reading,
        .distance = (float)answer.distance,
    };
}
