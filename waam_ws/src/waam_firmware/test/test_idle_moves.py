"""Idle moves with the input shaper on are not cut short: each reaches its end, and the shaper has repeated it in full,
before an arc is lit or a dwell begins; none is dropped, however short; none takes less time than without a shaper."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shaper_machine import STEPS_PER_MM, TYPES, Machine, executed_at, target

ARC = 1
STEP = 1 / STEPS_PER_MM  # mm
HZ, DAMPING = 30.0, 0.05
# mm; all but the last take less time than the longest shaper
LENGTHS = (STEP, 3 * STEP, 0.05, 0.7, 9.0)
SHAPERS = TYPES[1:]


def shaped(kind: str, hz: float = HZ) -> Machine:
    """With this shaper on both axes; corners are passed as without one."""
    axis = {'': kind, '_hz': hz, '_damping': DAMPING}
    return Machine(
        **{f'shape_{a}{end}': v for a in 'xy' for end, v in axis.items()}, shape_corner_mm=1.0
    )


def strikes(m: Machine) -> np.ndarray:
    """Ticks in which an arc is switched on."""
    arc = np.concatenate([s['outputs'] for s in m.samples]) & ARC != 0
    return np.flatnonzero(np.diff(arc.astype(int)) > 0) + 1


def swing(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What a mode of the tuned frequency on a carriage at x (n,) mm does, one value per ms: its deviation, mm, and its
    speed over the angular frequency, mm. Trapezoidal rule."""
    omega, h = 2 * math.pi * HZ, 1e-3
    a = np.array([[0.0, omega], [-omega, -2 * DAMPING * omega]])
    left, right = np.eye(2) - 0.5 * h * a, np.eye(2) + 0.5 * h * a
    step = np.linalg.inv(left) @ right
    pushed = np.linalg.inv(left) @ np.array([0.0, 1.0])
    speed = np.diff(x, prepend=x[0])
    push = -np.diff(speed, prepend=0.0) / h / omega
    state, found = np.zeros(2), np.empty((len(x), 2))
    for k, p in enumerate(push):
        found[k] = state = step @ state + pushed * p
    return found[:, 0], found[:, 1]


@pytest.mark.parametrize('kind', SHAPERS)
def test_the_arc_waits_for_the_end_of_every_idle_move(kind):
    """Short and long ones, each with an arc behind it: on the spot, at rest, and the frame does not swing any more."""
    m = shaped(kind)
    m.ask('$A test')
    x, y = 20.0, 30.0
    m.run(f'G0 X{x:g} Y{y:g}')
    begun, ends, lines = len(m.track()), [], []
    for length in LENGTHS:
        x, y = x + length, y - length
        ends.append(target(x, y, 200))
        lines += [f'G0 X{x:.6f} Y{y:.6f}', 'M3 W6000 S22', 'M5']
    m.run(*lines)
    lit, track = strikes(m), m.track()
    assert track[lit].tolist() == ends
    off, speed = swing(track[begun:, 0] / STEPS_PER_MM)
    amplitude = np.hypot(off, speed)
    for start, end, length in zip([begun, *lit], lit, LENGTHS, strict=False):
        assert (track[end : end + 30] == track[end]).all(), 'struck on the way'
        moved = start + np.flatnonzero(np.diff(track[start : end + 1, 0]))
        assert len(moved) and end > moved[-1], f'the move of {length:g} mm'
        most = amplitude[start - begun : end - begun].max()
        assert amplitude[end - begun] <= max(0.1 * most, STEP), 'a single step cannot be shaped'


@pytest.mark.parametrize('kind', SHAPERS)
def test_an_idle_move_takes_its_time_and_the_span_of_the_shaper(kind):
    """Between two dwells: what it takes without a shaper, and what the shaper repeats of it."""
    lines = [f'G0 X{20 + n:.6f}\nG4 P0.02' for n in np.cumsum(LENGTHS)]
    program = ['G0 X20', 'G4 P0.02', *'\n'.join(lines).split('\n')]
    times = []
    for m in (Machine(), shaped(kind)):
        m.run(*program)
        at = [executed_at(m.frames, n) for n in range(3, 2 + len(program), 2)]
        times.append(np.diff(at) / 1000)
    answer = m.ask(f'$C shape_x {TYPES.index(kind)}')
    span = int(answer.partition('span_ms=')[2].split()[0])
    assert span > 10
    more = times[1] - times[0]
    assert ((more >= span) & (more <= span + 3)).all(), (more, span)


@settings(max_examples=40, deadline=None)
@given(
    kind=st.sampled_from(SHAPERS),
    hz=st.sampled_from((25.0, 40.0, 90.0)),
    moves=st.lists(st.tuples(st.integers(-40, 40), st.integers(-40, 40)), min_size=1, max_size=12),
    stops=st.sampled_from(('', 'G4 P0.005', 'M7')),
)
def test_no_idle_move_is_dropped_however_short(kind, hz, moves, stops):
    """Moves of some steps, in a row or with a stop after each: every stop is at its place, every line is told."""
    m = shaped(kind, hz)
    m.run('G0 X50 Y50')
    begun = len(m.track())
    places = [target(50, 50, 200)]
    for dx, dy in moves:
        places.append([places[-1][0] + dx, places[-1][1] + dy, places[-1][2]])
        line = 'G0 X{:.6f} Y{:.6f}'.format(*(v / STEPS_PER_MM for v in places[-1][:2]))
        m.send(*[line, stops] if stops else [line])
    m.until(lambda f: f['executed'] == m.next - 1 and f['state'] == 0)
    assert m.position().tolist() == places[-1]
    if stops:
        seen = [place for place, _ in itertools.groupby(m.track()[begun:].tolist())]
        for place in places:
            assert place in seen, 'a move whose end was never reached'
            del seen[: seen.index(place)]
    m.close()
