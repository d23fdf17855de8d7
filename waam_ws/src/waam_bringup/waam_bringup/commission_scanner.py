"""Step `scanner` of `waam commission`: passes over an artefact, its mounting and the delay of its clock."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from waam_calibrate.commission import Check, CommissionError, Outcome, judged
from waam_calibrate.evidence import EvidenceError
from waam_process.cell_file import CellFile
from waam_process.segment import Kind, Point, Segment
from waam_scan.calibration.artefact import Artefact, ArtefactError, Block
from waam_scan.calibration.artefact_file import load_artefact
from waam_scan.calibration.file import CalibrationFileError, load_calibration, save_calibration
from waam_scan.calibration.pass_file import save_pass
from waam_scan.calibration.scan_pass import Pass
from waam_scan.calibration.solve import Calibration, CalibrationError, calibrate
from waam_scan.commands.calibration_report import draw
from waam_scan.transform import Mounting, rotation_rpy

from . import paths
from .cell_check import CALIBRATION, MOUNTING
from .commission_profiles import Profiles, scanner_settings
from .commission_visit import STAND_CLEAR, Visit, at_home
from .shaking import NAME, approach

ARTEFACT, PASS = 'artefact.yaml', 'scanner_pass.npz'
TOP_MM, SLOPE_DEG, HEIGHT_MM = (20.0, 14.0), 45.0, 12.0  # of the block that is taken without a file
TOUCHED, ALONG, UPRIGHT = 0.05e-3, math.radians(2.0), math.radians(0.3)  # standard uncertainties
DELAY = 0.1  # s, by which stamps may be off
LIFT = 0.03  # m above the artefact, before anything moves aside
# (way in x, way in y, beside it in x, in y, height over the top; m, speed in m/s) of the passes
PASSES = (
    (0.07, 0.0, 0.0, 0.0, 0.010, 0.020),
    (-0.07, 0.0, 0.0, 0.006, 0.010, 0.030),
    (0.0, 0.07, 0.004, 0.0, 0.010, 0.020),
    (0.0, -0.07, -0.005, 0.0, 0.030, 0.030),
    (0.07, 0.0, 0.0, -0.006, 0.030, 0.030),
    (-0.07, 0.0, 0.0, 0.0, 0.020, 0.040),
)


def in_force(visit: Visit) -> None:
    """CommissionError unless scan_fusion runs with the calibration that the step has made, or the cell file names."""
    file, has = visit.file, scanner_settings(visit.cell)['calibration']
    wanted = str(file.values.get(CALIBRATION) or paths.scanner_calibration())
    if has != wanted:
        says = ', '.join(file.where(path) for path in MOUNTING if path in file.values)
        first = f'take {says} out of the cell file, ' if says else ''
        raise CommissionError(
            f'step {visit.step.name}: scan_fusion runs with {has or "no calibration"}, found was {wanted}: {first}'
            f'waam stop, waam up --cell {paths.cell_name()}, and go on with the commissioning'
        )


def scanner(visit: Visit) -> Outcome:
    """Mounting and delay by passes over an artefact that the wire tip has touched."""
    if named := visit.file.values.get(CALIBRATION):
        where = visit.file.where(CALIBRATION)
        raise CommissionError(f'step scanner: {where} names {named}: take the line out first')
    artefact = _artefact(visit)
    start, source = _start(visit.file)
    at_home(visit)
    visit.say(
        'artefact',
        f'Put the artefact ({artefact.name}) on the table, its sides along the axes, 120 mm and more from the low end '
        'of X, 45 mm from all other ends; no spatter under it. Touch the middle of its top with the wire tip: cut to '
        'the stick-out of the job, jogged by the panel.',
    )
    visit.ready(
        'The wire tip touches the middle of its top. It goes up, and the scanner passes over it six times with its '
        f'laser on. {STAND_CLEAR}'
    )
    tip = visit.cell.here
    touched = replace(artefact, position=np.array(tip) - (0.0, 0.0, artefact.body.height))
    listening = Profiles(visit.cell)
    _move(visit, approach(tip, (tip[0], tip[1], tip[2] + LIFT))[:1])
    with listening.on():
        _move(visit, path(tip, start))
    seen = listening.taken()
    save_pass(visit.folder / PASS, seen)
    return _judged(visit, _solved(seen, touched, start), start, source, touched)


def _artefact(visit: Visit) -> Artefact:
    """The file beside the book, else the block that is drawn in the manual."""
    file = visit.folder / ARTEFACT
    try:
        given = load_artefact(file) if file.exists() else None
    except ArtefactError as e:
        raise CommissionError(f'step scanner: {e}') from None
    x, y = TOP_MM
    name = f'block with a top of {x:g} x {y:g} mm, {HEIGHT_MM:g} mm high, {SLOPE_DEG:g} deg on every side'
    slope = math.radians(SLOPE_DEG)
    block = Block.of((1e-3 * x, 1e-3 * y), 1e-3 * HEIGHT_MM, (slope, slope))
    made = given or Artefact(block, np.zeros(3), name=name)
    return replace(
        made, position_sigma=np.full(3, TOUCHED), yaw_sigma=ALONG, tilt_sigma=UPRIGHT, use_table=False
    )  # fmt: skip


def _start(file: CellFile) -> tuple[Mounting, str]:
    """Where the scanner is looked for, and who says so: the cell file; what it leaves out as it was last found, else as
    the drawing has it. CommissionError for a calibration that cannot be read."""
    kept = paths.scanner_calibration()
    try:
        found = load_calibration(kept) if kept.exists() else None
    except CalibrationFileError as e:
        raise CommissionError(
            f'step scanner: where it was last found is not known: {e}; delete the file to begin with the drawing'
        ) from None
    known = found.mounting if found else Mounting()
    source = 'the step of before' if found else 'the drawing'
    mm, deg, delay = (file.values.get(path) for path in MOUNTING)
    offset = known.offset if mm is None else 1e-3 * np.array(mm)
    rotation = known.rotation if deg is None else rotation_rpy(*np.radians(deg))
    late = known.delay if delay is None else 1e-3 * delay
    given = mm is not None or deg is not None
    return Mounting(offset, rotation, late), 'the cell file' if given else source


def path(tip: Point, start: Mounting) -> list[Segment]:
    """Passes that bring the scanner over the artefact whose top is at `tip` (m, work frame), from above it."""
    x, y = tip[0] - float(start.offset[0]), tip[1] - float(start.offset[1])
    middle = tip[2] + _over_the_top(start)
    here, found = (tip[0], tip[1], tip[2] + LIFT), []
    for way_x, way_y, aside_x, aside_y, height, speed in PASSES:
        a = (x + aside_x - way_x / 2, y + aside_y - way_y / 2, middle + height)
        b = (x + aside_x + way_x / 2, y + aside_y + way_y / 2, middle + height)
        found += [*approach(here, a), Segment(0, Kind.IDLE, a, b, speed)]
        here = b
    return [s.at(index=number) for number, s in enumerate(found)]


def _over_the_top(start: Mounting) -> float:
    """m of the wire tip over the artefact, for a scanner that sits higher or lower than that of the drawing."""
    return max(0.0, float(Mounting().offset[2] - start.offset[2]))


def _move(visit: Visit, segments: list[Segment]) -> None:
    cell = visit.cell
    job = f'{NAME}_{cell.node.get_clock().now().nanoseconds}'
    moves = [s.at(index=number) for number, s in enumerate(segments)]
    cell.done = -1
    cell.enqueue(moves, job)
    cell.wait_done(moves[-1].index)


def _solved(seen: Pass, touched: Artefact, start: Mounting) -> Calibration:
    try:
        return calibrate([seen], touched, start, delay_reach=DELAY)
    except CalibrationError as e:
        raise EvidenceError(str(e)) from None


def beside(found: Mounting, start: Mounting) -> tuple[float, float]:
    """How far the scanner sits from where it was looked for: m, deg."""
    turn = found.rotation @ start.rotation.T
    angle = math.degrees(math.acos(min(1.0, max(-1.0, (float(np.trace(turn)) - 1) / 2))))
    return float(np.linalg.norm(found.offset - start.offset)), angle


def _judged(
    visit: Visit, found: Calibration, start: Mounting, source: str, artefact: Artefact
) -> Outcome:
    """Kept only when all of it is seen and within the limits. start: where `source` has it."""
    moved, angle = beside(found.mounting, start)
    sigma = found.sigma
    shown = (
        Check(f'beside where {source} has it', 1e3 * moved, 0.0, 20.0, 'mm'),
        Check('turned against that', angle, 0.0, 5.0, 'deg'),
        Check('delay of its stamps', 1e3 * float(found.mounting.delay), -1e3 * DELAY, 1e3 * DELAY, 'ms'),
        Check('noise', 1e3 * found.noise, 0.0, 0.15, 'mm'),
        Check('uncertainty of the place', 1e3 * float(sigma[:3].max()), 0.0, 0.1, 'mm'),
        Check('uncertainty of the angles', math.degrees(float(sigma[3:6].max())), 0.0, 0.05, 'deg'),
        Check('uncertainty of the delay', 1e3 * float(sigma[6]), 0.0, 1.0, 'ms'),
    )  # fmt: skip
    draw(visit.folder / 'scanner.png', found, artefact)
    visit.pictures.append('scanner.png')
    mend = 'artefact clean, made to size and touched in its middle; scanner tight; passes again'
    if not all(c.good for c in shown[:2]):
        mend += f'; where it was moved: its new place as {MOUNTING[0]} in the cell file, until it is found'
    if found.unobserved:
        return Outcome(False, '; '.join(found.unobserved), shown, mend)
    at = ', '.join(f'{1e3 * v:.2f}' for v in found.mounting.offset)
    text = f'scanner at {at} mm of the wire tip, {angle:.2f} deg off, delay {1e3 * found.mounting.delay:+.1f} ms'
    judgement = judged(shown, text, mend)
    if judgement.passed:
        save_calibration(paths.scanner_calibration(), found, artefact.name, [PASS])
    return judgement
