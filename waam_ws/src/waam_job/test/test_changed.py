"""Passes over what a layer has changed: where they look, how their map joins the one before, what speaks against."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_job.model.changed import BEYOND, SPREAD, Window, against, joined, window_of
from waam_job.model.records import State
from waam_job.model.snapshots import Scan
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind

EDGE = 0.5e-3


def scan_of(z, spec, **fields) -> Scan:
    grid = HeightGrid(spec, z, np.full(z.shape, 1e-5))
    return Scan(grid, np.ones(z.shape, np.uint16), 1.0, True, **fields)


@given(
    st.integers(10, 60), st.integers(10, 60), st.data(), st.floats(-0.1, 0.1), st.floats(-0.1, 0.1)
)
@settings(max_examples=60, deadline=None)
def test_the_window_holds_the_metal_and_its_surroundings_and_joins_without_a_shift(
    rows, cols, data, x0, y0
):
    spec = GridSpec(x0, y0, EDGE, rows, cols)
    planned = np.zeros(spec.shape)
    r, c = data.draw(st.integers(0, rows - 1)), data.draw(st.integers(0, cols - 1))
    planned[r : r + 7, c : c + 5] = 1e-3
    window = window_of(spec, planned)
    part = window.spec(spec)
    x, y = np.meshgrid(spec.x, spec.y)
    inside = np.zeros(spec.shape, bool)
    inside[window.cells] = True
    near = (abs(x - spec.x[c]) < BEYOND) & (abs(y - spec.y[r]) < BEYOND)
    assert inside[planned > 0].all() and inside[near].all()
    np.testing.assert_allclose(part.x, spec.x[window.cells[1]], atol=1e-12)
    np.testing.assert_allclose(part.y, spec.y[window.cells[0]], atol=1e-12)
    before, truth = (np.random.default_rng(k).normal(size=spec.shape) for k in (0, 1))
    seen = scan_of(truth[window.cells], part, handle='message')
    found = joined(scan_of(before, spec), seen, window)
    np.testing.assert_array_equal(found.map.z, np.where(inside, truth, before))
    assert found.handle is None and window.size == inside.sum()


def test_a_layer_without_metal_has_no_window():
    assert window_of(GridSpec(0, 0, EDGE, 9, 9), np.full((9, 9), np.nan)) is None


@pytest.mark.parametrize(
    'change,said',
    [
        (lambda s: s, ''),
        (lambda s: replace(s, plausible=False, reasons=('blind',)), 'blind'),
        (lambda s: replace(s, map=s.map.with_z(s.map.z + 0.15e-3)), 'has moved by +0.15 mm'),
        (lambda s: replace(s, map=s.map.with_z(s.map.z + 0.05e-3)), ''),
        (lambda s: replace(s, map=s.map.with_z(s.map.z * np.nan)), 'only 0 cells'),
    ],
)
def test_the_ring_beside_the_metal_is_the_witness(change, said):
    spec = GridSpec(0, 0, EDGE, 60, 80)
    planned = np.zeros(spec.shape)
    planned[20:40, 30:50] = 2e-3
    window = window_of(spec, planned)
    before = scan_of(np.zeros(spec.shape), spec)
    flowed = np.zeros(spec.shape)  # metal beyond its plan is no movement of the part
    more = int(SPREAD / EDGE)
    flowed[20 - more : 40 + more, 30 - more : 50 + more] = 1.5e-3
    seen = change(scan_of(flowed[window.cells], window.spec(spec)))
    reason = against(before, seen, window, planned)
    assert said in reason and bool(said) == bool(reason)


def test_a_joined_map_is_as_new_and_as_certain_as_its_window():
    spec = GridSpec(0, 0, EDGE, 20, 30)
    before = scan_of(np.zeros(spec.shape), spec, stamp=1.0, points_used=99)
    window = Window((10, 20), (5, 20))
    seen = scan_of(np.full((10, 15), 2e-3), window.spec(spec), stamp=8.0, points_used=10)
    seen = replace(seen, bead_width=6e-3, bead_width_u=1e-4, reasons=('a remark',))
    found = joined(before, seen, window)
    assert found.stamp == 8.0 and found.points_used == 10 and found.bead_width == 6e-3
    assert found.reasons == ('a remark',)
    assert (found.map.z[10:, 5:20] == 2e-3).all()
    assert not found.map.z[:10].any() and not found.map.z[10:, :5].any()
    assert not found.map.z[10:, 20:].any()
    blind = replace(seen, map=HeightGrid(window.spec(spec), seen.map.z, None))
    assert found.map.sigma is not None and joined(before, blind, window).map.sigma is None


def with_stamps(cell) -> None:
    inner = cell.finish_scan
    cell.finish_scan = lambda *a: replace(inner(*a), stamp=cell.now())


def scan_path(cell) -> float:
    return sum(s.length for s in cell.executed if s.kind == Kind.SCAN)


def test_a_job_that_scans_what_changed_knows_the_whole_surface(make_cell, make_runner):
    ways, maps = {}, {}
    for only in (False, True):
        cell = make_cell(efficiency=0.9)
        with_stamps(cell)
        runner, _, folder = make_runner(cell, settings={'scan_changed_only': only})
        assert runner.run().state == State.DONE
        ways[only] = scan_path(cell)
        last = sorted((folder.path / 'layers').iterdir())[-1]
        maps[only] = np.load(last)['z']
        said = [r for c in cell.reports for r in c.reasons if 'of the map scanned' in r]
        assert len(said) == (runner.status.layers if only else 0)
        # metal that the fake cell spreads wider than a bead, and nothing else, is not seen
        assert np.nanmax(np.abs(maps[only] - cell.surface.z)) < 0.15e-3
        report = json.loads((folder.path / 'report.json').read_text())
        assert np.isfinite(report['closed_loop']['rms_mm'])
    assert ways[True] < 0.85 * ways[False]
    assert np.nanmax(np.abs(maps[True] - maps[False])) < 0.2e-3


def test_a_part_that_moved_is_scanned_as_a_whole(make_cell, make_runner):
    cell = make_cell()
    with_stamps(cell)
    runner, _, folder = make_runner(cell, settings={'scan_changed_only': True})
    inner = cell.enqueue

    def enqueue(job_id, segments, last):
        if any(s.kind == Kind.DEPOSIT and s.layer == 1 for s in segments):
            cell.surface.z[:] += 0.3e-3
        inner(job_id, segments, last)

    cell.enqueue = enqueue
    assert runner.run().state == State.DONE
    (note,) = [a for a in cell.anomalies if a.reaction == 'the whole part is scanned']
    assert 'has moved by +0.3' in note.text and note.layer == 1
    whole = [r for c in cell.reports for r in c.reasons if r.startswith('whole part scanned')]
    assert len(whole) == 1 and 'moved' in whole[0]


@pytest.mark.parametrize(
    'make,said',
    [
        (lambda c: c.node_parameters.update(correction_server={'hold_width': True}), 'bead width'),
        (lambda c: None, 'older than 900 s'),  # maps without a stamp are of any age
    ],
)
def test_what_the_window_cannot_give_is_the_reason_for_a_whole_scan(
    make, said, make_cell, make_runner
):
    cell = make_cell()
    if 'width' in said:
        with_stamps(cell)
    make(cell)
    runner, _, _ = make_runner(cell, settings={'scan_changed_only': True}, layers=1)
    assert runner.run().state == State.DONE
    (reason,) = [r for c in cell.reports for r in c.reasons if 'scanned' in r]
    assert reason.startswith('whole part scanned') and said in reason
