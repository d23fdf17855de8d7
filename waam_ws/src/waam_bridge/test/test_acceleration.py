"""Samples of the controller's accelerometer: lines into batches, their rate, gaps; a sensor that does not answer."""

from __future__ import annotations

import numpy as np
import pytest
from bridge_cell import Able, Cell
from bridge_fake_controller import sealed
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_bridge import conversions, frames, parsing, requests
from waam_bridge.acceleration import PER_COUNT, RANGE
from waam_bridge.mounting import mounting
from waam_bridge.outbox import WARNING
from waam_bridge.params import BridgeParams
from waam_node.params import ParameterError

G = 9.80665


def packed(counts) -> str:
    out = ''
    for x, y, z in counts:
        bits = (x + 8192) << 28 | (y + 8192) << 14 | (z + 8192)
        out += ''.join(chr(48 + (bits >> shift & 63)) for shift in range(36, -1, -6))
    return out


def line(seq, t_us, lost, counts) -> bytes:
    return sealed(f'A {seq},{t_us},{lost},{packed(counts)}').rstrip(b'\n')


class Sensed(Able):
    """A controller with an accelerometer. `sick`: what it says instead of samples."""

    sick = ''

    def _do_M(self, args) -> None:
        if args[0] == '1' and self.sick:
            self.say(f'! IDLE E213 {self.sick}')


class Listener(Cell):
    """Keeps the batches."""

    def __init__(self, fake=None, **params):
        self.batches = []
        super().__init__(fake or Sensed('ACCEL'), **params)

    def collect(self):
        self.batches += self.bridge.outbox.accelerations
        super().collect()

    def switch(self, on=True):
        got = []
        self.bridge.accelerometer.switch(self.bridge, on, lambda *r: got.append(r), self.now)
        return got

    def hear(self, seq, t_us, lost=0, counts=None):
        counts = [(0, 0, 256)] * 16 if counts is None else counts
        self.bridge.line(line(seq, t_us, lost, counts), self.now)
        self.collect()


@given(st.lists(st.tuples(*[st.integers(-4096, 4095)] * 3), min_size=1, max_size=16))
@settings(max_examples=50, deadline=None)
def test_every_count_comes_through(counts):
    got = parsing.parse(line(7, 123, 2, counts))
    assert isinstance(got, frames.Acceleration) and (got.seq, got.t_us, got.lost) == (7, 123, 2)
    assert got.counts.tolist() == [list(c) for c in counts]


@pytest.mark.parametrize(
    'text', ['A 1,2,3,', 'A 1,2,3,0000', 'A 1,2,3,zzzzzzz', 'A 1,2,3,0000000', 'A -1,2,3,P0P0P00']
)
def test_what_is_no_line_of_samples_is_refused(text):
    with pytest.raises(frames.FrameError):
        parsing.parse(sealed(text).rstrip(b'\n'))


def test_it_is_on_when_samples_come():
    cell = Listener().ready()
    got = cell.switch()
    cell.step(10)
    assert not got
    cell.hear(0, 1_000_000)
    assert got == [(requests.OK, 'accelerometer on')]
    off = cell.switch(False)
    cell.until(lambda: off)
    assert off[0][0] == requests.OK
    assert [x for x in cell.fake.seen if x.startswith('$M')][-1].split()[1].startswith('0')


def test_batches_have_the_measured_rate_and_time_of_the_first_sample():
    """The sensor runs 2 % slow; half a second later the bridge knows."""
    cell, rate = Listener().ready(), 3136.0
    cell.switch()
    for seq in range(200):
        cell.hear(seq, 1_000_000 + round(seq * 16 / rate * 1e6), counts=[(256, -512, seq)] * 16)
    assert [b.sequence for b in cell.batches] == list(range(10))
    assert cell.batches[3].t_us == 1_000_000 + round(60 * 16 / rate * 1e6)
    assert cell.batches[0].rate == 3200.0 and cell.batches[-1].rate == pytest.approx(rate, rel=1e-4)
    assert cell.batches[-1].values[0] == pytest.approx([G, -2 * G, 180 * PER_COUNT])
    msg = conversions.acceleration(cell.batches[3], 5_000_000_123)
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec, msg.sequence) == (5, 123, 3)
    assert msg.range == pytest.approx(RANGE) and len(msg.x) == len(msg.z) == 320
    assert msg.y[0] == pytest.approx(-2 * G, rel=1e-6)


def test_what_was_lost_leaves_a_gap():
    cell = Listener().ready()
    cell.switch()
    for seq, lost in [(n, 0) for n in range(30)] + [(n, 0) for n in range(31, 61)]:
        cell.hear(seq, 1_000_000 + 5000 * seq, lost)
    assert [(b.sequence, len(b.values)) for b in cell.batches] == [(0, 320), (1, 160), (3, 320)]
    for seq in range(61, 82):
        cell.hear(seq, 1_000_000 + 5000 * seq, 4)
    assert [b.sequence for b in cell.batches] == [0, 1, 3, 4, 6]
    assert len(cell.batches[3].values) == 160


def test_a_sensor_that_does_not_answer_is_named():
    fake = Sensed('ACCEL')
    fake.sick = 'accelerometer: no ADXL345 answers'
    cell = Listener(fake).ready()
    got = cell.switch()
    cell.until(lambda: got)
    assert got[0][0] == requests.REFUSED and 'no ADXL345 answers' in got[0][1]
    assert [n for n in cell.notices if n.severity == WARNING and 'E213' in n.text]
    assert cell.bridge.state == 0 and not cell.bridge.fault


def test_silence_and_controllers_without_a_sensor_are_refused():
    cell = Listener().ready()
    got = cell.switch()
    cell.until(lambda: got)
    assert got[0][0] == requests.TIMEOUT
    for cell, code in ((Cell().ready(), requests.WRONG_STATE), (Cell(), requests.NOT_CONNECTED)):
        got = []
        cell.bridge.accelerometer.switch(cell.bridge, True, lambda *r: got.append(r), cell.now)  # noqa: B023
        assert got[0][0] == code and not [x for x in cell.fake.seen if x.startswith('$M')]


def test_the_mounting_turns_the_samples():
    assert (mounting('x y z') == np.eye(3)).all()
    cell = Listener(accelerometer_axes='-y x z').ready()
    cell.switch()
    for seq in range(20):
        cell.hear(seq, 1_000_000 + 5000 * seq, counts=[(256, 512, 768)] * 16)
    assert cell.batches[0].values[0] == pytest.approx([-2 * G, G, 3 * G])
    for wrong in ('x y', 'x y y', 'x y -z', 'a b c', ''):
        with pytest.raises(ParameterError, match='accelerometer_axes'):
            BridgeParams(accelerometer_axes=wrong)
