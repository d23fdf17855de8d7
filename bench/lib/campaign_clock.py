"""A wall clock that jumps under the processes of a graph: a small library, put before the C library, adds what a file
says to every reading of the wall clock. Steady clocks stay."""

from __future__ import annotations

import os
import random
import struct
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

from .campaign_graph import Graph, Job, until
from .campaign_strangers import judged

_SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>
static volatile const double *offset;
static int (*real)(clockid_t, struct timespec *);
__attribute__((constructor)) static void begin(void) {
    real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    const char *name = getenv("WAAM_BENCH_CLOCK");
    int fd = name ? open(name, O_RDONLY | O_CLOEXEC) : -1;
    if (fd < 0) return;
    void *at = mmap(NULL, sizeof(double), PROT_READ, MAP_SHARED, fd, 0);
    close(fd);
    if (at != MAP_FAILED) offset = at;
}
int clock_gettime(clockid_t id, struct timespec *t) {
    if (!real) begin();
    int r = real(id, t);
    if (r == 0 && id == CLOCK_REALTIME && offset) t->tv_sec += (time_t)*offset;
    return r;
}
int gettimeofday(struct timeval *restrict tv, void *restrict zone) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    tv->tv_sec = t.tv_sec, tv->tv_usec = t.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *out) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    if (out) *out = t.tv_sec;
    return t.tv_sec;
}
"""


class Clock:
    """The environment of processes whose wall clock `jump` moves."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._file, library = folder / 'offset', folder / 'clock.so'
        self._file.write_bytes(struct.pack('d', 0.0))
        (folder / 'clock.c').write_text(_SHIM)
        build = ['cc', '-shared', '-fPIC', '-O1', '-o', library, folder / 'clock.c', '-ldl']
        subprocess.run(build, check=True)
        self.environment = {'LD_PRELOAD': str(library), 'WAAM_BENCH_CLOCK': str(self._file)}

    def jump(self, seconds: float) -> None:
        """To so many seconds off the true time. In place: the processes have the file mapped."""
        with open(self._file, 'r+b') as f:
            f.write(struct.pack('d', seconds))


def jumps(seconds: float) -> Callable[[Graph, random.Random], dict]:
    """A trial in which the wall clock of all processes jumps by `seconds` while an arc burns, and back some s later."""

    def trial(graph: Graph, rng: random.Random) -> dict:
        graph.down()
        clock = Clock(graph.scratch / 'clock')
        before = {k: os.environ.get(k) for k in clock.environment}
        os.environ.update(clock.environment)
        try:
            graph.live()
        finally:
            for name, value in before.items():
                os.environ.pop(name) if value is None else os.environ.update({name: value})
        job = Job(graph)
        try:
            if not until(lambda: graph.burns() or not job.runs(), 60.0):
                raise RuntimeError('no arc')
            time.sleep(rng.uniform(0.2, 1.0))
            clock.jump(seconds)
            time.sleep(rng.uniform(3.0, 6.0))
            clock.jump(0.0)
            return judged(graph, job) | {'jump_s': seconds}
        finally:
            graph.down()

    return trial
