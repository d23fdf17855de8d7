"""What follows from lengths that somebody measured: steps per mm, skew, tool centre point. Pure. mm and degrees, as
gauges tell them. EvidenceError when the measurements do not tell enough; the text says why and what to do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from waam_plan.gcode.skew import SkewError, angles_from_diagonals

from .evidence import EvidenceError
from .results import STEPS, Result

MIN_MEASURED = 3  # measurements of one thing
MIN_TRAVEL = 50.0  # mm of travel, or of the longest side of a frame
SCALE_SURE = 5e-4  # standard uncertainty of a scale
SCALE_MOST = 0.05  # a larger error is a typing error or the wrong motor setting
SKEW_MOST = 4.0  # deg; a larger one is a typing error
SKEW_SURE = 0.03  # deg, standard uncertainty
SIDES = (0.2, 5.0)  # ratio of the sides of a frame
SLOPES = (5.0, 85.0)  # deg
TCP_SURE = 0.5  # standard uncertainty over the limit
LARGEST_SKEW = 0.25  # deg, that a job may run with


def _numbers(name: str, values: Sequence[float], least: int) -> np.ndarray:
    found = np.asarray(values, float)
    if len(found) < least:
        raise EvidenceError(f'{name}: {len(found)} given, at least {least} are needed')
    for v in found:
        if not (math.isfinite(v) and v > 0):
            raise EvidenceError(f'{name}: {v:g} mm is no length')
    return found


def steps(
    axis: str, commanded: Sequence[float], measured: Sequence[float], steps_per_mm: float
) -> Result:
    """The scale of an axis (real over commanded length), and the steps per mm that the controller should have.

    commanded, measured (n,) mm: travels, always in the same direction. With more than one length, play and zero of the
    gauge cancel out (`offset_mm`); steps_per_mm: of the controller now."""
    x = _numbers('commanded', commanded, MIN_MEASURED)
    y = _numbers('measured', measured, MIN_MEASURED)
    if len(x) != len(y):
        raise EvidenceError(f'{len(x)} commanded and {len(y)} measured lengths: one for each')
    if x.max() < MIN_TRAVEL:
        raise EvidenceError(
            f'the longest travel is {x.max():g} mm, at least {MIN_TRAVEL:g} are needed'
        )
    several = np.ptp(x) > 0.3 * x.max()
    columns = np.stack([x, np.ones_like(x)], axis=1) if several else x[:, None]
    if len(x) <= columns.shape[1]:
        raise EvidenceError(f'{len(x)} lengths: {columns.shape[1] + 1} at least are needed')
    found, *_ = np.linalg.lstsq(columns, y, rcond=None)
    rest = y - columns @ found
    variance = float(rest @ rest) / (len(x) - columns.shape[1])
    sigma = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[0, 0]))
    scale = float(found[0])
    if abs(scale - 1) > SCALE_MOST:
        raise EvidenceError(
            f'{100 * (scale - 1):+.1f} % off: a typing error, or the wrong motor setting'
        )
    if sigma > SCALE_SURE:
        text = f'the lengths scatter too much: {100 * sigma:.3f} % standard uncertainty'
        raise EvidenceError(
            f'{text}, at most {100 * SCALE_SURE:g} %: a longer travel, or measure again'
        )
    new = steps_per_mm / scale
    values = {'scale': scale, 'steps_per_mm': new, 'offset_mm': float(found[1]) if several else 0.0}
    evidence = {'standard_uncertainty': sigma, 'lengths': float(len(x))}
    text = f'{new:.3f} steps/mm ({100 * (scale - 1):+.3f} % +- {100 * sigma:.3f} %)'
    return Result('steps', axis, text, values, evidence, [(STEPS + axis, round(new, 3))])


def skew(
    side_x: float, rising: float, falling: float, side_y: float | None = None, gauge: float = 0.05
) -> Result:
    """By how much the y axis leans towards +x, deg: the angle that `waam correct --y-to-x` wants.

    A frame that the machine drew or milled: the side along x and both diagonals, mm; `rising` from the corner at the
    origin. The side along y follows (2 x^2 + 2 y^2 = rising^2 + falling^2), or is given and checked. gauge: standard
    uncertainty of a length."""
    lengths = [side_x, rising, falling] + ([] if side_y is None else [side_y])
    x, up, down = _numbers('lengths of the frame', lengths, 3)[:3]
    square = 0.5 * (up**2 + down**2) - x**2
    if not square > 0:
        raise EvidenceError(
            f'no parallelogram with a side of {x:g} has diagonals of {up:g} and {down:g} mm'
        )
    y = math.sqrt(square) if side_y is None else float(side_y)
    if not SIDES[0] <= y / x <= SIDES[1]:
        raise EvidenceError(
            f'the frame would be {x:g} x {y:.1f} mm: was a diagonal taken for a side?'
        )
    if max(x, y) < MIN_TRAVEL:
        raise EvidenceError(
            f'a frame of {x:g} x {y:.1f} mm is too small, {MIN_TRAVEL:g} mm at least'
        )
    try:
        angle = angles_from_diagonals(float(x), y, float(up), float(down))
    except SkewError as e:
        raise EvidenceError(str(e)) from None
    if abs(angle) > math.radians(SKEW_MOST):
        raise EvidenceError(f'y would lean {math.degrees(angle):+.1f} deg: a typing error')
    sigma = math.degrees(math.hypot(up, down) * gauge / (2 * x * y * math.cos(angle)))
    if sigma > SKEW_SURE:
        text = f'a gauge of {gauge:g} mm tells this frame to {sigma:.3f} deg, {SKEW_SURE:g} deg are needed'
        raise EvidenceError(f'{text}: a larger frame or a better gauge')
    leans = math.degrees(angle)
    refuses = ''
    if abs(leans) > LARGEST_SKEW:
        refuses = f'y leans {leans:+.3f} deg to x, at most {LARGEST_SKEW:g} deg'
    text = f'y leans {leans:+.4f} +- {sigma:.4f} deg to x'
    values = {'y_to_x_deg': leans, 'side_y_mm': y}
    return Result('skew', '', text, values, {'standard_uncertainty_deg': sigma}, refuses=refuses)


def tool_point(widths: Sequence[float], slope: float, wire: float) -> Result:
    """Distance of the wire tip from the tool centre point, and how far it may be off.

    Steps that a bead shows on a flank: their widths (n,) mm, slope of the flank in degrees, diameter of wire or beam
    in mm. delta = t / sin(phi), at most D / (4 sin(phi))."""
    if not SLOPES[0] <= slope <= SLOPES[1]:
        raise EvidenceError(
            f'a slope of {slope:g} deg does not show the step: {SLOPES[0]:g} to {SLOPES[1]:g} deg'
        )
    if not 0.1 <= wire <= 20.0:
        raise EvidenceError(f'a diameter of {wire:g} mm: 0.1 to 20 mm')
    t = np.asarray(widths, float)
    if len(t) < MIN_MEASURED:
        raise EvidenceError(f'width: {len(t)} given, at least {MIN_MEASURED} are needed')
    if not (np.isfinite(t).all() and (t >= 0).all()):
        raise EvidenceError('a step width is negative or no number')
    sine = math.sin(math.radians(slope))
    offset, limit = float(t.mean()) / sine, wire / (4 * sine)
    sigma = float(t.std(ddof=1)) / math.sqrt(len(t)) / sine
    if sigma > TCP_SURE * limit:
        text = f'the widths scatter: {sigma:.3f} mm standard uncertainty, at most half the limit of {limit:.3f} mm'
        raise EvidenceError(f'{text}: measure again at more places')
    refuses = ''
    if offset > limit:
        refuses = f'the wire tip is {offset:.3f} mm off, limit {limit:.3f} mm'
    text = f'wire tip {offset:.3f} +- {sigma:.3f} mm off, limit {limit:.3f} mm'
    evidence = {'standard_uncertainty_mm': sigma, 'widths': float(len(t))}
    values = {'offset_mm': offset, 'limit_mm': limit}
    return Result('tcp', '', text, values, evidence, refuses=refuses)
