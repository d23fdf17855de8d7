"""Setpoints of waiting segments are replaced: none is lost, none comes twice, each runs with what was accepted last."""

import random
import re

import pytest
from bridge_cell import Cell, line_of
from bridge_fake_controller import FakeCore
from hypothesis import given, settings
from hypothesis import strategies as st
from test_stream import Channel

from waam_bridge import commands, program, replacing
from waam_bridge.stream import Sender


class Noisy(Cell):
    """A cell whose cable damages what goes to the controller and what comes back."""

    def __init__(self, seed, loss, blocks):
        super().__init__(FakeCore(blocks=blocks))
        self.up, self.down = Channel(seed, loss, loss, loss), Channel(seed + 1, loss, loss, loss)

    def noisy(self):
        feed, take = self.fake.feed, self.fake.take
        self.fake.feed = lambda data: feed(self.up(data))
        self.fake.take = lambda: self.down(take())
        return self


def speeds(gcode):
    """(end x in mm, speed in mm/min) of every move, as a controller understands the modal words."""
    x, f, moves = 0.0, 0.0, []
    for line in gcode:
        words = dict(re.findall(r'([A-Z])(-?[\d.]+)', line))
        if not line.startswith('G1'):
            continue
        x, f = float(words.get('X', x)), float(words.get('F', f))
        moves.append((x, f))
    return moves


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.floats(0, 0.12), st.integers(2, 24), st.booleans())
def test_every_segment_runs_once_with_the_setpoints_that_were_accepted_last(
    seed, loss, blocks, arc
):
    rng = random.Random(seed)
    cell = Noisy(seed, loss, blocks).ready()
    if arc:
        cell.nodes = ['a']
        assert cell.command(commands.ARM, 'j', ('a',)) == (0, '')
    cell.noisy()
    wanted = {s.index: s for s in line_of(60, arc=arc)}
    cell.enqueue(list(wanted.values()))
    replaced = 0
    for _ in range(3000):
        cell.step(rng.randint(1, 6))
        if len(cell.done) == len(wanted):
            break
        first = rng.randint(0, 59)
        tail = [
            wanted[k].at(speed=rng.randint(300, 1200) / 60e3) for k in range(first, len(wanted))
        ]
        start, count = replacing.replace(cell.bridge, 'j', tail, True)
        for s in tail[len(tail) - count :]:
            wanted[s.index] = s
        replaced += count
        assert count == 0 or start == tail[len(tail) - count].index
    assert cell.done == list(range(60))
    expected = [(s.end[0] * 1e3, round(s.speed * 60e3, 2)) for s in wanted.values()]
    assert speeds(cell.fake.gcode) == [pytest.approx(e) for e in expected]
    assert replaced > 0 or blocks >= 24
    assert not cell.bridge.waiting


def test_what_was_written_keeps_its_setpoints():
    cell = Cell(FakeCore(blocks=4)).ready()
    cell.fake.stuck = True
    segments = line_of(20)
    cell.enqueue(segments)
    cell.step(3)
    written = cell.bridge.link.sender.written
    first, count = replacing.replace(cell.bridge, 'j', [s.at(speed=0.02) for s in segments], True)
    assert (first, count) == (written - 1, 20 - (written - 1))  # the first line sets the units
    cell.fake.stuck = False
    cell.until(lambda: len(cell.done) == 20)
    assert [f for _, f in speeds(cell.fake.gcode)] == [600.0] * first + [1200.0] * count


@pytest.mark.parametrize(
    ('change', 'code', 'text'),
    [
        (lambda t: [s.at(end=(0.5, 0, 0)) if s.index == 19 else s for s in t], 302, 'segment 19: end'),
        (lambda t: [s.at(bead=7) if s.index == 19 else s for s in t], 302, 'segment 19: bead is 7'),
        (lambda t: [s.at(speed=9.0) for s in t], 302, 'speed is 9 m/s, limits'),
        (lambda t: [s.at(speed=float('nan')) for s in t], 302, 'speed is nan'),
        (lambda t: t[:-1], 303, 'not the last one that waits, 19'),
        (lambda t: t[:5] + t[6:], 303, 'segment 6 does not follow segment 4'),
        (lambda t: [], 302, 'empty'),
    ],
)  # fmt: skip
def test_what_is_refused_changes_nothing(change, code, text):
    cell = Cell(FakeCore(blocks=4)).ready()
    segments = line_of(20)
    cell.enqueue(segments)
    with pytest.raises(program.Refusal, match=re.escape(text)) as e:
        replacing.replace(cell.bridge, 'j', change([s.at(speed=0.02) for s in segments]), True)
    assert e.value.code == code
    cell.until(lambda: len(cell.done) == 20)
    assert {f for _, f in speeds(cell.fake.gcode)} == {600.0}


def test_another_job_and_a_stop_refuse():
    cell = Cell(FakeCore(blocks=4)).ready()
    segments = line_of(20)
    cell.enqueue(segments)
    exchange = replacing.permit(cell.bridge, 'j', segments)
    with pytest.raises(program.Refusal, match="job 'k'"):
        replacing.permit(cell.bridge, 'k', segments)
    batch = replacing.prepare(exchange, segments, True)
    assert cell.command(commands.STOP)[0] == 0
    with pytest.raises(program.Refusal, match='interrupted'):
        replacing.commit(cell.bridge, exchange, batch)
    with pytest.raises(program.Refusal, match='no segments'):
        replacing.permit(cell.bridge, 'j', segments)


def test_lines_that_went_out_meanwhile_make_it_late():
    cell = Cell(FakeCore(blocks=4)).ready()
    segments = line_of(40)
    cell.enqueue(segments)
    exchange = replacing.permit(cell.bridge, 'j', segments, ahead=0)
    batch = replacing.prepare(exchange, segments, True)
    cell.step(20)
    with pytest.raises(replacing.Late):
        replacing.commit(cell.bridge, exchange, batch)
    cell.until(lambda: len(cell.done) == 40)


def test_a_line_that_was_written_is_never_cut():
    sender = Sender()
    for n in range(10):
        sender.put(b'G1 X%d' % n, n)
    sender.resync(1, 4, 2048, 0.0)
    sender.poll(0.0)
    with pytest.raises(ValueError, match='line 4 was written'):
        sender.cut(4)
    sender.cut(5)
    assert (sender.next, sender.pending, sender.marks) == (5, 4, 4)
