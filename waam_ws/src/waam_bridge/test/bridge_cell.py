"""The whole bridge core against the fake controller in simulated time: no ROS, no port, no threads."""

from __future__ import annotations

import pytest
from bridge_fake_controller import ALARM, IDLE, FakeCore

from waam_bridge import commands, program
from waam_bridge.commands import Command
from waam_bridge.core import Bridge
from waam_bridge.params import BridgeParams
from waam_process.segment import Kind, Segment


class Cell:
    """Bridge and fake controller, 10 ms per step. `plugged` = False cuts the cable."""

    def __init__(self, fake=None, **params):
        self.fake = fake or FakeCore()
        self.bridge = Bridge(BridgeParams(**params))
        self.now = 100.0
        self.plugged = True
        self.done, self.notices, self.replies, self.ticks = [], [], [], []
        self.nodes = []  # answer ticks
        self.bridge.opened(self.now)

    def step(self, count=1):
        for _ in range(count):
            self.now += 0.01
            self.fake.step()
            data = self.fake.take()
            if self.plugged:
                for line in data.split(b'\n')[:-1]:
                    self.bridge.line(line, self.now)
                    self.collect()
                self.fake.feed(self.bridge.poll(self.now))
                self.bridge.link.wrote(self.now)
                self.collect()
                if self.bridge.link.failed:
                    self.unplug(self.bridge.link.failed)

    def collect(self):
        box = self.bridge.take_outbox()
        self.done += [m.index for m in box.done]
        self.notices += box.notices
        for reply in box.replies:
            reply()
        if box.tick_us is not None:
            self.ticks.append(box.tick_us)
            for node in self.nodes:
                self.bridge.beat(node, box.tick_us, self.fake.boot, self.now)

    def until(self, condition, steps=500):
        for _ in range(steps):
            if condition():
                return
            self.step()
        raise AssertionError(f'not reached: {self.bridge.message}')

    def ready(self):
        self.until(lambda: self.bridge.connected)
        self.step(2)
        return self

    def unplug(self, reason='gone'):
        self.plugged = False
        self.bridge.closed(reason)
        self.collect()

    def plug(self):
        self.plugged = True
        self.fake.take()
        self.bridge.opened(self.now)

    def send(self, code, *args, **kwargs):
        got = []
        commands.run(
            self.bridge, Command(code, *args, **kwargs), lambda *r: got.append(r), self.now
        )
        return got

    def command(self, code, *args, **kwargs):
        got = self.send(code, *args, **kwargs)
        self.until(lambda: got)
        return got[0]

    def enqueue(self, segments, job='j', last=True):
        permit = self.bridge.permit(job, segments)
        batch = program.prepare(permit, segments, last)
        self.bridge.commit(permit, batch)
        return batch

    def refused(self, *args, **kwargs):
        with pytest.raises(program.Refusal) as e:
            self.enqueue(*args, **kwargs)
        return e.value.code, str(e.value)


class Able(FakeCore):
    """A controller with another capability. `taken`: the settings that it was told."""

    def __init__(self, capability=''):
        super().__init__()
        self.capability, self.taken = capability, []

    def say(self, text):
        super().say(text.replace('cap=ARC,GAS', f'cap=ARC,GAS,{self.capability}'))

    def _do_C(self, args):
        assert self.state in (IDLE, ALARM) and not self.queue
        self.taken.append((args[0], float(args[1])))


def line_of(count, arc=False, first=0, x0=0.0, start=None):
    """`count` segments of 1 mm along x, from (x0, 0, 0) or `start`."""
    kind = Kind.DEPOSIT if arc else Kind.IDLE
    source = {'wire_feed_speed': 0.083, 'voltage': 22.0} if arc else {}
    x, y, z = start or (x0, 0.0, 0.0)
    at = [(x + i * 1e-3, y, z) for i in range(count + 1)]
    return [
        Segment(first + i, kind, at[i], at[i + 1], 0.01, arc=arc, layer=1, bead=2, **source)
        for i in range(count)
    ]
