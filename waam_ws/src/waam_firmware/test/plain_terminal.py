"""A terminal on the virtual controller that reads lines without checks, as stock senders do."""

from __future__ import annotations

import os
import re
import select
import time
import tty


class Plain:
    """The far end of the pseudo-terminal at `path`."""

    def __init__(self, path) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.fd)
        self.lines: list[str] = []
        self.rest = b''

    def send(self, data: bytes) -> None:
        os.write(self.fd, data)

    def wait(self, pattern: str, start: int = 0, timeout: float = 20.0) -> str:
        """The first line from number `start` on that the pattern is found in."""
        end = time.monotonic() + timeout
        while True:
            for line in self.lines[start:]:
                if re.search(pattern, line):
                    return line
            assert time.monotonic() < end, f'no {pattern!r} in {self.lines[-10:]}'
            if select.select([self.fd], [], [], 0.1)[0]:
                *lines, self.rest = (self.rest + os.read(self.fd, 65536)).split(b'\n')
                self.lines += [x.decode().rstrip('\r') for x in lines]

    def ask(self, data: bytes, pattern: str = '^ok') -> str:
        """Sends, and waits for an answer that fits."""
        start = len(self.lines)
        self.send(data)
        return self.wait(pattern, start)

    def close(self) -> None:
        os.close(self.fd)


def until(condition, timeout: float) -> None:
    """Waits for a condition, s."""
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, 'not reached'
        time.sleep(0.02)
