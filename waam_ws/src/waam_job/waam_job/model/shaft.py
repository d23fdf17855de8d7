"""What is judged of a restored shaft beyond the error of its surface. Lengths in m, maps (rows, cols)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from waam_plan import finish
from waam_plan.plan import Plan
from waam_plan.shaft import run_out
from waam_process.unrolled import OVERLAP, Unrolled

from .stock import counted_area

UNDULATIONS = 50  # per turn, up to which a profile counts for roundness (ISO 12181-2)
ALL_ROUND = 0.95  # share of a turn that a profile needs
BESIDE_SEAM = 3e-3  # m on either side
LEFT_LOW = 1.0 - finish.CLEAN_SHARE


@dataclass(frozen=True)
class ShaftFigures:
    """NaN where nothing was laid all round, or nothing was seen."""

    clean_diameter: float = math.nan  # largest that the lathe reaches on the needed area
    # peak to valley about the least squares circle, mean over the profiles
    roundness: float = math.nan
    # of the new surface about the axis of the unworn ends, as a dial gauge reads it
    new_run_out: float = math.nan
    seam_step: float = math.nan  # of the new surface across the seam of the map
    # of the shaft beside the chuck's, as it was found
    axis: tuple[float, float] = (math.nan, math.nan)

    @property
    def text(self) -> str:
        """For people, as far as it is known."""
        told = [
            (self.clean_diameter, 'turned to {:.2f} mm it is clean'),
            (self.roundness, 'roundness {:.2f} mm'),
            (self.new_run_out, 'run-out {:.2f} mm'),
            (self.seam_step, 'step at the seam {:+.2f} mm'),
        ]
        return ', '.join(text.format(v * 1e3) for v, text in told if math.isfinite(v))

    def facts(self) -> dict[str, Any]:
        """For report.json (docs/job_folder.md)."""
        names = 'clean_diameter', 'roundness', 'new_run_out', 'seam_step'
        lengths = {f'{n}_mm': getattr(self, n) * 1e3 for n in names}
        return {**lengths, 'axis_mm': [v * 1e3 for v in self.axis]}


def figures(plan: Plan, z: np.ndarray) -> ShaftFigures | None:
    """plan: of the first pass; z: surface after the last layer. None for a part that lies still."""
    shaft = plan.settings.unrolled
    if shaft is None:
        return None
    on = shaft.first_turn(plan.spec)
    error = (z - plan.nominal.z)[:, on]
    laid = plan.interior[:, on] & np.isfinite(error)
    length = (
        float(plan.spec.y[np.isfinite(plan.nominal.z).any(axis=1)].max()) + plan.spec.resolution / 2
    )
    axis = run_out.fit(plan.as_found, shaft, plan.settings.shaft_ends, length)
    low = error[counted_area(plan)[:, on] & np.isfinite(error)]
    profiles = [
        np.where(laid[row], error[row], np.nan)
        for row in range(len(error))
        if laid[row].mean() >= ALL_ROUND
    ]
    rounds = np.array([_harmonics(p) for p in profiles]).reshape(-1, 2)
    return ShaftFigures(
        clean_diameter=shaft.diameter + 2 * float(np.quantile(low, LEFT_LOW))
        if low.size
        else math.nan,
        roundness=float(rounds[:, 0].mean()) if len(rounds) else math.nan,
        new_run_out=float(rounds[:, 1].mean()) if len(rounds) else math.nan,
        seam_step=_seam_step(error, laid, plan.spec.x[on], shaft),
        axis=axis.centre(length / 2),
    )


def _harmonics(profile: np.ndarray) -> tuple[float, float]:
    """Peak to valley without mean and first harmonic, and twice the amplitude of that. profile: (n,) m, one turn, NaN
    where it is not known."""
    known = np.isfinite(profile)
    at = np.arange(len(profile))
    whole = np.interp(at, at[known], profile[known], period=len(profile))
    waves = np.fft.rfft(whole)
    waves[UNDULATIONS + 1 :] = 0
    twice = 4 * abs(waves[1]) / len(whole)
    waves[:2] = 0
    return float(np.ptp(np.fft.irfft(waves, len(whole)))), float(twice)


def _seam_step(error: np.ndarray, laid: np.ndarray, x: np.ndarray, shaft: Unrolled) -> float:
    """Mean height behind the seam less that before it; NaN where nothing is laid there."""
    behind, before = x < OVERLAP + BESIDE_SEAM, x >= OVERLAP + shaft.period - BESIDE_SEAM
    both = np.asarray(laid[:, behind].any(axis=1) & laid[:, before].any(axis=1))[:, None]
    sides = [error[laid & both & side] for side in (behind, before)]
    return float(sides[0].mean() - sides[1].mean()) if all(s.size for s in sides) else math.nan
