"""Beads around a shaft: the whole zone is covered, no turn is missing or doubled, and nothing happens at the seam."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_plan.fill.path import Pieces
from waam_plan.settings import PlanSettings
from waam_plan.shaft import around, lines
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment
from waam_process.unrolled import OVERLAP, Unrolled

CELL = 0.5e-3
SHAFTS = [Unrolled(d) for d in (0.030, 0.050, 0.123)]


def settings_of(shaft, **changed):
    far = {'machine_min': (-1.0, -0.1, -0.1), 'machine_max': (30.0, 0.3, 0.3)}
    own = {'shaft_diameter': shaft.diameter, 'shaft_ends': 0.016}
    return around.filling(PlanSettings(**{**far, **own, **changed}))


def zone(shaft, wave=0.0, turned=0.0, low=12e-3, high=45e-3):
    """A plate of which y = low to high is on; its ends wave `wave` m to and fro, three times around."""
    spec = GridSpec(0.0, 0.0, CELL, 120, round(shaft.length_x / CELL))
    t, y = np.meshgrid(shaft.angle(spec.x), spec.y)
    off = wave * np.sin(3 * (t - turned))
    return (y > low + off) & (y < high + off), spec


def crossings(chains, shaft, x):
    """y of all beads at the angle of x (m), sorted."""
    found = []
    for line in (line for chain in chains for line in chain):
        first = np.ceil((line[0, 0] - x) / shaft.period - 1e-12)
        at = x + shaft.period * np.arange(first, first + 3)
        at = at[(at >= line[0, 0]) & (at < line[-1, 0])]
        found += list(np.interp(at, *line.T))
    return np.sort(found)


@pytest.mark.parametrize('shaft', SHAFTS)
@pytest.mark.parametrize('wave', [0.0, 1e-3])
@pytest.mark.parametrize('turn', [1, 2, 3])
def test_no_turn_is_missing_or_doubled(shaft, wave, turn):
    s = settings_of(shaft)
    mask, spec = zone(shaft, wave)
    chains = around.chains_of(mask, spec, s, turn)
    assert len(chains) == 1  # one bead without a start in between
    counts = []
    for x in np.linspace(OVERLAP, OVERLAP + shaft.period, 97, endpoint=False):
        y = crossings(chains, shaft, x)
        on = spec.y[mask[:, int(spec.cell(x, 0.0)[1])]]
        inset = s.ring_inset * s.bead_width
        assert y[0] - on[0] < inset + CELL and on[-1] - y[-1] < inset + CELL
        assert np.diff(y).max() < 1.05 * s.pitch
        counts.append((np.diff(y) > 0.6 * s.pitch).sum() + 1)
        assert 0 <= len(y) - counts[-1] <= 2  # one more only where a helix leaves its end
    assert np.ptp(counts) <= 1


@pytest.mark.parametrize('shaft', SHAFTS)
@pytest.mark.parametrize('turn', [1, 2])
def test_the_path_runs_on_over_the_seam(shaft, turn):
    mask, spec = zone(shaft, 0.5e-3)
    (chain,) = around.chains_of(mask, spec, settings_of(shaft), turn)
    for line, after in zip(chain, chain[1:], strict=False):
        assert np.allclose(line[-1], after[0], atol=1e-12)
    path = np.concatenate(chain)
    step = np.diff(path, axis=0)
    step = step[step[:, 0] > 1e-9]
    assert (np.diff(path[:, 0]) >= -1e-12).all()  # the shaft never turns back
    assert np.abs(step[:, 1] / step[:, 0]).max() < 0.7
    turns = (path[-1, 0] - path[0, 0]) / shaft.period
    assert turns == pytest.approx(len(chain), abs=1.0)


def test_turning_the_zone_turns_the_path():
    shaft, whole = SHAFTS[1], 20  # cells
    angle = whole * CELL / shaft.scale
    s = settings_of(shaft)
    a, b = (around.chains_of(*zone(shaft, 1e-3, turned), s, 1)[0] for turned in (0.0, angle))
    x = OVERLAP + 5 * CELL * np.arange(40)
    here = [crossings([a], shaft, v)[3:-3].mean() for v in x]
    there = [crossings([b], shaft, v + whole * CELL)[3:-3].mean() for v in x]
    assert np.corrcoef(here, there)[0, 1] > 0.8


def test_a_zone_narrower_than_two_beads_is_one_turn():
    shaft = SHAFTS[0]
    mask, spec = zone(shaft, low=20e-3, high=24e-3)
    ((line,),) = around.chains_of(mask, spec, settings_of(shaft), 1)
    assert line[-1, 0] - line[0, 0] == pytest.approx(shaft.period)
    assert np.allclose(line[:, 1], 22e-3, atol=CELL)


def test_a_short_axis_turns_back_between_whole_turns():
    shaft = SHAFTS[1]
    mask, spec = zone(shaft)
    (whole,) = around.chains_of(mask, spec, settings_of(shaft), 1)
    longest = OVERLAP + 4.2 * shaft.period
    s = settings_of(shaft, machine_max=(longest, 0.3, 0.3))
    chains = around.chains_of(mask, spec, s, 1)
    assert len(chains) > 1
    assert max(line[:, 0].max() for c in chains for line in c) <= longest
    for before, after in zip(chains, chains[1:], strict=False):
        assert shaft.folded(before[-1][-1, 0]) == pytest.approx(after[0][0, 0], abs=1e-9)
        assert before[-1][-1, 1] == pytest.approx(after[0][0, 1], abs=1e-9)
    parts = [line for c in chains for line in c]
    assert np.allclose(np.concatenate(parts)[:, 1], np.concatenate(whole)[:, 1], atol=1e-9)


@pytest.mark.parametrize('angle', [0.0, 2.0, np.pi])  # over the seam, beside it and opposite
@pytest.mark.parametrize(('size', 'direction'), [(0.25, 'y'), (2.5, 'x')])
def test_a_part_of_the_turn_is_hatched_along_its_longer_side(angle, size, direction):
    shaft = Unrolled(0.050)
    mask, spec = zone(shaft)
    off = (shaft.angle(spec.x) - angle + np.pi) % (2 * np.pi) - np.pi
    mask = mask & (np.abs(off) < size)
    chains = around.chains_of(mask, spec, settings_of(shaft), 1)
    assert len(chains) == 1 and around.direction_of(chains) == direction
    points = np.concatenate(chains[0])
    away = (shaft.angle(points[:, 0]) - angle + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(away).max() < size
    along = replace(settings_of(shaft), strategy='zigzag')
    assert around.direction_of(around.chains_of(mask, spec, along, 1)) == 'y'


def test_steps_of_a_helix():
    knots, levels = around.steps(4, 0.1)
    assert knots[1] - knots[0] == pytest.approx(1.0) and levels[0] == levels[1] == 0.0
    assert knots[-1] - knots[-2] == pytest.approx(1.0) and levels[-2] == levels[-1] == 1.0
    assert np.allclose(np.diff(knots[1::2])[:-1], 1.0)  # from step to step
    assert np.allclose(np.diff(np.unique(levels)), 0.25)
    assert [len(v) for v in around.steps(0, 0.1)] == [2, 2]


def test_islands_go_over_the_seam():
    on = np.zeros((9, 20), bool)
    on[2:4, :3] = on[3:5, 17:] = on[6:8, 5:9] = True
    first, second = around.islands_around(on)
    assert first.sum() + second.sum() == on.sum()
    assert {first.sum(), second.sum()} == {12, 8}
    on[:, 10] = on[0] = True
    assert len(around.islands_around(on)) <= 3


def test_pieces_are_shown_in_the_first_turn_with_copies():
    shaft = SHAFTS[1]
    mask, spec = zone(shaft)
    (chain,) = around.chains_of(mask, spec, settings_of(shaft), 1)
    path = np.column_stack([np.concatenate(chain), np.zeros(sum(map(len, chain)))])
    n = len(path) - 1
    pieces = Pieces(path[:-1], path[1:], np.arange(n), np.zeros(n, int))
    shown = lines.shown(pieces, shaft)
    own = lines.first_of(shown, n)
    middle = (own.start[:, 0] + own.end[:, 0]) / 2
    assert middle.min() >= OVERLAP and middle.max() < OVERLAP + shaft.period
    assert np.allclose(own.length, pieces.length)
    x = (shown.start[n:, 0] + shown.end[n:, 0]) / 2
    assert ((x < OVERLAP) | (x > OVERLAP + shaft.period - CELL)).all()
    aside = (middle < 2 * OVERLAP - 1e-3).sum() + (middle > shaft.period + 1e-3).sum()
    assert len(x) == pytest.approx(aside, rel=0.02)


def test_segments_go_home_and_back():
    shaft = SHAFTS[1]
    s = settings_of(shaft)
    out = [
        Segment(k, Kind.DEPOSIT, (x, 0.02, 0.01), (x + 2e-3, 0.02, 0.01), 0.01)
        for k, x in enumerate(OVERLAP + shaft.period * np.array([0.1, 1.1, 2.999, 7.5]))
    ]
    here = lines.home(out, s)
    assert all(OVERLAP <= h.midpoint[0] < OVERLAP + shaft.period for h in here)
    assert here[0].start[0] == pytest.approx(here[1].start[0])
    assert all(h.length == pytest.approx(o.length) for h, o in zip(here, out, strict=True))
    set_there = [h.at(speed=0.012) for h in here]
    back = lines.in_their_places(set_there, out)
    assert [(b.start, b.end, b.speed) for b in back] == [(o.start, o.end, 0.012) for o in out]


@pytest.mark.parametrize('shaft', SHAFTS)
def test_inside_a_turn_every_place_is_shown_once(shaft):
    settings = settings_of(shaft)
    _, spec = zone(shaft)
    whole = HeightGrid(spec, np.ones(spec.shape))
    x = spec.x[np.isfinite(lines.inside_turn(whole, settings).z).all(axis=0)]
    assert x.min() > OVERLAP and x.max() < OVERLAP + shaft.period
    assert len(x) * CELL > shaft.period - 2.2 * settings.bead_width
    assert lines.inside_turn(whole, PlanSettings()) is whole
