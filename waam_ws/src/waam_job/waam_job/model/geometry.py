"""Pure helpers of the job: where the part lies, how wrong the surface is, torch heights that follow the scan."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Kind, Point, Segment


def part_grid(bounds: np.ndarray, resolution: float, margin: float) -> GridSpec:
    """Grid over the part's bounding box plus margin (m); the box's lower corner is the work zero."""
    size = bounds[1] - bounds[0]
    return GridSpec.covering(-margin, -margin, size[0] + margin, size[1] + margin, resolution)


@dataclass(frozen=True)
class Deviation:
    """How far a surface is from its target, m: over the interior (the verdict) and the whole region (with edges)."""

    rms: float
    mean: float
    max: float
    share_in_tolerance: float
    rms_all: float
    coverage: float


def deviation(
    error: np.ndarray, region: np.ndarray, interior: np.ndarray, tolerance: float
) -> Deviation:
    """error, region, interior: (rows, cols); unseen cells (NaN) count against the share in tolerance."""
    inner, everywhere = error[interior], error[region]
    seen = inner[np.isfinite(inner)]
    if not seen.size:
        nan = float('nan')
        return Deviation(nan, nan, nan, 0.0, nan, 0.0)
    all_seen = everywhere[np.isfinite(everywhere)]
    return Deviation(
        rms=float(np.sqrt(np.mean(seen**2))),
        mean=float(seen.mean()),
        max=float(np.abs(seen).max()),
        share_in_tolerance=float((np.abs(seen) <= tolerance).sum() / inner.size),
        rms_all=float(np.sqrt(np.mean(all_seen**2))),
        coverage=float(seen.size / inner.size),
    )


def smooth(z: np.ndarray, sigma_cells: float) -> np.ndarray:
    """Gaussian mean of the known cells; NaN only where nothing known is near."""
    known = np.isfinite(z)
    weight = gaussian_filter(known.astype(float), sigma_cells)
    total = gaussian_filter(np.where(known, z, 0.0), sigma_cells)
    return np.where(weight > 1e-3, total / np.maximum(weight, 1e-12), np.nan)


def follow(segments: list[Segment], surface: HeightGrid, reach: float) -> list[Segment]:
    """Depositing points put on the measured surface (smoothed over `reach` m), so that the stick-out stays nominal.

    Idle pieces that begin or end in such a point follow it; points over unknown ground keep their planned height.
    """
    points: set[Point] = set()
    for s in segments:
        if s.kind == Kind.DEPOSIT:
            points.update((s.start, s.end))
    if not points:
        return segments
    ordered = sorted(points)
    ground = surface.with_z(smooth(surface.z, reach / surface.spec.resolution))
    xyz = np.array(ordered)
    z = ground.sample(xyz[:, 0], xyz[:, 1])
    new = {
        p: (p[0], p[1], float(h)) if np.isfinite(h) else p for p, h in zip(ordered, z, strict=True)
    }
    return [s.at(start=new.get(s.start, s.start), end=new.get(s.end, s.end)) for s in segments]


def asked_growth(
    planned: np.ndarray, psi: np.ndarray, k_gain: float, residual: np.ndarray
) -> np.ndarray:
    """Metal that the setpoints ask for per cell (m): planned / (1 + k_gain psi) + residual (docs/interfaces.md)."""
    growth = planned / (1.0 + k_gain * psi) + np.nan_to_num(residual)
    return np.where(planned > 0, growth, 0.0)
