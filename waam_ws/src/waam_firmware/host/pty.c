#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include "host.h"

static int complain(const char *what, const char *name)
{
    fprintf(stderr, "virtual_controller: %s %s: %s\n", what, name, strerror(errno));
    return -1;
}

/* No echo and no translation before anybody opens it. The slave is closed again, so that a hang-up shows who is there. */
static int make_raw(const char *path)
{
    struct termios settings;
    int slave = open(path, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (slave < 0 || tcgetattr(slave, &settings) < 0)
        return -1;
    cfmakeraw(&settings);
    int result = tcsetattr(slave, TCSANOW, &settings);
    close(slave);
    return result;
}

/* A link that an earlier run left is replaced; anything else at that place is not touched. */
static int make_link(const char *target, const char *link)
{
    struct stat status;
    char temporary[4096];
    if (lstat(link, &status) == 0 && !S_ISLNK(status.st_mode)) {
        fprintf(stderr, "virtual_controller: --pty-link %s: exists and is not a symbolic link\n", link);
        return -1;
    }
    if (snprintf(temporary, sizeof temporary, "%s.%d", link, (int)getpid()) >= (int)sizeof temporary) {
        errno = ENAMETOOLONG;
        return complain("--pty-link", link);
    }
    if (symlink(target, temporary) < 0)
        return complain("--pty-link", link);
    if (rename(temporary, link) < 0) {
        complain("--pty-link", link);
        unlink(temporary);
        return -1;
    }
    return 0;
}

int pty_open(pty_t *pty, const char *link)
{
    pty->link = NULL;
    pty->fd = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (pty->fd < 0 || grantpt(pty->fd) < 0 || unlockpt(pty->fd) < 0 ||
        ptsname_r(pty->fd, pty->path, sizeof pty->path) != 0 || make_raw(pty->path) < 0)
        return complain("cannot open a pseudo-terminal", "/dev/ptmx");
    if (link && make_link(pty->path, link) < 0)
        return -1;
    pty->link = link;
    return 0;
}

void pty_close(pty_t *pty)
{
    char target[sizeof pty->path + 1];
    ssize_t length = pty->link ? readlink(pty->link, target, sizeof target) : -1;
    if (length == (ssize_t)strlen(pty->path) && memcmp(target, pty->path, (size_t)length) == 0)
        unlink(pty->link);
    if (pty->fd >= 0)
        close(pty->fd);
}

static void notice_hang_up(pty_t *pty)
{
    struct pollfd p = {.fd = pty->fd, .events = POLLIN};
    poll(&p, 1, 0);
    pty->connected = !(p.revents & POLLHUP);
    if (!pty->connected)
        pty->tx_used = 0;
}

size_t pty_read(pty_t *pty, char *bytes, size_t size)
{
    ssize_t count = read(pty->fd, bytes, size);
    if (count <= 0)
        notice_hang_up(pty);
    else
        pty->connected = true;
    return count > 0 ? (size_t)count : 0;
}

bool pty_blocked(const pty_t *pty) { return pty->tx_used > 0; }

bool pty_reads(const pty_t *pty) { return pty->tx_used < TX_INPUT_BYTES; }

void pty_flush(pty_t *pty)
{
    while (pty->tx_used) {
        size_t run = TX_BYTES - pty->tx_head;
        if (run > pty->tx_used)
            run = pty->tx_used;
        ssize_t sent = write(pty->fd, pty->tx + pty->tx_head, run);
        if (sent <= 0)
            return;
        pty->tx_head = (pty->tx_head + (size_t)sent) % TX_BYTES;
        pty->tx_used -= (size_t)sent;
    }
}

/* The input is not read while the buffer is half full, so what must not be lost (answers and alarms) always fits. */
void pty_send(pty_t *pty, const char *bytes, size_t count, waam_tx_kind_t kind)
{
    if (!pty->connected)
        return;
    if ((kind == WAAM_TX_TELEMETRY && pty->tx_used > TX_TELEMETRY_BYTES) || pty->tx_used + count > TX_BYTES) {
        pty->telemetry_dropped++;
        return;
    }
    for (size_t i = 0; i < count; i++)
        pty->tx[(pty->tx_head + pty->tx_used++) % TX_BYTES] = bytes[i];
}
