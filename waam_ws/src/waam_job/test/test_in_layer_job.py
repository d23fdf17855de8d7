"""Corrections within a layer, on a cell without processes: what is seen, what is replaced, and what is written down."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_job.model.changed import Window
from waam_job.model.goal import Code, JobError
from waam_job.model.lanes import LEAST_CUT, lanes, scanned
from waam_job.model.records import State
from waam_job.model.seen import BesideArc, Look, Reach, SeenLayer, without_holes
from waam_job.run.in_layer import InLayer
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

SPEC = GridSpec(0.0, 0.0, 0.5e-3, 40, 80)
WIDTH, HIGH = 4e-3, 1e-3
ON = {'in_layer': True, 'in_layer_period': 2.0, 'in_layer_preview': 1.0}


def beads() -> list[Segment]:
    """Four beads along x, 4 mm apart, with idle moves of several pieces between them."""
    made, at = [], (0.005, 0.002, 0.0)
    for bead in range(1, 5):
        y = -0.002 + 4e-3 * bead
        ends = [(0.005, y, 0.0)] * 3 + [(0.005 + 5e-3 * k, y, 0.0) for k in range(1, 7)]
        for k, end in enumerate(ends):
            arc = k >= 3
            made.append(
                Segment(
                    index=100 + len(made),
                    kind=Kind.DEPOSIT if arc else Kind.IDLE,
                    start=at,
                    end=end,
                    speed=0.01,
                    bead=bead if arc else 0,
                    arc=arc,
                )
            )
            at = end
    return made


@pytest.fixture
def layer() -> SeenLayer:
    return SeenLayer(np.zeros(SPEC.shape), Reach.of(beads(), SPEC, WIDTH))


@pytest.fixture(autouse=True)
def near(monkeypatch) -> None:
    """The scanner of the cell without processes rides nearer to the torch than 60 mm, and the part is small."""
    monkeypatch.setattr(InLayer, '_over_part', lambda self: True)


ASKED = np.full(SPEC.shape, HIGH)


def whole(z: float) -> Look:
    return Look(np.full(SPEC.shape, z), np.full(SPEC.shape, 30, np.uint16))


def test_a_cell_tells_something_before_its_first_bead_and_after_its_last(layer):
    layer.add(whole(0.1e-3), 99, 99, ASKED, 10.0)
    assert np.isfinite(layer.ground).all() and np.isnan(layer.growth).all()
    done = max(s.index for s in beads() if s.bead == 2)
    layer.add(whole(HIGH + 0.2e-3), done, done, ASKED, 20.0)
    row = {y: int(SPEC.cell(0.02, y)[0]) for y in (0.002, 0.008, 0.0139)}
    col = int(SPEC.cell(0.02, 0.0)[1])
    assert layer.growth[row[0.002], col] == pytest.approx(0.2e-3)
    assert np.isnan(layer.ground[row[0.002], col])
    # half of a bead: nothing new. Under the last bead the look shows ground that is off
    assert np.isnan(layer.growth[row[0.008], col])
    assert layer.ground[row[0.0139], col] > 0.1e-3
    age = layer.age(25.0)
    assert age[row[0.002], col] == 5.0 and age[row[0.008], col] == 15.0


def test_metal_that_an_override_changed_teaches_nothing(layer):
    last = max(s.index for s in beads())
    second = [s.index for s in beads() if s.bead == 2]
    layer.altered(second[0], second[-1])
    layer.add(whole(HIGH), last, last, ASKED, 1.0)
    rows = [int(SPEC.cell(0.02, y)[0]) for y in (0.002, 0.006, 0.014)]
    col = int(SPEC.cell(0.02, 0.0)[1])
    assert np.isfinite(layer.growth[rows[0], col]) and np.isfinite(layer.growth[rows[2], col])
    assert np.isnan(layer.growth[rows[1], col])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**32))
def test_looks_in_any_number_stay_between_what_was_seen(seed):
    rng = np.random.default_rng(seed)
    layer = SeenLayer(np.zeros(SPEC.shape), Reach.of(beads(), SPEC, WIDTH))
    done, low, high = 99, 0.0, 0.0
    for now in range(12):
        off = rng.uniform(-0.5e-3, 0.5e-3)
        low, high = min(low, off), max(high, off)
        z = np.where(rng.random(SPEC.shape) < 0.5, off, np.nan)
        step = int(rng.integers(0, 5))
        layer.add(Look(z, np.full(SPEC.shape, 9, np.uint16)), done, done + step, ASKED, now)
        done += step
    for values in (layer.ground, layer.growth + HIGH):
        known = values[np.isfinite(values)]
        assert (known >= low - 1e-12).all() and (known <= high + 1e-12).all()
    assert not (np.isfinite(layer.ground) & np.isfinite(layer.growth)).any()
    assert (layer.count[~np.isfinite(layer.z)] == 0).all()


TALL = GridSpec(0.0, 0.0, 0.5e-3, 200, 80)  # 100 mm across: three passes


@given(st.lists(st.tuples(st.integers(0, 45), st.integers(0, 45)), min_size=3, max_size=3))
@settings(max_examples=60, deadline=None)
def test_a_pass_leaves_out_only_ends_that_were_seen_well_and_says_why(ends):
    everything = Window((0, TALL.rows), (0, TALL.cols))
    plain = lanes(everything, TALL, PlanSettings(), None)
    assert len(plain) == 3 and scanned(plain) == [everything]
    z = np.full(TALL.shape, np.nan)
    for lane, (left, right) in zip(plain, ends, strict=True):
        z[slice(*lane.whole.rows), :left] = 0.0
        z[slice(*lane.whole.rows), TALL.cols - right :] = 0.0
    passes = lanes(everything, TALL, PlanSettings(), BesideArc(z, np.isfinite(z)))
    assert [p.whole for p in passes] == [p.whole for p in plain]
    left_out = np.ones(TALL.shape, bool)
    for window in scanned(passes):
        left_out[window.cells] = False
    assert np.isfinite(z[left_out]).all()
    for lane, (left, right) in zip(passes, ends, strict=True):
        whole = left < LEAST_CUT and right < LEAST_CUT
        word = 'left out' if left + right >= TALL.cols else 'no whole end' if whole else 'only'
        assert word in lane.why and (lane.needed is None) == (word == 'left out')
        assert (lane.needed == lane.whole) == (word == 'no whole end')


def test_holes_of_a_lost_profile_are_filled_and_larger_ones_stay():
    z = np.outer(np.ones(3), np.arange(30.0))
    for first, width in ((0, 1), (5, 1), (9, 2), (15, 3), (28, 2)):
        z[1, first : first + width] = np.nan
    found = without_holes(z)
    left = [
        0,
        15,
        16,
        17,
        28,
        29,
    ]  # the middle one of three has nothing within two cells on both sides
    assert np.flatnonzero(np.isnan(found[1])).tolist() == left
    known = np.isfinite(found[1])
    np.testing.assert_allclose(found[1][known], np.arange(30.0)[known])
    np.testing.assert_array_equal(found[::2], z[::2])


def test_what_was_seen_with_few_points_is_covered_and_not_good_enough():
    z = np.full(TALL.shape, np.nan)
    everything = Window((0, TALL.rows), (0, TALL.cols))
    passes = lanes(everything, TALL, PlanSettings(), BesideArc(z, np.ones(TALL.shape, bool)))
    assert scanned(passes) == [everything]
    assert all('100% of it was seen finished' in p.why and ' 0% with' in p.why for p in passes)


@pytest.fixture
def cell(make_cell):
    """Lays 70 % of the metal that it is asked for, and sets the speed by psi as feed_forward does."""
    cell = make_cell(efficiency=0.7)
    given = cell.setpoints

    def setpoints(job_id, request):
        done = []
        for s in given(job_id, request):
            programmed = s.speed_programmed or s.speed
            speed = programmed * (1 + s.k_gain * s.psi)
            done.append(
                s.at(speed=speed, speed_programmed=programmed) if s.kind == Kind.DEPOSIT else s
            )
        return done

    cell.setpoints = setpoints
    return cell


def test_a_job_corrects_within_its_layers_and_says_so(cell, make_runner):
    runner, _, folder = make_runner(cell, settings=ON, tolerance=0.5e-3)
    assert runner.run().state == State.DONE
    done = [r for r in cell.reports if not r.final]
    assert any(r.in_layer_corrections for r in done) and cell.replaced > 0
    assert all(r.in_layer_looks for r in done) and max(r.in_layer_seen for r in done) > 0.3
    assert [s.index for s in cell.executed] == list(range(1, len(cell.executed) + 1))
    rows = [json.loads(x) for x in (folder.path / 'in_layer.jsonl').read_text().splitlines()]
    assert len(rows) == sum(r.in_layer_corrections for r in done)
    assert sum(row['segments'] for row in rows) == sum(r.in_layer_segments for r in done)
    assert all(r.correction.handle == 'message' for r in cell.renewals)
    number = rows[0]['layer']
    ran = [s for s in cell.executed if s.layer == number and s.kind == Kind.DEPOSIT]
    changed = [s for s in ran if s.index >= rows[0]['first']]
    assert changed and len(changed) < len(ran)
    asked = folder.read_map(number - 1)['asked']  # what the record says is what the bridge has got
    grid = GridSpec(*folder.read_map(0)['origin'].tolist(), 0.5e-3, *asked.shape)
    planned = folder.read_map(number - 1)['planned']
    s = changed[-1]
    row, col = (int(v) for v in grid.cell(*s.midpoint[:2]))
    assert asked[row, col] == pytest.approx(planned[row, col] / (1 + s.k_gain * s.psi), rel=0.05)


def test_passes_over_what_was_seen_beside_the_arc_are_left_out_and_the_map_is_right(
    make_cell, make_runner, monkeypatch
):
    cell = make_cell(efficiency=0.9)
    everything = np.ones(cell.surface.z.shape, bool)
    seen = lambda _: BesideArc(np.nan_to_num(cell.surface.z), everything)  # noqa: E731
    monkeypatch.setattr(SeenLayer, 'final', seen)
    inner = cell.finish_scan
    cell.finish_scan = lambda *a: replace(inner(*a), stamp=cell.now())
    runner, _, folder = make_runner(cell, settings=ON | {'scan_changed_only': True})
    assert runner.run().state == State.DONE
    told = [r for c in cell.reports for r in c.reasons if 'left out: ' in r]
    assert len(told) == runner.status.layers, [r for c in cell.reports for r in c.reasons]
    assert all(r.startswith('0% of the map') for r in told)
    assert {s.layer for s in cell.executed if s.kind == Kind.SCAN} == {0}
    last = sorted((folder.path / 'layers').iterdir())[-1]
    assert np.nanmax(np.abs(np.load(last)['z'] - cell.surface.z)) < 0.15e-3


@pytest.mark.parametrize('length,on', [(0.0, False), (0.01, True), (0.5, False)])
def test_a_part_of_that_length_is_corrected_within_by_itself(length, on, make_cell, make_runner):
    cell = make_cell()
    runner, _, _ = make_runner(cell, settings={'in_layer_from': length}, layers=1)
    assert runner.run().state == State.DONE
    assert hasattr(cell, 'looks_begun') == on
    assert runner.context.plan_settings().scanner_trails == on


def test_without_it_nobody_looks_and_every_bit_is_the_same(make_cell, make_runner):
    ends = []
    for own in ({}, {'in_layer': False, 'in_layer_period': 0.5}):
        cell = make_cell()
        runner, _, _ = make_runner(cell, settings=own)
        runner.run()
        assert not hasattr(cell, 'looks_begun') and not cell.renewals
        ends.append(cell.surface.z)
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize('which', ['begin_look', 'look', 'renew', 'replace'])
def test_a_node_that_fails_ends_the_looking_and_not_the_layer(cell, make_runner, which):
    def fail(*_args):
        raise JobError(Code.NODE_LOST, f'{which} is gone')

    setattr(cell, which, fail)
    runner, _, _ = make_runner(cell, settings=ON)
    assert runner.run().state == State.DONE
    said = [a.text for a in cell.anomalies if which in a.text]
    told = [t for r in cell.reports for t in r.reasons if which in t]
    assert 1 <= len(said) == len(told) <= len(cell.reports)  # once in a layer at most
    assert not cell.replaced


def test_an_implausible_map_keeps_it_off(make_cell, make_runner):
    cell = make_cell()
    cell.scan_coverage[1:3] = [0.1, 0.1]
    runner, _, _ = make_runner(cell, settings=ON)
    runner.run()
    said = [r.reasons for r in cell.reports]
    assert any('no in-layer correction: the map before' in t for t in said[1])
    assert not cell.reports[1].in_layer_looks


def cut_off(cell, control) -> dict:
    """Has the job end where the first replaced setpoint of layer 3 is to be laid; `first` is its index."""
    found: dict = {}
    wanted = cell.replace

    def replace(job_id, segments, last):
        answer = wanted(job_id, segments, last)
        if answer[1] and segments[-1].layer == 3 and not found:
            found['first'] = answer[0]
            cell.script[answer[0]] = lambda at: control.abort('power cut')
        return answer

    cell.replace = replace
    return found


@pytest.mark.parametrize('sees', [True, False], ids=['sees more', 'knows the scan only'])
def test_the_rest_of_a_layer_that_was_cut_off_is_corrected_too(
    cell, make_runner, monkeypatch, sees
):
    from waam_job.run.control import Control
    from waam_job.run.runner import JobRunner

    runner, control, folder = make_runner(cell, settings=ON)
    cut = cut_off(cell, control)
    assert runner.run().state == State.ABORTED and cut
    rows = (folder.path / 'in_layer.jsonl').read_text().splitlines()
    before = folder.read_map(2)
    cell.queue.clear()
    cell.executed.clear()
    cell.renewals.clear()
    monkeypatch.setattr(InLayer, '_over_part', lambda self: sees)
    again = JobRunner(
        cell, runner.context.checked, folder, Control(), runner.context.settings, run=2
    )
    assert again.run().state == State.DONE
    report = next(r for r in cell.reports if r.layer == 3 and r.job_id.endswith('r2'))
    assert not any('no in-layer' in t for t in report.reasons), list(report.reasons)
    assert report.in_layer_corrections >= 1 and (report.in_layer_looks > 1) == sees
    # the scan shows how much of the metal came, and the rest is asked for the other way (as the cell's renew does)
    grown = cell.renewals[0].growth
    off = np.median(grown[np.isfinite(grown) & (grown != 0)])
    assert abs(off) > 20e-6
    after = folder.read_map(2)
    rest = [s for s in cell.executed if s.layer == 3 and s.kind == Kind.DEPOSIT]
    later = (folder.path / 'in_layer.jsonl').read_text().splitlines()
    assert later[: len(rows)] == rows
    mended = [r for r in map(json.loads, later[len(rows) :]) if r['layer'] == 3]
    assert len(mended) == report.in_layer_corrections and all(r['run'] == 2 for r in mended)
    assert mended[0]['metal_mean_change'] == pytest.approx(
        -0.3 * off / after['planned'].max(), rel=0.2
    )
    # what lies there stays what it was asked for
    spec = GridSpec(*after['origin'].tolist(), 0.5e-3, *after['z'].shape)
    mine = Reach.of(rest, spec, WIDTH).first >= 0
    assert (~mine & (after['planned'] > 0)).any() and np.isfinite(grown[~mine]).any()
    np.testing.assert_array_equal(after['asked'][~mine], before['asked'][~mine])
    assert (after['asked'][mine] != before['asked'][mine]).any()
