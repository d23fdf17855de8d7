"""Thermal hardware-in-the-loop of the source: 20 to 400 degrees into the controller's converter. The controller tells
the temperature, the real bridge reads it, the real compensator's law becomes a wire override, and the controller's wire
command is what is judged: unchanged to 200 degrees, then linear, 85 % at 400, no oscillation."""

from __future__ import annotations

import math
import os
import select
import time
import tty
from collections.abc import Callable

import numpy as np
import pytest
from shaper_machine import Inert
from test_target import ALARM, Emulator, images, need_emulator  # noqa: F401 (images is a fixture)

compensator = pytest.importorskip(
    'waam_adapt.thermal.compensator', reason='waam_adapt is not built'
)
thermal_params = pytest.importorskip('waam_adapt.thermal.params')
bridge_core = pytest.importorskip('waam_bridge.core', reason='waam_bridge is not built')
bridge_params = pytest.importorskip('waam_bridge.params')

from waam_bridge import commands, overrides, program  # noqa: E402
from waam_process.plant_port import SAMPLE  # noqa: E402
from waam_process.segment import Kind, Segment  # noqa: E402

FEED = 0.083  # m/s, of the program
FULL_SCALE, NOISE = 1000.0, 0.5  # degC at 10 V, K: sigma of the signal
VOLT_PER_COUNT = 3.3 / 4096
NODE = 'thermal_compensator'


def converter(celsius: float) -> float:
    """V at the converter, of a pyrometer with 0 to 10 V for 0 to FULL_SCALE behind the divider of the board."""
    return 3.0 * celsius / FULL_SCALE


class Loop:
    """Bridge and compensator around a controller. `exchange(to_controller)` returns what came from it meanwhile."""

    def __init__(self, exchange: Callable[[bytes], bytes], clock: Callable[[], float]) -> None:
        self._exchange, self._clock = exchange, clock
        params = bridge_params.BridgeParams(
            temperature_input='0-10V', temperature_low=0.0, temperature_high=FULL_SCALE
        )
        self.bridge = bridge_core.Bridge(params)
        self.law = compensator.Compensator(thermal_params.ThermalParams())
        self.seen: list[tuple[float, float]] = []  # controller time s, degC
        self.wire: list[
            tuple[float, float]
        ] = []  # override in force, wire command: shares of the program's
        self._factor, self._rest = 1.0, b''
        self.bridge.opened(clock())

    def step(self) -> None:
        now, bridge = self._clock(), self.bridge
        *lines, self._rest = (self._rest + self._exchange(bridge.poll(now))).split(b'\n')
        bridge.link.wrote(now)
        for line in lines:
            if t := bridge.line(line, now):
                self.wire.append((t.wire_permille / 1000, t.wire_cmd_um_s * 1e-6 / FEED))
            box = bridge.take_outbox()
            for reply in box.replies:
                reply()
            if box.tick_us is not None:
                bridge.beat(NODE, box.tick_us, bridge.link.boot, now)
            for reading in box.temperatures:
                self._take(reading.t_us * 1e-6, reading.celsius, now)

    def _take(self, t: float, celsius: float, now: float) -> None:
        self.seen.append((t, celsius))
        self.law.add(t, celsius)
        factor = round(self.law.state(t).factor, 3)
        if factor != self._factor:
            self._factor = factor
            overrides.operator(self.bridge, 1.0, factor, NODE, now)

    def until(self, condition: Callable[[], bool], patience: float = 90.0) -> None:
        end = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < end, f'not reached: {self.bridge.message}'
            self.step()

    def command(self, code: int, text: str = '') -> None:
        got: list[tuple[int, str]] = []
        order = commands.Command(code, text, names=(NODE,)) if text else commands.Command(code)
        commands.run(self.bridge, order, lambda *answer: got.append(answer), self._clock())
        self.until(lambda: bool(got))
        assert got[0][0] == 0, got

    def ready(self) -> None:
        """Reset, and the settings of the input are in."""
        self.until(lambda: self.bridge.connected)
        if self.bridge.state == ALARM:
            self.command(commands.RESET)
        self.until(lambda: self.bridge.temperature.settled)
        assert self.bridge.temperature.problem == ''


class Library:
    """The controller's core in this process: 10 ms of it in every exchange."""

    def __init__(self) -> None:
        self.core = Inert(1_000_000)
        self.samples = np.zeros(10, SAMPLE)
        self.part, self.now = self.core.part, 100.0
        self.part(0.0)

    def exchange(self, data: bytes) -> bytes:
        self.core.feed(data)
        self.core.step(self.samples)
        self.now += 0.01
        return self.core.take()


def test_wire_follows_the_thermal_law_from_20_to_400_degrees():
    cell = Library()
    loop = Loop(cell.exchange, lambda: cell.now)
    rng = np.random.default_rng(2)

    def feel(celsius: float) -> None:
        cell.part(converter(celsius + NOISE * rng.standard_normal()))
        loop.step()

    feel(20.0)
    loop.ready()
    loop.command(commands.HOME)
    loop.until(lambda: loop.bridge.state == 0 and loop.bridge.position[2] > 0.19)
    loop.command(commands.ARM, 'hil')
    way = (
        Segment(index=0, start=loop.bridge.position, end=(0.01, 0.05, 0.1), speed=0.05, kind=Kind.IDLE),
        Segment(index=1, start=(0.01, 0.05, 0.1), end=(0.39, 0.05, 0.1), speed=0.004, kind=Kind.DEPOSIT, arc=True,
                wire_feed_speed=FEED, voltage=22.0),
    )  # fmt: skip
    permit = loop.bridge.permit('hil', list(way))
    loop.bridge.commit(permit, program.prepare(permit, list(way), True))
    while loop.wire[-1][1] != pytest.approx(1.0, abs=1e-3):
        feel(20.0)
    begin, start = len(loop.seen), cell.now
    asked = []
    while cell.now < start + 50.0:
        heat = 20.0 + 380.0 * min(1.0, max(0.0, (cell.now - start - 2.0) / 40.0))
        feel(heat)
        asked.append((heat, *loop.wire[-1]))
    assert loop.bridge.state == 1, loop.bridge.message
    # the temperature: ten times a second, true to the converter's noise
    seen = np.array(loop.seen[begin:])
    assert len(seen) == pytest.approx(500, abs=10)
    true = 20.0 + 380.0 * np.clip((seen[:, 0] - seen[0, 0] - 2.0) / 40.0, 0.0, 1.0)
    assert np.abs(seen[:, 1] - true).max() < 2.5
    # the law: nothing to 200 degC, 85 % at 400, linear between; the fit of the compensator lags by half its window
    heat, force, command = np.array(asked).T
    assert np.all(force[heat < 195.0] == 1.0)
    line = 1.0 - 0.15 * np.clip(heat - 200.0, 0.0, 200.0) / 200.0
    assert np.abs(force - line).max() < 5e-3
    for celsius, factor in ((200.0, 1.0), (300.0, 0.925), (400.0, 0.85)):
        at = np.abs(heat - celsius).argmin() if celsius < 400.0 else -1
        assert command[at] == pytest.approx(factor, abs=5e-3)
    assert np.max(force - np.minimum.accumulate(force)) <= 2e-3  # no oscillation beyond the noise
    # the wire command stands on what is in force whenever that is not changing
    settled = np.convolve(force[1:] != force[:-1], np.ones(20), 'full')[: len(force) - 1] == 0
    assert settled.any() and np.abs(command[1:] - force[1:])[settled].max() < 1e-3
    assert np.abs(command - force).max() < 0.05  # the lead for the feeder's lag, no more


def test_a_wire_that_tears_is_unknown_within_a_moment_and_takes_the_factor_away():
    cell = Library()
    loop = Loop(cell.exchange, lambda: cell.now)
    cell.part(converter(350.0))
    loop.ready()
    loop.until(lambda: len(loop.seen) > 20)
    assert loop.law.state(loop.seen[-1][0]).factor == pytest.approx(0.8875, abs=1e-3)
    cell.part(0.0)
    torn = cell.now
    loop.until(lambda: math.isnan(loop.seen[-1][1]))
    assert cell.now - torn < 0.25
    heat = loop.law.state(loop.seen[-1][0])
    assert not heat.plausible and not heat.ready and heat.factor == 1.0
    assert heat.reasons == ('pyrometer gives no number',)


class Terminal:
    """The bytes of the emulated board's link."""

    def __init__(self, path: str) -> None:
        self.fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(self.fd)

    def exchange(self, data: bytes) -> bytes:
        if data:
            os.write(self.fd, data)
        ready = select.select([self.fd], [], [], 0.01)[0]
        return os.read(self.fd, 65536) if ready else b''

    def close(self) -> None:
        os.close(self.fd)


def test_the_boards_own_image_tells_the_temperature_and_the_override_follows(images):  # noqa: F811
    """The image under QEMU, without an arc: a host that is late on a busy computer would lose it."""
    need_emulator()
    emulator = Emulator(images / 'waam_qemu.elf', Terminal)
    try:
        loop = Loop(emulator.client.exchange, time.monotonic)
        loop.ready()
        for celsius, factor in ((200.0, 1.0), (300.0, 0.925), (400.0, 0.85)):
            counts = round(converter(celsius) / VOLT_PER_COUNT)
            os.write(emulator.plant, b'%d=' % counts)
            true = counts * VOLT_PER_COUNT / 3.0 * FULL_SCALE
            begin = loop.bridge.link.newest.t_us + 5_000_000  # the compensator looks back over 3 s
            loop.until(lambda begin=begin: loop.bridge.link.newest.t_us > begin)
            assert loop.seen[-1][1] == pytest.approx(true, abs=0.01)
            assert loop.wire[-1][0] == pytest.approx(factor, abs=5e-3)
        os.write(emulator.plant, b'0=')
        loop.until(lambda: math.isnan(loop.seen[-1][1]))
    finally:
        emulator.close()
