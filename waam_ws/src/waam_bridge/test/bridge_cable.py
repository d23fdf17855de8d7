"""A bad cable: bytes are lost, doubled and changed, and arrive in other portions than they were sent in."""

from __future__ import annotations

import random

KINDS = ('lost', 'doubled', 'changed')


class Cable:
    """One direction. `rate`: probability per byte of each of the three faults."""

    def __init__(self, dice: random.Random, rate: float, most: int = 1 << 20) -> None:
        self.dice, self.most = dice, most
        self.faults = dict.fromkeys(KINDS, 0)
        self.bytes = 0
        self._under_way = bytearray()
        self.set_rate(rate)

    def set_rate(self, rate: float) -> None:
        self.rate = 3 * rate
        self._next = self._distance()

    def _distance(self) -> int:
        """Bytes until the next fault."""
        return int(self.dice.expovariate(self.rate)) if self.rate else 1 << 60

    def send(self, data: bytes) -> None:
        self.bytes += len(data)
        out = bytearray()
        while self._next < len(data):
            out += data[: self._next]
            out += self._spoil(data[self._next])
            data = data[self._next + 1 :]
            self._next = self._distance()
        self._next -= len(data)
        if len(self._under_way) < self.most:
            self._under_way += out + data

    def _spoil(self, byte: int) -> bytes:
        kind = self.dice.choice(KINDS)
        self.faults[kind] += 1
        if kind == 'lost':
            return b''
        if kind == 'doubled':
            return bytes((byte, byte))
        return bytes((byte ^ self.dice.randrange(1, 256),))

    def receive(self) -> bytes:
        """What arrives now: mostly everything, sometimes cut anywhere, sometimes nothing yet."""
        chance = self.dice.random()
        count = len(self._under_way)
        if chance < 0.1:
            count = self.dice.randrange(count + 1)
        elif chance < 0.15:
            count = 0
        data = bytes(self._under_way[:count])
        del self._under_way[:count]
        return data

    def cut(self) -> None:
        """What was under way is lost."""
        self._under_way.clear()
