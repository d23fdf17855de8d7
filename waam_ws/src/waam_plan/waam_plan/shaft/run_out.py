"""Run-out of a shaft in its chuck, from the scan of its unworn ends: eccentricity and tilt of its axis.

A round end whose axis lies beside that of the chuck has r(y, t) = R + size + ex(y) cos t + ey(y) sin t to first order
in the eccentricity over R (the first harmonic of a roundness profile, ISO 12181-1), and an axis that is straight
makes ex and ey linear in y. Both ends are fitted together by least squares. Wear all round has a first harmonic of
its own, so only ends that are told to be unworn can show it; what is no harmonic there is told as a residual, and
refused when it is too large.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_process.grid import GridSpec, HeightGrid
from waam_process.unrolled import ShaftError, Unrolled

EDGE = 1.5e-3  # m of an end that are left out: its edge, and the edge of the wear
SHORTEST = 8e-3  # m of an end
BLOCK = 6e-3  # m of the turn that count as one reading: what a scan has of errors is correlated
MOST_LEFT = 0.15e-3  # m RMS of the readings beside the fit, above which the ends are not round
MOST_SIZE = 0.5e-3  # m that the radius of the ends may differ from nominal
LEAST_SEEN = 0.8  # share of the readings of each end


@dataclass(frozen=True)
class RunOut:
    """What the ends show. Lengths in m."""

    size: float  # radius of the ends less the nominal one
    middle: float  # y where the coefficients are
    cos: tuple[float, float]  # of cos t: in the middle, and per m along y
    sin: tuple[float, float]  # of sin t
    sigma: float  # standard uncertainty of the eccentricity in the middle
    left: float  # RMS of the readings beside the fit

    def centre(self, y: float) -> tuple[float, float]:
        """Axis of the shaft beside that of the chuck at y (m): towards angle 0, and towards 90 degrees."""
        away = y - self.middle
        return self.cos[0] + self.cos[1] * away, self.sin[0] + self.sin[1] * away

    @property
    def eccentricity(self) -> float:
        """m, in the middle of the shaft; a dial gauge reads twice as much from peak to valley."""
        return math.hypot(self.cos[0], self.sin[0])

    @property
    def tilt(self) -> float:
        """m per m, of the shaft's axis against that of the chuck."""
        return math.hypot(self.cos[1], self.sin[1])

    def over(self, spec: GridSpec, shaft: Unrolled) -> np.ndarray:
        """(rows, cols) m that the run-out adds to the radius."""
        t, y = shaft.angle(spec.x), (spec.y - self.middle)[:, None]
        return (self.cos[0] + self.cos[1] * y) * np.cos(t) + (
            self.sin[0] + self.sin[1] * y
        ) * np.sin(t)

    @property
    def text(self) -> str:
        """For a person."""
        angle = math.degrees(math.atan2(self.sin[0], self.cos[0])) % 360.0
        beside, sigma = self.eccentricity * 1e3, self.sigma * 1e3
        return (
            f'run-out of the unworn ends: the axis lies {beside:.3f} +- {sigma:.3f} mm beside that of the chuck in the '
            f'middle, towards {angle:.0f} deg, tilted by {self.tilt * 1e3:.2f} mm/m; their radius is '
            f'{self.size * 1e3:+.3f} mm from nominal, {self.left * 1e3:.3f} mm RMS are left; it is taken out'
        )


def fit(found: HeightGrid, shaft: Unrolled, ends: float, length: float) -> RunOut:
    """found: scan in the work frame; ends: m of the shaft that are unworn at each end; length: m, of the shaft.

    ShaftError where the ends are too short, not seen, not round, or not of the nominal diameter.
    """
    if ends < SHORTEST or 2 * ends > length - 2 * SHORTEST:
        raise ShaftError(
            f'the unworn ends are {ends * 1e3:g} mm of {length * 1e3:g} mm each, must be {SHORTEST * 1e3:g} to '
            f'{1e3 * (length / 2 - SHORTEST):g} mm: without them the axis of the shaft is not known'
        )
    readings = [_readings(found, shaft, y0 + EDGE, y0 + ends - EDGE) for y0 in (0.0, length - ends)]
    t, y, z = (np.concatenate(v) for v in zip(*readings, strict=True))
    middle = length / 2
    away = y - middle
    columns = np.column_stack(
        [np.ones_like(t), np.cos(t), np.sin(t), away * np.cos(t), away * np.sin(t)]
    )
    found_at, *_ = np.linalg.lstsq(columns, z - shaft.level, rcond=None)
    left = z - shaft.level - columns @ found_at
    rms = float(np.sqrt(left @ left / max(len(left) - 5, 1)))
    if rms > MOST_LEFT:
        worst = int(np.argmax(np.abs(left)))
        place = f'y = {y[worst] * 1e3:.0f} mm, {np.degrees(t[worst]) % 360:.0f} deg'
        raise ShaftError(
            f'the unworn ends are not round: {rms * 1e3:.2f} mm RMS beside any axis, {left[worst] * 1e3:+.2f} mm at '
            f'{place}; they are worn, or shorter than {ends * 1e3:g} mm'
        )
    size, c0, s0, c1, s1 = (float(v) for v in found_at)
    if abs(size) > MOST_SIZE:
        raise ShaftError(
            f'the unworn ends have a diameter of {1e3 * (shaft.diameter + 2 * size):.2f} mm, not of '
            f'{shaft.diameter * 1e3:g} mm'
        )
    sigma = rms * math.sqrt(np.linalg.inv(columns.T @ columns)[1, 1])
    return RunOut(size, middle, (c0, c1), (s0, s1), sigma, rms)


def _readings(
    found: HeightGrid, shaft: Unrolled, y0: float, y1: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle (rad), y (m) and mean height (m) of the blocks of one end, each (n,)."""
    spec = found.spec
    rows = (spec.y >= y0) & (spec.y <= y1)
    cols = shaft.first_turn(spec)
    z = found.z[np.ix_(rows, cols)]
    count = max(8, round(shaft.period / BLOCK))
    block = ((spec.x[cols] - spec.x[cols][0]) / shaft.period * count).astype(int)
    angle = shaft.angle(spec.x[cols])
    t = np.array([angle[block == k].mean() for k in range(count)])
    some = [z[:, block == k] for k in range(count)]
    seen = np.array([np.isfinite(s).mean() if s.size else 0.0 for s in some]) > 0.5
    if seen.mean() < LEAST_SEEN:
        raise ShaftError(
            f'the scan shows {seen.mean():.0%} of the unworn end at y = {y0 * 1e3:.0f} to {y1 * 1e3:.0f} mm, at least '
            f'{LEAST_SEEN:.0%} of a full turn are needed'
        )
    means = np.array([np.nanmedian(s) for s, on in zip(some, seen, strict=True) if on])
    return t[seen], np.full(int(seen.sum()), 0.5 * (y0 + y1)), means
