"""A job that was cut off anywhere goes on where its surface says and ends as if nothing had happened."""

from __future__ import annotations

import json
import math
import re
import zlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_job.model.resume import Progress, change_point, cold_share, first_bare, rest_of
from waam_job.run.runner import JobRunner
from waam_job.store import checkpoint as checkpoints
from waam_job.store.checkpoint import Checkpoint, CheckpointError
from waam_plan.fill.linking import arc_starts
from waam_plan.gcode.store import load_plan
from waam_plan.plan import PlannedLayer
from waam_process.grid import HeightGrid
from waam_process.segment import Kind, Segment


class PowerCut(BaseException):
    """Nothing in the job may catch this, as nothing can catch a power cut."""


def power_cut() -> None:
    raise PowerCut


def cut_after(cell, deposits: int) -> None:
    """The whole cell loses power when so many segments have been laid; half of the checkpoint lag included."""
    cell.on_deposit(deposits, power_cut)


def run_until_cut(runner) -> None:
    runner._release = lambda: None  # a power cut leaves no time for it
    with pytest.raises(PowerCut):
        runner.run()


def cut_off(make_cell, make_runner, deposits: int, *settings, begin=None, **fields):
    """A job that is cut off. begin: called with its cell and its control before. Returns (runner, folder, cell) with
    the metal that was laid."""
    cell = make_cell(efficiency=0.8)
    runner, control, folder = make_runner(cell, *settings, **fields)
    if begin is not None:
        begin(cell, control)
    cut_after(cell, deposits)
    run_until_cut(runner)
    return runner, folder, cell


def next_run(make_cell, runner, folder, cell, surface=None):
    """The same part after power-on, and the job on it, before it runs."""
    fresh = make_cell(efficiency=0.8)
    fresh.surface = surface or cell.surface
    context, number = runner.context, folder.next_run()
    again = JobRunner(fresh, context.checked, folder, context.control, context.settings, number)
    folder.write_yaml(f'resume_{number}.yaml', {})
    return again, fresh


def go_on(make_cell, runner, folder, cell, surface=None):
    """The job that goes on, its cell, and how it ended."""
    again, fresh = next_run(make_cell, runner, folder, cell, surface)
    return again, fresh, again.run()


@pytest.fixture(scope='module')
def undisturbed():
    return {}


def reference(undisturbed, make_cell, make_runner, **fields) -> tuple[float, int]:
    """RMS (m) and number of deposited segments of the job that nobody interrupts."""
    key = tuple(fields.items())
    if key not in undisturbed:
        cell = make_cell(efficiency=0.8)
        runner, _, _ = make_runner(cell, **fields)
        assert runner.run().state == State.DONE
        laid = sum(s.kind == Kind.DEPOSIT for s in cell.executed)
        undisturbed[key] = runner.final.rms, laid
    return undisturbed[key]


RINGS = {'strategy': 'contour', 'plan_settings': ()}


@pytest.mark.parametrize('fields', [{}, RINGS], ids=['zigzag', 'rings'])
@pytest.mark.parametrize('share', [0.01, 0.17, 0.5, 0.77, 0.995])
def test_resumed_job_ends_like_an_undisturbed_one(
    share, fields, undisturbed, make_cell, make_runner
):
    """Rings lie between rings that have half filled the place: there the scan is sure only to what the last checkpoint
    leaves open."""
    rms, total = reference(undisturbed, make_cell, make_runner, **fields)
    runner, folder, cell = cut_off(make_cell, make_runner, max(1, int(share * total)), **fields)
    laid = sum(s.kind == Kind.DEPOSIT for s in cell.executed)
    again, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE, status.message
    rest = sum(s.kind == Kind.DEPOSIT for s in fresh.executed)
    assert abs(laid + rest - total) <= (10 if fields else 5)  # segments
    assert again.final.rms < 1.1 * rms
    report = json.loads((folder.path / 'report.json').read_text())
    layers = [r['layer'] for r in report['closed_loop']['layers'] if not r['final']]
    assert layers == list(range(1, status.layers + 1)) and report['closed_loop']['runs'] == 2
    assert any('resumed' in a['text'] for a in report['closed_loop']['anomalies'])


def test_after_the_rest_of_a_layer_the_whole_part_is_scanned(make_cell, make_runner):
    """What the run before has laid of the layer may lie outside of the rest, whatever the settings say."""

    def stamped(**options):
        cell = make_cell(**options)
        inner = cell.finish_scan
        cell.finish_scan = lambda *a: replace(inner(*a), stamp=cell.now())
        return cell

    only = {'scan_changed_only': True}
    runner, folder, cell = cut_off(stamped, make_runner, 40, settings=only)
    again, fresh, status = go_on(stamped, runner, folder, cell)
    assert status.state == State.DONE, status.message
    windows = [(r.layer, r.final) for r in fresh.reports if 'of the map scanned' in str(r.reasons)]
    later = [(n, False) for n in range(3, status.layers + 1)]
    assert windows == [*later, (status.layers, True)]


def test_a_full_middle_does_not_hide_a_bare_place_before_it():
    """Shares along the inner rings of a spiral in the simulated cell; the arc went out before segment 6. The middle (14
    to 16) is full of its neighbours' metal: the fit alone took all up to it for laid; 20 mm of bead were missing."""
    shares = np.array([
        1.11, 1.03, 1.03, 1.02, 0.83, 0.57, 0.23, 0.24, 0.38, 0.55, 0.5, 0.62, 0.34, 0.35, 0.92, 1.18, 1.02, 0.4, 0.26,
        0.12, 0.18,
    ])  # fmt: skip
    lengths = np.full(len(shares), 1.7e-3)
    assert first_bare(shares, lengths, 6e-3, 0) == 6
    assert first_bare(shares, lengths, 6e-3, 9) == 12, 'what a checkpoint calls done is not asked'
    hidden = np.where(shares < 0.5, np.nan, shares)
    assert first_bare(hidden, lengths, 6e-3, 0) == len(shares), 'what was not seen is not bare'
    assert first_bare(shares, lengths / 4, 6e-3, 0) == len(shares), (
        'too short for a bead that is missing'
    )


@given(
    shares=st.lists(st.floats(0.0, 1.5) | st.just(math.nan), max_size=30),
    least=st.integers(0, 30),
)
def test_the_bare_place_is_bare_and_not_before_the_checkpoint(shares, least):
    least, n = min(least, len(shares)), len(shares)
    found = first_bare(np.array(shares), np.full(n, 1.5e-3), 6e-3, least)
    assert least <= found <= n
    assert found == n or all(s < 0.5 for s in shares[found : found + 2])
    assert not any(a < 0.5 and b < 0.5 for a, b in pairwise(shares[least:found]))


def asked_of(cell) -> list:
    """Every request to the correction server from now on."""
    inner, requests = cell.correct, []

    def correct(job_id, request):
        requests.append(request)
        return inner(job_id, request)

    cell.correct = correct
    return requests


def test_the_rest_of_a_layer_gets_the_correction_of_the_whole(make_cell, make_runner):
    """Asked for with all beads of the layer: with the metal of the whole but the beads of the rest, half of the layer
    looked as if nobody laid it, and the network refused the plan (density 1.2, seen up to 0.56)."""
    before = []
    runner, folder, cell = cut_off(
        make_cell, make_runner, 20, begin=lambda cell, _: before.append(asked_of(cell))
    )
    again, fresh = next_run(make_cell, runner, folder, cell)
    after = asked_of(fresh)
    assert again.run().state == State.DONE
    first, resumed = before[0][0], after[0]
    assert first.layer == resumed.layer == 1
    assert np.allclose(first.planned, resumed.planned, atol=1e-8)
    assert [len(b) for b in first.beads] == [len(b) for b in resumed.beads]
    assert all(map(np.allclose, first.beads, resumed.beads))
    assert np.allclose(first.scan.map.z, resumed.scan.map.z, atol=1e-6, equal_nan=True)


def test_two_cuts_in_one_layer(undisturbed, make_cell, make_runner):
    rms, total = reference(undisturbed, make_cell, make_runner)
    runner, folder, cell = cut_off(make_cell, make_runner, int(0.6 * total))
    second, fresh = next_run(make_cell, runner, folder, cell)
    cut_after(fresh, 20)
    run_until_cut(second)
    again, _, status = go_on(make_cell, runner, folder, fresh)
    assert status.state == State.DONE, status.message
    assert again.final.rms < 1.1**2 * rms


@pytest.mark.parametrize('when', ['before the cut', 'after it'])
def test_an_override_in_a_layer_that_was_cut_off_still_counts_as_asked_for(
    when, make_cell, make_runner
):
    """A fifth more wire on one side of the cut alone: there it was wanted, on the other side it was not."""

    def wire(cell, control, factor: float) -> None:
        cell.on_deposit(1, lambda: control.override(1.0, factor))

    def layers(before: float, after: float) -> tuple[np.ndarray, list]:
        """Metal that the first layer was asked for, as the folder tells it, and as the second one is told."""
        runner, folder, cell = cut_off(
            make_cell, make_runner, 30, begin=lambda c, control: wire(c, control, before)
        )
        control = runner.context.control
        control.override(1.0, 1.0)
        again, fresh = next_run(make_cell, runner, folder, cell)
        wire(fresh, control, after)
        told, inner = {}, fresh.correct
        fresh.correct = lambda run_id, r: told.update({r.layer: r}) or inner(run_id, r)
        assert again.run().state == State.DONE
        return folder.read_map(0)['asked'].astype(float), told[2].previous_growth

    plain, altered = (
        layers(1.0, 1.0),
        layers(*((1.2, 1.0) if when == 'before the cut' else (1.0, 1.2))),
    )
    for usual, wanted in zip(plain, altered, strict=True):
        ratio = wanted[usual > 0] / usual[usual > 0]
        more = ratio > 1.1
        assert np.median(ratio[more]) == pytest.approx(1.2, abs=1e-4)
        assert np.median(ratio[~more]) == pytest.approx(1.0, abs=1e-4)
        assert 0.25 < more.mean() < 0.75


def test_cut_before_anything_was_laid_starts_anew(make_cell, make_runner):
    cell = make_cell()
    runner, _, folder = make_runner(cell)
    cell.finish_scan = lambda *_: power_cut()
    run_until_cut(runner)
    _, _, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE


@pytest.mark.parametrize('damage', ['torn', 'empty', 'other bytes', 'gone', 'both torn'])
def test_spoilt_checkpoint_costs_nothing(damage, undisturbed, make_cell, make_runner):
    rms, total = reference(undisturbed, make_cell, make_runner)
    runner, folder, cell = cut_off(make_cell, make_runner, int(0.4 * total))
    newest = folder.path / checkpoints.CHECKPOINT
    text = newest.read_text()
    if damage == 'gone':
        newest.unlink()
    else:
        spoilt = {'empty': '', 'other bytes': text.replace('"layer": 1', '"layer": 2')}
        newest.write_text(spoilt.get(damage, text[: len(text) // 2]))
    if damage == 'both torn':
        (folder.path / checkpoints.CHECKPOINT_BEFORE).write_text('{')
    again, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE, status.message
    assert again.final.rms < 1.1 * rms
    if damage in ('torn', 'empty', 'both torn'):
        assert any('checkpoint' in a.text for a in fresh.anomalies)
        report = json.loads((folder.path / 'report.json').read_text())
        assert any('checkpoint' in a['text'] for a in report['closed_loop']['anomalies'])


@pytest.mark.parametrize('torn', [(), (checkpoints.CHECKPOINT, checkpoints.CHECKPOINT_BEFORE)])
def test_how_warm_the_layer_was_outlives_both_checkpoints(torn, make_cell, make_runner):
    cell = make_cell(efficiency=0.8)
    cell.temperature = 160.0
    runner, _, folder = make_runner(cell)
    cut_after(cell, 30)
    run_until_cut(runner)
    for name in torn:
        (folder.path / name).write_text('{')
    _, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE, status.message
    said = next(a.text for a in fresh.anomalies if 'of its metal' in a.text)
    expected = cold_share(cell.temperature, fresh.temperature, 2e-4)
    share = float(re.search(r'(\d+)% of its metal', said)[1]) / 100
    assert expected < 0.985 and share == pytest.approx(expected, abs=0.01)


def passes_of(folder) -> list[dict]:
    return json.loads((folder.path / 'report.json').read_text())['closed_loop']['passes']


def cut_during(state, layer):
    """A power cut as soon as `state` is reported in `layer`, for `cell.status`."""

    def attach(cell):
        inner = cell.status

        def status(s):
            inner(s)
            if s.state == state and s.layer == layer:
                raise PowerCut

        cell.status = status

    return attach


CUTS = {
    'in pass 1': lambda cell: cut_after(cell, 25),
    'in the scan between': cut_during(State.SCANNING, 1),
    'waiting for pass 2': cut_during(State.COOLING, 2),
    'in pass 2': lambda cell: cut_after(cell, 120),
}


MACHINED = ('finish=machined', 'finish_height=0.00115')


def test_a_job_that_was_cut_off_in_a_top_up_goes_on_there(pit_after, make_cell, make_runner):
    planned = make_runner(make_cell(), plan_settings=MACHINED)[0].run().layers
    cell = make_cell()
    pit_after(cell, [planned])
    runner, _, folder = make_runner(cell, plan_settings=MACHINED)
    cut_during(State.DEPOSITING, planned + 1)(cell)
    run_until_cut(runner)
    again, _, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE and again.in_tolerance, status.message
    assert [p['layers'] for p in passes_of(folder)][0] == planned
    assert status.layers > planned and status.pass_number > 1


EQUAL = ('finish_layers=0',)  # layers of one thickness: one for the first pass, one for the second


@pytest.mark.parametrize('cut', CUTS)
def test_job_of_two_passes_that_was_cut_off(cut, make_cell, make_runner):
    whole, _, complete = make_runner(make_cell(efficiency=0.8), passes=2, plan_settings=EQUAL)
    assert whole.run().state == State.DONE
    cell = make_cell(efficiency=0.8)
    runner, _, folder = make_runner(cell, passes=2, plan_settings=EQUAL)
    CUTS[cut](cell)
    run_until_cut(runner)
    again, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE, status.message
    assert again.final.rms < 1.1 * whole.final.rms
    for mine, theirs in zip(passes_of(folder), passes_of(complete), strict=True):
        for key in (
            'set_height',
            'corrected_height',
            'measured_rms',
            'measured_mean',
        ):
            expected = theirs[key] and pytest.approx(theirs[key], rel=0.1, abs=1e-5)
            assert mine[key] == expected, key
    # planned as the undisturbed one: the same way round, the same starts
    mine, theirs = (
        arc_starts(load_plan(f.path / 'plan_2.npz').layers[0].segments) for f in (folder, complete)
    )
    assert mine == pytest.approx(theirs, abs=1e-3)
    report = json.loads((folder.path / 'report.json').read_text())['closed_loop']
    assert [r['layer'] for r in report['layers'] if not r['final']] == [1, 2]


def wasteful(make_cell):
    """A cell that uses more wire than was planned."""
    cell = make_cell(efficiency=0.8)
    inner = cell.take_sums
    cell.take_sums = lambda: replace(inner(), wire=1e9)
    return cell


def test_wire_is_checked_again_when_a_job_goes_on(make_cell, make_runner):
    cell = wasteful(make_cell)
    runner, _, folder = make_runner(cell, wire_left=100.0, plan_settings=EQUAL)
    CUTS['waiting for pass 2'](cell)
    run_until_cut(runner)
    _, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.error_code == Code.MACHINE_NOT_READY and 'm of wire' in status.message
    assert not {'ARM', 'HOME'} & set(fresh.commands)
    spool = replace(runner.context.checked.goal, wire_left=100.0, new_spool=True)
    runner.context = replace(runner.context, checked=replace(runner.context.checked, goal=spool))
    _, _, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE, status.message
    # a run that was refused loses nothing of the runs before
    report = json.loads((folder.path / 'report.json').read_text())['closed_loop']
    assert [r['layer'] for r in report['layers'] if not r['final']] == [1, 2]


@pytest.mark.parametrize('told,done', [(0.3, False), (0.9, True), (None, True)])
def test_wire_of_a_begun_layer(told, done, make_cell, make_runner):
    """A third of the only layer is laid. told: share of its wire on a new spool, None = it is still the first one."""
    whole, _, _ = make_runner(make_cell(efficiency=0.8), layers=1)
    whole.run()
    needed = whole.context.plan.wire
    runner, folder, cell = cut_off(make_cell, make_runner, 20, layers=1, wire_left=1.05 * needed)
    if told:
        goal = replace(runner.context.checked.goal, wire_left=told * needed, new_spool=True)
        runner.context = replace(runner.context, checked=replace(runner.context.checked, goal=goal))
    again, fresh, status = go_on(make_cell, runner, folder, cell)
    assert (status.state == State.DONE) is done, status.message
    if done:
        assert again.journal.wire_left < (told * needed if told else 0.3 * needed)
    else:
        assert 'm of wire' in status.message and not any(s.arc for s in fresh.executed)


def test_wire_of_a_layer_that_was_cut_off_twice_is_counted_once(make_cell, make_runner):
    runner, folder, cell = cut_off(make_cell, make_runner, 20, layers=1, wire_left=100.0)
    second, fresh = next_run(make_cell, runner, folder, cell)
    # unlike a power cut it leaves time to write the records
    fresh.on_deposit(10, lambda: runner.context.control.abort('operator'))
    assert second.run().state == State.ABORTED
    runner.context = replace(runner.context, control=type(runner.context.control)())
    again, _, status = go_on(make_cell, runner, folder, fresh)
    assert status.state == State.DONE, status.message
    used, planned = 100.0 - again.journal.wire_left, again.context.plan.wire
    assert used == pytest.approx(planned, rel=0.25)


def estimates(cell) -> tuple[np.ndarray, np.ndarray]:
    """Progress and time left (s) at every status while metal was laid."""
    seen = [s for s in cell.statuses if s.state == State.DEPOSITING]
    return np.array([s.progress for s in seen]), np.array([s.time_left for s in seen])


def test_a_resumed_job_knows_how_long_it_has_taken(make_cell, make_runner):
    """At the same share of the work the time left is that of an undisturbed job, not that of a run just begun."""
    whole = make_cell(efficiency=0.8)
    make_runner(whole)[0].run()
    expected = estimates(whole)
    laid = sum(s.kind == Kind.DEPOSIT for s in whole.executed)
    runner, folder, cell = cut_off(make_cell, make_runner, int(0.8 * laid))
    _, fresh, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE
    progress, left = estimates(fresh)
    k = int(np.flatnonzero(progress > 0.85)[0])
    usual = float(np.interp(progress[k], expected[0], np.nan_to_num(expected[1])))
    assert np.isfinite(left[k]) and left[k] > 0.5 * usual


def test_part_that_was_moved_is_refused(make_cell, make_runner):
    runner, folder, cell = cut_off(make_cell, make_runner, 30)
    grid = cell.surface
    raised = HeightGrid(grid.spec, np.where(grid.z > 5e-3, grid.z + 0.4e-3, grid.z))
    _, fresh, status = go_on(make_cell, runner, folder, cell, raised)
    assert status.error_code == Code.BAD_RESUME and 'moved' in status.message
    assert not any(s.arc for s in fresh.executed)


def test_other_part_without_the_metal_is_refused(make_cell, make_runner):
    runner, folder, cell = cut_off(make_cell, make_runner, 40)
    _, fresh, status = go_on(make_cell, runner, folder, cell, make_cell().surface)
    assert status.error_code == Code.BAD_RESUME and 'was laid' in status.message
    assert not any(s.arc for s in fresh.executed)


def test_aborted_job_can_go_on(undisturbed, make_cell, make_runner):
    rms, total = reference(undisturbed, make_cell, make_runner)
    cell = make_cell(efficiency=0.8)
    runner, control, folder = make_runner(cell)
    cell.on_deposit(20, lambda: control.abort('operator'))
    assert runner.run().state == State.ABORTED
    cell.machine_state = replace(cell.machine_state, state='IDLE')
    runner.context = replace(runner.context, control=type(control)())
    again, _, status = go_on(make_cell, runner, folder, cell)
    assert status.state == State.DONE and again.final.rms < 1.1 * rms


def half_a_layer(make_cell, make_runner):
    """A job cut off in its first layer, and the runner and cell that go on with it."""
    runner, folder, cell = cut_off(make_cell, make_runner, 40)
    fresh = make_cell(efficiency=0.8)
    fresh.surface = cell.surface
    control = type(runner.context.control)()
    again = JobRunner(fresh, runner.context.checked, folder, control, runner.context.settings, 2)
    return again, control, fresh, folder


def test_rescan_asked_for_while_a_layer_is_resumed_waits_for_the_next(make_cell, make_runner):
    again, control, fresh, folder = half_a_layer(make_cell, make_runner)
    control.request('rescan')
    before = np.load(folder.path / 'layers' / 'scan_000.npz')['z']
    assert again.run().state == State.DONE
    asked = [a for a in fresh.anomalies if 'another scan' in a.text]
    assert [a.layer for a in asked] == [2]
    # the surface before the begun layer is not replaced by one with half of the layer on it
    assert np.array_equal(
        before, np.load(folder.path / 'layers' / 'scan_000.npz')['z'], equal_nan=True
    )


def test_rest_of_a_resumed_layer_can_be_skipped_and_what_lies_there_is_measured(
    make_cell, make_runner
):
    again, control, fresh, folder = half_a_layer(make_cell, make_runner)
    control.request('skip_layer')
    assert again.run().state == State.DONE
    assert not any(s.layer == 1 and s.kind == Kind.DEPOSIT for s in fresh.executed)
    first, second = (np.load(folder.path / 'layers' / f'scan_00{i}.npz')['z'] for i in (0, 1))
    assert np.nanmax(second - first) > 0.5e-3  # the half that was laid


def two_beads() -> PlannedLayer:
    """Two beads of four segments of 2 mm along x, 5 mm apart, each with a dwell in the arc before it moves."""
    segments, at = [], (0.0, 0.0, 0.05)

    def go(kind: Kind, x: float, y: float, z: float, bead: int, **more) -> None:
        nonlocal at
        end = (x * 1e-3, y * 1e-3, z * 1e-3)
        segments.append(
            Segment(len(segments), kind, at, end, 0.01, 1, bead, kind != Kind.IDLE, **more)
        )
        at = end

    for bead in (1, 2):
        y = 5.0 * bead
        go(Kind.IDLE, 0, y, 2, bead)
        go(Kind.DWELL, 0, y, 2, bead, dwell=0.5)
        for x in (2, 4, 6, 8):
            go(Kind.DEPOSIT, x, y, 2, bead, height=2e-3, width=5e-3)
        go(Kind.IDLE, 8, y, 50, bead)
    flat = np.zeros((2, 2))
    return PlannedLayer(1, flat, flat, flat, segments, (1.0, 0.0, 0.0), flat > 0)


def rest(done: int, shares=None) -> list[Segment]:
    found = np.repeat([0.8, 0.0], [done, 8 - done]) if shares is None else np.array(shares)
    return rest_of(two_beads(), Progress(done, 8, 0, found)).segments


def heights(segments: list[Segment]) -> list[float]:
    """Of what is laid, over the planned one."""
    return [round(s.height / 2e-3, 3) for s in segments if s.kind == Kind.DEPOSIT]


def test_a_path_that_was_begun_goes_on_where_half_of_its_metal_is_there():
    """Middles of the segments at 1, 3, 5 and 7 mm; half of the 0.8 that the others have is there at 5 mm."""
    first, second, *others = rest(2, [0.8, 0.8, 0.4, 0.16, 0.0, 0.0, 0.0, 0.0])
    assert first.start == pytest.approx((5e-3, 5e-3, 2e-3), abs=5e-5) and first.end[0] == 6e-3
    assert heights([first, second]) == pytest.approx([0.575, 0.8], abs=0.01)
    assert [first.at(height=2e-3, start=first.end), second.at(height=2e-3), *others] == [
        two_beads().segments[4].at(start=first.end), *two_beads().segments[5:]
    ]  # fmt: skip


def test_over_the_first_bead_width_after_a_restart_there_is_less():
    found = np.array([0.8, 0.4, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    plain, less = (
        rest_of(two_beads(), Progress(2, 8, 0, found), start=s).segments for s in (1.0, 0.7)
    )
    share = np.array(heights(less)) / heights(plain)
    assert share == pytest.approx([0.7, 0.7, 0.7, 1, 1, 1, 1], abs=2e-3)
    assert [s.start for s in less] == [s.start for s in plain]
    whole = rest_of(two_beads(), Progress(4, 8, 0, np.repeat([0.8, 0.0], 4)), start=0.7)
    assert heights(whole.segments) == [1] * 4


def test_a_sharp_end_goes_on_at_the_next_segment_with_all_of_its_metal():
    assert heights(rest(2)) == [1] * 6
    assert rest(2)[0].start == pytest.approx((4e-3, 5e-3, 2e-3))


def test_what_neighbours_spread_is_no_end_of_a_bead_and_the_arc_keeps_some_wire():
    found = heights(rest(1, [0.8, 0.0, 0.0, 0.0, *[0.1] * 4]))
    assert found == [1] * 7
    assert min(heights(rest(1, [0.8, 0.0, 3.0, *[0.0] * 5]))) == 0.3
    assert heights(rest(1, [0.8, np.nan, *[0.0] * 6]))[0] == 1


def test_the_next_path_gets_all_of_its_metal_and_a_path_never_ends_before_it_is_resumed():
    segments = rest(3, [0.8, 0.8, 0.8, 0.9, 0.4, 0.0, 0.0, 0.0])
    assert heights(segments)[1:] == [1, 1, 1, 1] and 0 < segments[0].length < 1e-3


def test_share_on_a_part_that_has_cooled():
    assert cold_share(520.0, 20.0, 2e-4) == pytest.approx(0.9)
    assert cold_share(300.0, 350.0, 2e-4) == 1 and cold_share(900.0, 20.0, 1e-3) == 0.8
    assert cold_share(float('nan'), 20.0, 2e-4) == cold_share(500.0, float('nan'), 2e-4) == 1
    half = rest_of(two_beads(), Progress(4, 8, 0, np.repeat([0.8, 0.0], 4)), 0.5).segments
    assert heights(half) == [0.5] * 4


def test_a_path_that_was_not_begun_is_laid_whole_with_its_dwell():
    segments = rest(4, [0.8] * 4 + [0.4] * 4)
    assert segments == two_beads().segments[8:] and segments[0].kind == Kind.DWELL
    assert rest(0) == two_beads().segments[1:]


def test_nothing_is_left_of_a_complete_layer():
    assert rest(8) == []


@settings(deadline=None)
@given(st.integers(0, 120), st.integers(0, 2**32 - 1), st.floats(0.6, 1.1))
@example(done=0, seed=272484, efficiency=1.0)  # two of the first four were not seen
def test_change_point_is_found_through_noise(done, seed, efficiency):
    """Beads of 20 segments side by side at 0.73 bead widths, laid up to `done`: off by three seen segments at most. A
    segment that the scanner did not see says nothing about where the change is."""
    rng = np.random.default_rng(seed)
    i = np.arange(120)
    row, col = i // 20, i % 20
    middles = np.stack((np.where(row % 2, 19 - col, col) * 2e-3, row * 4.4e-3), axis=1)
    shares = efficiency * (i < done) + rng.normal(0.0, 0.12, 120)
    shares[rng.random(120) < 0.05] = np.nan
    found = change_point(shares, np.full(120, 2e-3), middles, 6e-3)
    between = shares[min(found, done) : max(found, done)]
    assert np.isfinite(between).sum() <= 3


@given(st.binary(max_size=300))
def test_any_bytes_are_a_checkpoint_or_an_error(data):
    text = data.decode('latin1')
    with pytest.raises(CheckpointError):
        checkpoints.parse(text, 'x')


def test_torn_checkpoint_does_not_push_out_the_whole_one_before(tmp_path):
    first, second, third = (Checkpoint('a', layer=1, bead=b) for b in (1, 2, 3))
    checkpoints.save(tmp_path, first)
    checkpoints.save(tmp_path, second)
    for spoilt in (
        second.text()[:-9],
        '',
        second.text().replace('"bead": 2', '"bead": 7'),
        b'\xff{',
    ):
        data = spoilt if isinstance(spoilt, bytes) else spoilt.encode()
        (tmp_path / checkpoints.CHECKPOINT).write_bytes(data)
        checkpoints.save(tmp_path, third)
        assert checkpoints.load(tmp_path) == (third, [])
        (tmp_path / checkpoints.CHECKPOINT).write_text('{')
        assert checkpoints.load(tmp_path)[0] == first


def test_checkpoint_round_trip_and_generations(tmp_path):
    first, second = Checkpoint('a', layer=1, bead=2), Checkpoint('a', layer=1, bead=3, time=1.5)
    checkpoints.save(tmp_path, first)
    checkpoints.save(tmp_path, second)
    assert checkpoints.load(tmp_path) == (second, [])
    (tmp_path / checkpoints.CHECKPOINT).write_text(second.text()[:-4])
    found, doubts = checkpoints.load(tmp_path)
    assert found == first and len(doubts) == 1


def test_checkpoint_without_the_number_of_segments_is_read(tmp_path):
    """As version 0.2.0 wrote it."""
    data = {
        'job_id': 'j', 'run': 1, 'pass_number': 1, 'layer': 2, 'bead': 3, 'beads_done': 2, 'index': 40, 'time': 5.0,
        'temperature': None,
    }  # fmt: skip
    crc = zlib.crc32(json.dumps(data, sort_keys=True).encode())
    read = checkpoints.parse(json.dumps({**data, 'crc32': crc}), 'x')
    assert read == Checkpoint(
        job_id='j', run=1, pass_number=1, layer=2, bead=3, beads_done=2, index=40, time=5.0, temperature=None,
        laid=None,
    )  # fmt: skip
    with pytest.raises(CheckpointError, match='check sum'):
        checkpoints.parse(json.dumps({**data, 'layer': 3, 'crc32': crc}), 'x')


def test_the_scan_moves_the_end_of_the_metal_only_as_far_as_the_checkpoint_leaves_open():
    n = 40
    middles = np.column_stack([2e-3 * np.arange(n), np.zeros(n)])
    shares, lengths = np.where(np.arange(n) < 30, 0.8, 0.0), np.full(n, 2e-3)
    assert change_point(shares, lengths, middles, 6e-3) == 30
    assert change_point(shares, lengths, middles, 6e-3, (10, 20)) == 20
    assert change_point(shares, lengths, middles, 6e-3, (35, 40)) == 35
    assert change_point(shares, lengths, middles, 6e-3, (28, 33)) == 30
