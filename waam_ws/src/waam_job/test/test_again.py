"""After the wire ran out the torch goes back to where the arc went out, and no bead is left without metal."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_job.model.records import State
from waam_job.run.again import OVERLAP, Again, place_behind
from waam_process.segment import Kind, Segment, check_chain


def path(*points, arcs=None) -> list[Segment]:
    """Segments along points (mm)."""
    at = [tuple(v * 1e-3 for v in (*p, 0.0)) for p in points]
    arcs = arcs or [True] * (len(at) - 1)
    return [
        Segment(i, Kind.DEPOSIT if arc else Kind.IDLE, a, b, 8e-3, arc=arc)
        for i, (a, b, arc) in enumerate(zip(at, at[1:], arcs, strict=False))
    ]


def test_the_way_back_follows_the_path_and_ends_at_its_beginning_or_a_corner():
    bent = path((0, 0), (10, 0), (20, 2))
    x, y, _ = place_behind(bent, (0.011, 0.0002, 0.0), 3e-3)
    assert (x, y) == pytest.approx((0.010 + math.hypot(1, 0.2) * 1e-3 - 3e-3, 0.0), abs=1e-5)
    begun = path((0, 0), (10, 0), (20, 0), arcs=[False, True])
    assert place_behind(begun, (0.0115, 0.0, 0.0), 3e-3) == pytest.approx((0.010, 0.0, 0.0))
    corner = path((0, 0), (10, 0), (10, 10))
    assert place_behind(corner, (0.010, 0.001, 0.0), 3e-3) == pytest.approx((0.010, 0.0, 0.0))


def test_a_bead_that_never_began_has_no_gap(make_cell):
    """The arc burned last at the end of the bead beside it."""
    way = path((0, 0), (20, 0), (20, 4), (0, 4), arcs=[True, False, True])
    again = Again(make_cell(), 'job', way, lambda *_: None)
    held = replace(
        make_cell().machine_state, executed=1, executed_job='job', burned=(0.02, 0.0, 0.0)
    )
    assert again.gap(replace(held, position=(0.02, 0.004, 0.0))) == 0.0
    assert again.gap(replace(held, position=(0.017, 0.004, 0.0))) == pytest.approx(5e-3)


@given(
    st.lists(st.tuples(st.floats(0.5, 5.0), st.floats(-0.1, 0.1)), min_size=1, max_size=8),
    st.floats(0.0, 1.0),
    st.floats(0.0, 10e-3),
)
def test_it_never_goes_farther_than_asked_nor_forward(steps, share, length):
    points, x, y = [(0.0, 0.0)], 0.0, 0.0
    for size, turn in steps:
        x, y = x + size * math.cos(turn), y + size * math.sin(turn)
        points.append((x, y))
    segments = path(*points)
    last = segments[-1]
    torch = tuple(a + share * (b - a) for a, b in zip(last.start, last.end, strict=True))
    place = place_behind(segments, torch, length)
    assert math.dist(place, torch) <= length + 1e-12
    assert place[0] <= torch[0] + 1e-12


def test_the_rest_of_the_layer_is_laid_from_where_the_arc_went_out(make_cell, make_runner):
    cell = make_cell()
    runner, control, _ = make_runner(cell, layers=1)
    handed: list[list[Segment]] = []
    enqueue, command, wait = cell.enqueue, cell.command, cell.wait

    def hand(job_id, segments, last) -> None:
        if not any(s.arc for h in [*handed, []] for s in h):
            for before, s in zip(segments, segments[1:], strict=False):
                known = segments[: s.index - segments[0].index + 1]
                if s.arc and math.dist(place_behind(known, s.midpoint, 5e-3), s.midpoint) > 4.9e-3:
                    cell.script[before.index] = lambda _: run_out()
                    break
        handed.append(segments)
        enqueue(job_id, segments, last)

    def move(name, **fields) -> None:
        command(name, **fields)
        if name == 'STOP':
            cell.machine_state = replace(cell.machine_state, state='IDLE', fault=0)
        if name == 'JOG':
            here = cell.machine_state.position
            there = tuple(h + m for h, m in zip(here, fields['vector'], strict=True))
            cell.machine_state = replace(cell.machine_state, position=there)

    def run_out() -> None:
        """Half a segment on, the wire is at its end; the torch has gone on for 2.5 mm."""
        running = cell.queue[0]
        at = tuple(0.5 * (a + b) for a, b in zip(running.start, running.end, strict=True))
        back = tuple(b - a for a, b in zip(running.start, running.end, strict=True))
        size = math.hypot(*back)
        burned = tuple(p - 2.5e-3 * b / size for p, b in zip(at, back, strict=True))
        cell.machine_state = replace(
            cell.machine_state, state='HOLD', fault=206, fault_text='no wire', position=at,
            burned=burned,
        )  # fmt: skip

    def resume(seconds) -> None:
        if runner.status.state == State.PAUSED:
            control.resume()
        wait(seconds)

    cell.enqueue, cell.command, cell.wait = hand, move, resume
    assert runner.run().state == State.DONE, runner.status.message
    assert 'JOG' in cell.commands and 'RESUME' not in cell.commands
    whole, rest = [h for h in handed if any(s.arc for s in h)]
    check_chain(rest)
    held = next(s for s in whole if s.index == rest[0].index)
    assert rest[1:] == whole[len(whole) - len(rest) + 1 :]
    back = math.dist(rest[0].start, held.midpoint)
    assert back == pytest.approx(2.5e-3 + OVERLAP, abs=0.2e-3)
    indices = [s.index for s in cell.executed if s.index >= whole[0].index]
    assert indices == sorted(set(indices)), 'no segment is laid twice or left out'
