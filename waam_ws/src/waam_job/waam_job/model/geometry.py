"""Pure helpers of the job: grid of the part, deviation of the surface, torch heights that follow the scan."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from waam_process.grid import GridSpec, HeightGrid
from waam_process.materials import Material
from waam_process.segment import Clamp, Kind, Point, Segment
from waam_process.unrolled import Unrolled

from .snapshots import LaidBeads

LIMITS = Clamp.SPEED_LOW | Clamp.SPEED_HIGH | Clamp.FEED_LOW | Clamp.FEED_HIGH
FOLLOWED = 3e-3  # m; the torch does not follow ground farther than this from its planned height


def part_grid(bounds: np.ndarray, resolution: float, margin: float) -> GridSpec:
    """Grid over a box (2, 3) in the work frame plus margin (m)."""
    (x0, y0), (x1, y1) = bounds[:, :2]
    return GridSpec.covering(x0 - margin, y0 - margin, x1 + margin, y1 + margin, resolution)


@dataclass(frozen=True)
class Deviation:
    """How far a surface is from its target, m: over the judged area (interior) and the whole region (with its rim).

    NaN where no grid cell of the judged area was seen.
    """

    rms: float
    mean: float
    max: float  # of the absolute error
    share_in_tolerance: float  # unseen grid cells are out of tolerance
    rms_all: float  # rim included
    share_all: float  # in tolerance, rim included
    coverage: float  # seen share of the judged area
    cells: int  # grid cells of the judged area

    @property
    def seen(self) -> bool:
        """Whether there is anything to judge."""
        return math.isfinite(self.rms)


NOTHING_SEEN = Deviation(
    rms=math.nan,
    mean=math.nan,
    max=math.nan,
    share_in_tolerance=math.nan,
    rms_all=math.nan,
    share_all=math.nan,
    coverage=0.0,
    cells=0,
)


def deviation(
    error: np.ndarray, region: np.ndarray, interior: np.ndarray, tolerance: float
) -> Deviation:
    """error, region, interior: (rows, cols); unseen grid cells (NaN) count against the share in tolerance."""
    inner, everywhere = error[interior], error[region]
    seen = inner[np.isfinite(inner)]
    if not seen.size:
        return replace(NOTHING_SEEN, cells=int(inner.size))
    all_seen = everywhere[np.isfinite(everywhere)]
    return Deviation(
        rms=float(np.sqrt(np.mean(seen**2))),
        mean=float(seen.mean()),
        max=float(np.abs(seen).max()),
        share_in_tolerance=float((np.abs(seen) <= tolerance).sum() / inner.size),
        rms_all=float(np.sqrt(np.mean(all_seen**2))),
        share_all=float((np.abs(all_seen) <= tolerance).sum() / everywhere.size),
        coverage=float(seen.size / inner.size),
        cells=int(inner.size),
    )


def smooth(z: np.ndarray, sigma_cells: float) -> np.ndarray:
    """z (rows, cols): Gaussian mean of the known cells; NaN only where nothing known is near."""
    known = np.isfinite(z)
    weight = gaussian_filter(known.astype(float), sigma_cells)
    total = gaussian_filter(np.where(known, z, 0.0), sigma_cells)
    return np.where(weight > 1e-3, total / np.maximum(weight, 1e-12), np.nan)


def follow(
    segments: list[Segment], surface: HeightGrid, reach: float, shaft: Unrolled | None = None
) -> list[Segment]:
    """Moves depositing points onto the measured surface (smoothed over `reach` m), so that the stick-out stays nominal.

    Cells that differ from the planned height nearby by more than FOLLOWED are another surface: the floor beside a thin
    wall would draw the torch down into it. Idle pieces that begin or end in a moved point follow it; points over
    unknown ground keep their planned height. shaft: that turns, its places come round again.
    """
    points: set[Point] = set()
    for s in segments:
        if s.kind == Kind.DEPOSIT:
            points.update((s.start, s.end))
    if not points:
        return segments
    ordered = sorted(points)
    xyz = np.array(ordered)
    if shaft:
        xyz[:, 0] = shaft.folded(xyz[:, 0])
    x, y = np.meshgrid(surface.spec.x, surface.spec.y)
    near = cKDTree(xyz[:, :2]).query(np.stack([x, y], axis=-1))[1]
    own = np.abs(surface.z - xyz[near, 2]) <= FOLLOWED
    ground = surface.with_z(
        smooth(np.where(own, surface.z, np.nan), reach / surface.spec.resolution)
    )
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


def driven_growth(
    asked: np.ndarray, planned: np.ndarray, spec: GridSpec, segments: Sequence[Segment]
) -> np.ndarray:
    """What the setpoints lay per cell (m): what was asked for, but where the nearest segment met a limit of speed or
    feed, what it is driven with over what it was planned with. Factors of the whole layer's feed are left out.

    asked, planned: (rows, cols) m, on `spec`; segments: with their setpoints, in the frame of the grid.
    """
    deposits = [s for s in segments if s.kind == Kind.DEPOSIT]
    limited = np.array([bool(s.clamps & LIMITS) for s in deposits])
    rows, cols = np.nonzero(planned > 0)
    if not limited.any() or not len(rows):
        return asked
    share = np.array([_driven_share(s) if s.clamps & LIMITS else 1.0 for s in deposits])
    points = np.array([s.midpoint[:2] for s in deposits])
    away, near = cKDTree(points).query(np.stack([spec.x[cols], spec.y[rows]], axis=1))
    driven = asked.copy()
    here = limited[near] & (away < np.array([max(s.width, s.length) for s in deposits])[near])
    driven[rows[here], cols[here]] = planned[rows[here], cols[here]] * share[near[here]]
    return driven


def _driven_share(s: Segment) -> float:
    """Metal per mm of a segment over that of its plan, without the factors of the whole layer."""
    planned = s.wire_feed_base / s.speed_programmed * s.heat_factor * s.flow_factor
    return s.wire_feed_speed / s.speed / planned


def aim_point(segments: list[Segment]) -> Point | None:
    """Where a pyrometer sees the metal that these segments lay: their middle, or the deposit nearest to it.

    m, frame of the segments; None when nothing is laid. The middle of a full area hardly moves from layer to layer;
    that of a ring lies beside the metal.
    """
    deposits = [s for s in segments if s.kind == Kind.DEPOSIT]
    if not deposits:
        return None
    points = np.array([s.midpoint for s in deposits])
    x, y, z = aim_at(points, np.array([s.length for s in deposits]), [s.width for s in deposits])
    return x, y, z


def aim_at(points: np.ndarray, lengths: np.ndarray, widths: Sequence[float]) -> list[float]:
    """`aim_point` of deposits by their middles (n, 2 or 3), lengths and widths (n,), m."""
    middle = np.average(points, axis=0, weights=lengths)
    away = np.hypot(*(points - middle)[:, :2].T)
    nearest = int(np.argmin(away))
    if away[nearest] > 0.5 * widths[nearest]:
        middle = points[nearest]
    return [float(v) for v in middle]


def laid_beads(segments: list[Segment], material: Material) -> LaidBeads:
    """Stretches from arc on to arc off, with the bead width that the material table expects of every piece."""
    paths: list[list[tuple[float, float]]] = []
    widths: list[list[float]] = []
    burning = False
    for s in segments:
        if s.arc:
            width = _expected_width(s, material)
            if not burning:
                paths.append([s.start[:2]])
                widths.append([width])
            paths[-1].append(s.end[:2])
            widths[-1].append(width)
        burning = s.arc
    return LaidBeads(tuple(map(np.array, paths)), tuple(map(np.array, widths)))


def _expected_width(s: Segment, material: Material) -> float:
    """m, by the setpoints of a segment; the planned one where it has none."""
    if not (s.wire_feed_speed > 0 and s.speed > 0):
        return s.width
    return material.width(s.wire_feed_speed, s.speed, s.voltage or material.voltage)
