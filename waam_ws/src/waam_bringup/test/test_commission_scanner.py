"""Step `scanner` without a graph: the passes, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from waam_bringup import commission_scanner as step
from waam_bringup.commission_visit import Visit
from waam_calibrate.commission import BY_NAME, CommissionError
from waam_process.cell_file import new, parse
from waam_process.segment import Kind
from waam_scan.calibration.file import save_calibration
from waam_scan.calibration.solve import Calibration
from waam_scan.transform import Mounting

TIP = (0.2, 0.15, 0.04)  # m, on the artefact


@pytest.mark.parametrize('z', [0.120, 0.100])
def test_the_passes_bring_the_scanner_over_the_artefact_and_never_the_torch_down_on_it(z):
    mounted = Mounting(np.array([0.060, 0.01, z]))
    segments = step.path(TIP, mounted)
    here = (TIP[0], TIP[1], TIP[2] + step.LIFT)
    for number, s in enumerate(segments):
        assert s.start == pytest.approx(here) and s.index == number and s.kind == Kind.IDLE
        assert min(s.start[2], s.end[2]) >= TIP[2] + 0.010 - 1e-9
        here = s.end
    passes = [s for s in segments if s.speed in {p[-1] for p in step.PASSES}]
    assert len(passes) == len(step.PASSES)
    for s in passes:
        middle = (np.array(s.start) + s.end) / 2 + mounted.offset
        assert np.abs(middle[:2] - TIP[:2]).max() < 0.007
        assert -0.165 < TIP[2] - middle[2] < -0.085 - 0.012, 'top and foot within its range'
    ways = {tuple(np.sign(np.round(np.subtract(s.end, s.start)[:2], 6))) for s in passes}
    assert ways == {(1, 0), (-1, 0), (0, 1), (0, -1)}, 'both ways along both axes'


def test_a_scanner_is_judged_by_where_the_cell_file_has_it(tmp_path, monkeypatch):
    line = '  scanner: {mount_mm: [140, 5, 200], mount_deg: [0, 2, 90]}'
    file = parse(f'waam_cell: 1\nsensors:\n{line}\n', 'gantry1.yaml')
    monkeypatch.setenv('WAAM_CALIBRATIONS', str(tmp_path))
    start, source = step._start(file)
    assert source == 'the cell file'
    found = Mounting.from_rpy((0.143, 0.001, 0.2), tuple(np.radians([0, 3, 90])))
    moved, angle = step.beside(found, start)
    assert moved == pytest.approx(5e-3) and angle == pytest.approx(1.0)
    assert step.beside(found, Mounting())[0] > 0.1, 'the drawing is another machine'


def test_the_step_again_starts_where_the_scanner_was_last_found(tmp_path, monkeypatch):
    monkeypatch.delenv('WAAM_CELL', raising=False)
    monkeypatch.setenv('WAAM_CALIBRATIONS', str(tmp_path))
    nothing = parse('waam_cell: 1\n', 'gantry1.yaml')
    assert step._start(nothing)[1] == 'the drawing'
    kept = tmp_path / 'commission' / 'scanner.yaml'
    kept.parent.mkdir()
    found = Mounting.from_rpy((0.143, 0.001, 0.2), tuple(np.radians([0, 3, 92])), -0.08)
    save_calibration(kept, solved(found), 'block', [])
    start, source = step._start(nothing)
    assert source == 'the step of before' and start.offset == pytest.approx(found.offset)
    assert start.rotation == pytest.approx(found.rotation) and start.delay == -0.08
    told = parse('waam_cell: 1\nsensors:\n  scanner: {mount_mm: [60, 0, 120]}\n', 'gantry1.yaml')
    start, source = step._start(told)
    assert source == 'the cell file' and start.offset == pytest.approx((0.06, 0.0, 0.12))
    assert start.rotation == pytest.approx(found.rotation), (
        'what it leaves out stays as it was found'
    )
    kept.write_text(kept.read_text().replace('-0.08', '-0.07'))
    with pytest.raises(
        CommissionError, match='last found is not known: .*changed by hand.*delete the file'
    ):
        step._start(nothing)


def solved(found: Mounting) -> Calibration:
    none = np.empty(0)
    return Calibration(
        mounting=found, covariance=np.eye(7) * 1e-12, unobserved=[], free=none, noise=1e-5, used=100, seen=100,
        rejected_profiles=0, faces={}, passes={}, residuals=none, points=none,
    )  # fmt: skip


def visit(tmp_path, monkeypatch, line: str, has: str) -> Visit:
    """Of the step `arc`, with a line of the cell file and what scan_fusion runs with."""
    monkeypatch.setenv('WAAM_CALIBRATIONS', str(tmp_path))
    monkeypatch.setattr(step, 'scanner_settings', lambda cell: {'calibration': has})
    text = new('gantry1')
    assert f'# {line}' in text or not line
    file = parse(text.replace(f'# {line}', line) if line else text, 'gantry1.yaml')
    return Visit(BY_NAME['arc'], None, None, file, tmp_path)  # type: ignore[arg-type]


def test_no_arc_with_a_scanner_that_sits_where_nobody_found_it(tmp_path, monkeypatch):
    monkeypatch.delenv('WAAM_CELL', raising=False)
    kept = str(tmp_path / 'commission' / 'scanner.yaml')
    step.in_force(visit(tmp_path, monkeypatch, '', kept))
    with pytest.raises(CommissionError, match='runs with no calibration.*: waam stop'):
        step.in_force(visit(tmp_path, monkeypatch, '', ''))
    with pytest.raises(
        CommissionError, match='take gantry1.yaml:.*mount_mm.* out of the cell file'
    ):
        step.in_force(visit(tmp_path, monkeypatch, 'mount_mm: [60, 0, 120]', ''))
    named = visit(tmp_path, monkeypatch, 'calibration: /path/to/scanner.yaml', '')
    with pytest.raises(CommissionError, match='take the line out first'):
        step.scanner(named)
