"""A part that was moved, and a job folder that was damaged: the job does not go on, or it goes on rightly."""

from __future__ import annotations

import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.ndimage import convolve

from waam_job.model.goal import Code
from waam_job.model.records import State
from waam_job.model.resume import ResumeError, check_place, laid_range
from waam_job.model.shift import LIMIT, Shift, expected_of, find_shift
from waam_job.run.runner import JobRunner
from waam_job.store.folder import JobFolder
from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Segment

sys.path.insert(0, str(Path(__file__).parent))
from test_resume import cut_off, next_run  # noqa: E402

SPEC = GridSpec(-0.005, -0.005, 5e-4, 80, 110)


def bead(x0: float, x1: float, y: float, number: int, index: int) -> list[Segment]:
    """A straight bead along x (m) in segments of 2 mm."""
    n = max(1, round(abs(x1 - x0) / 2e-3))
    xs = np.linspace(x0, x1, n + 1)
    return [
        Segment(
            index + i, Kind.DEPOSIT, (a, y, 2e-3), (b, y, 2e-3), 8e-3, 1, number, True,
            height=1.5e-3, width=6e-3,
        )
        for i, (a, b) in enumerate(zip(xs, xs[1:], strict=False))
    ]  # fmt: skip


def laid(spec: GridSpec, segments: list[Segment], at=(0.0, 0.0), turn=0.0) -> np.ndarray:
    """(rows, cols) m of parabolic beads 7 mm wide, moved about (20, 15) mm: another shape than that of the fit."""
    c, s, r = math.cos(turn), math.sin(turn), round(3.5e-3 / spec.resolution)
    density = np.zeros(spec.shape)
    for g in segments:
        steps = (np.arange(20) + 0.5)[:, None] / 20
        u, v = (np.array(g.start[:2]) * (1 - steps) + np.array(g.end[:2]) * steps - (0.02, 0.015)).T
        x, y = c * u - s * v + 0.02 + at[0], s * u + c * v + 0.015 + at[1]
        inside = spec.contains(x, y)
        metal = 0.73 * g.width * g.height * g.length / 20 / spec.resolution**2
        np.add.at(density, spec.cell(x[inside], y[inside]), metal)
    dy, dx = np.mgrid[-r : r + 1, -r : r + 1]
    kernel = np.clip(1 - (dx**2 + dy**2) / r**2, 0, 1)
    return convolve(density, kernel / kernel.sum(), mode='constant')


PAD = [*bead(0, 0.04, 5e-3, 1, 0), *bead(0.04, 0, 9.5e-3, 2, 20), *bead(0, 0.04, 14e-3, 3, 40),
       *bead(0.04, 0, 18.5e-3, 4, 60), *bead(0, 0.04, 23e-3, 5, 80)]  # fmt: skip
VOLUME = sum(0.73 * s.width * s.height * s.length for s in PAD)
PLACES = np.array([s.start[:2] for s in PAD])


def found(done: int, at=(0.0, 0.0), turn=0.0, seed=1, scatter=2e-5) -> Shift:
    """`done` segments lie on a blank plate, which was moved."""
    rng = np.random.default_rng(seed)
    plate = HeightGrid.full(SPEC, 0.0)
    z = laid(SPEC, PAD[:done], at, turn) + rng.normal(0, scatter, SPEC.shape)
    return find_shift(expected_of(plate, VOLUME, PAD, done, done + 8), plate.with_z(z), PLACES)


@pytest.mark.parametrize('angle', range(0, 360, 90))
def test_a_shifted_pad_on_a_blank_plate_is_refused(angle):
    """3.2 mm: the plate beside it looks as before."""
    at = 3.2e-3 * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    shift = found(60, tuple(at))
    assert shift.moved
    assert abs(shift.x - at[0]) < 0.7e-3 and abs(shift.y - at[1]) < 0.3e-3
    with pytest.raises(ResumeError, match='from its place'):
        check_place(shift, 1)


@settings(max_examples=8, deadline=None)
@given(st.integers(20, 90), st.integers(0, 2**31), st.sampled_from([2e-5, 6e-5]))
def test_a_part_in_its_place_is_never_refused(done, seed, scatter):
    shift = found(done, seed=seed, scatter=scatter)
    check_place(shift, 1)
    assert not shift.moved and not shift.other_part


@pytest.mark.parametrize('done', [60, 80, 100])
def test_a_turned_pad_is_refused_or_not_said_to_lie_in_its_place(done):
    """Five beads on a blank plate show a turn of 4 degrees for certain, and say that they do not show a smaller one."""
    assert found(done, turn=math.radians(4.0)).moved
    for turn in (1.5, 2.0, 3.0):
        shift = found(done, turn=math.radians(turn))
        assert shift.moved or shift.unseen


def test_a_bead_alone_says_that_it_shows_little_along_it():
    shift = found(10)
    assert not shift.moved and 'along' in shift.unseen
    angle = math.degrees(shift.blind[1])
    assert min(angle, 180 - angle) < 30


def test_a_blank_plate_shows_nothing_and_says_so():
    shift = found(0)
    assert not shift.moved and shift.unseen and shift.blind[0] > LIMIT
    empty = find_shift(
        expected_of(HeightGrid.full(SPEC), VOLUME, PAD, 5, 9), HeightGrid.full(SPEC), PLACES
    )
    assert 'no shift at all' in empty.unseen and not empty.moved


def test_another_surface_is_another_part():
    rng = np.random.default_rng(2)
    ground = HeightGrid(SPEC, laid(SPEC, PAD))
    other = rng.normal(0, 2e-3, (SPEC.rows // 10, SPEC.cols // 10)).repeat(10, 0).repeat(10, 1)
    shift = find_shift(expected_of(ground, VOLUME, PAD, 0, 0), ground.with_z(other), PLACES)
    with pytest.raises(ResumeError):
        check_place(shift, 1)


def test_how_many_segments_may_lie_there():
    assert laid_range(PAD, 2, None) == (40, 100)
    least, most = laid_range(PAD, 1, 25)
    assert least == 25 and 25 < most <= 38  # 3 s at 8 mm/s, in segments of 2 mm


# ---- whole jobs


def lateral(grid: HeightGrid, cells_x: int, cells_y: int) -> HeightGrid:
    """The surface shifted by whole cells; what comes in from outside is the floor."""
    z = np.full(grid.spec.shape, np.nanmin(grid.z))
    rows, cols = z.shape
    to = np.s_[max(0, cells_y) : rows + min(0, cells_y), max(0, cells_x) : cols + min(0, cells_x)]
    of = np.s_[max(0, -cells_y) : rows - max(0, cells_y), max(0, -cells_x) : cols - max(0, cells_x)]
    z[to] = grid.z[of]
    return HeightGrid(grid.spec, z)


@pytest.mark.parametrize('cells', [(2, 0), (0, -3), (-6, 6), (4, -1)])
def test_a_job_does_not_go_on_where_the_part_was_shifted(cells, make_cell, make_runner):
    runner, folder, cell = cut_off(make_cell, make_runner, 30)
    again, fresh = next_run(make_cell, runner, folder, cell, lateral(cell.surface, *cells))
    status = again.run()
    assert status.error_code == Code.BAD_RESUME and 'was moved' in status.message
    assert 'resume again' in status.message and not any(s.arc for s in fresh.executed)


@pytest.mark.parametrize('how', ['mirrored', 'turned over', 'gone'])
def test_a_part_that_was_mirrored_or_turned_over_is_refused(how, make_cell, make_runner):
    """Mirrored across the beads: along them the block and its trough are symmetric."""
    runner, folder, cell = cut_off(make_cell, make_runner, 20)
    z = cell.surface.z
    other = {'mirrored': z[::-1], 'turned over': 0.01 - z, 'gone': np.zeros_like(z)}[how]
    grid = HeightGrid(cell.surface.spec, np.ascontiguousarray(other))
    again, fresh = next_run(make_cell, runner, folder, cell, grid)
    status = again.run()
    assert status.error_code == Code.BAD_RESUME, status.message
    assert not any(s.arc for s in fresh.executed)


def test_the_report_says_where_the_part_lies_or_that_it_is_not_known(make_cell, make_runner):
    runner, folder, cell = cut_off(make_cell, make_runner, 30)
    again, fresh = next_run(make_cell, runner, folder, cell)
    assert again.run().state == State.DONE
    known = [a for a in fresh.anomalies if 'lies in its place: up to' in a.text]
    unknown = [a for a in fresh.anomalies if 'moved is not known for certain' in a.text]
    assert len(known) + len(unknown) == 1
    assert all(a.severity == 'WARNING' and 'along' in a.text for a in unknown)


@pytest.fixture(scope='module')
def cut(tmp_path_factory):
    return {}


FILES = (
    'layers/scan_000.npz', 'plan.npz', 'records.json', 'checkpoint.json', 'status.json', 'learned.json',
)  # fmt: skip


@settings(
    max_examples=8, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_folder_is_resumed_or_refused_by_name(
    data, cut, make_cell, make_runner, tmp_path_factory
):
    """Never a fault of this software, and no arc after a refusal."""
    if not cut:
        cut['job'] = cut_off(make_cell, make_runner, 30)
        cut['surface'] = cut['job'][2].surface.z.copy()
    runner, folder, cell = cut['job']
    copy = tmp_path_factory.mktemp('job') / folder.path.name
    shutil.copytree(folder.path, copy)
    file = copy / data.draw(st.sampled_from([f for f in FILES if (folder.path / f).exists()]))
    content = bytearray(file.read_bytes())
    how = data.draw(st.sampled_from(['cut', 'changed', 'nested', 'list', 'empty object', 'gone']))
    if how == 'cut':
        del content[data.draw(st.integers(0, len(content) - 1)) :]
    elif how == 'changed':
        for at in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=6)):
            content[at] = data.draw(st.integers(0, 255))
    rewritten = {'nested': b'[' * 100_000, 'list': b'[1]', 'empty object': b'{"layers": {"a": 1}}'}
    file.write_bytes(rewritten.get(how, bytes(content)))
    if how == 'gone':
        file.unlink()
    fresh = make_cell(efficiency=0.8)
    fresh.surface = HeightGrid(cell.surface.spec, cut['surface'].copy())
    context = runner.context
    control = type(context.control)()
    again = JobRunner(fresh, context.checked, JobFolder.open(copy), control, context.settings, 2)
    status = again.run()
    assert status.state in (State.DONE, State.FAILED)
    assert status.error_code != Code.UNKNOWN
    if status.state == State.FAILED:
        assert status.message and not any(s.arc for s in fresh.executed)
