"""A stored plan (plan.npz of `waam plan` and of a job) as arrays. SI, work frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from waam_process.grid import GridSpec
from waam_process.safe_files import parse_json, read_npz
from waam_process.segment import Kind


class PlanFileError(ValueError):
    """A file that is no plan; the text names it."""


@dataclass(frozen=True)
class Run:
    """n segments of one layer that follow each other with the arc on, or with it off."""

    layer: int
    arc: bool  # burning
    width: float  # m, of the bead
    points: np.ndarray  # (n + 1, 3) m
    times: np.ndarray  # (n + 1,) s since the start of the program
    height: np.ndarray  # (n,) m
    speed: np.ndarray  # (n,) m/s

    def thinned(self, every: int) -> Run:
        """Every so many points, the last one kept."""
        n = len(self.height)
        if every <= 1 or n <= 1:
            return self
        keep = np.unique(np.append(np.arange(0, n, every), n))
        first = keep[:-1]
        points, times = self.points[keep], self.times[keep]
        height, speed = self.height[first], self.speed[first]
        return Run(
            layer=self.layer,
            arc=self.arc,
            width=self.width,
            points=points,
            times=times,
            height=height,
            speed=speed,
        )


@dataclass(frozen=True)
class PlanFile:
    """A stored plan, as the viewer needs it. Surfaces are (rows, cols) m, NaN = unknown."""

    name: str
    mode: str
    warnings: list[str]
    settings: dict[str, Any]
    spec: GridSpec
    found: np.ndarray  # surface before the first layer
    nominal: np.ndarray  # surface that is wanted
    runs: list[Run]

    @property
    def layers(self) -> int:
        """Number of the last layer; 0 for an empty plan."""
        return max((r.layer for r in self.runs), default=0)

    @property
    def beads(self) -> list[Run]:
        """What is laid; each begins with an arc start."""
        return [r for r in self.runs if r.arc]

    @property
    def duration(self) -> float:
        """s from the first to the last move."""
        return float(self.runs[-1].times[-1]) if self.runs else 0.0


def read_plan(path: Path | str) -> PlanFile:
    """Raises PlanFileError."""
    try:
        data = read_npz(Path(path))
        about = parse_json(str(data['about']), 'about')
        (x, y), (rows, cols) = data['origin'].tolist(), data['nominal'].shape
        spec = GridSpec(x, y, float(data['resolution']), rows, cols)
        return PlanFile(
            name=about['name'],
            mode=about['mode'],
            warnings=list(about['warnings']),
            settings=about['settings'],
            spec=spec,
            found=data['as_found'],
            nominal=data['nominal'],
            runs=_runs(data),
        )
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, MemoryError) as error:
        raise PlanFileError(f'{path}: not a stored plan ({error})') from None


def read_settings(path: Path | str) -> dict[str, Any]:
    """Settings that a stored plan was made with. Raises PlanFileError."""
    try:
        settings = parse_json(str(read_npz(Path(path))['about']), 'about')['settings']
    except (KeyError, TypeError, ValueError) as error:
        raise PlanFileError(f'{path}: not a stored plan ({error})') from None
    if not isinstance(settings, dict):
        raise PlanFileError(f'{path}: not a stored plan (no settings)')
    return settings


def _runs(data: dict[str, np.ndarray]) -> list[Run]:
    length = np.linalg.norm(data['end'] - data['start'], axis=1)
    speed = np.where(data['speed'] > 0, data['speed'], np.inf)
    duration = np.where(data['kind'] == Kind.DWELL, data['dwell'], length / speed)
    times = np.append(0.0, np.cumsum(duration))
    layer, arc = data['layer'], data['arc']
    changes = np.flatnonzero((np.diff(layer) != 0) | (np.diff(arc.astype(int)) != 0)) + 1
    edges = [0, *changes.tolist(), len(layer)] if len(layer) else []
    return [_run(data, times, a, b) for a, b in zip(edges, edges[1:], strict=False)]


def _run(data: dict[str, np.ndarray], times: np.ndarray, a: int, b: int) -> Run:
    return Run(
        layer=int(data['layer'][a]),
        arc=bool(data['arc'][a]),
        width=float(data['width'][a:b].max()),
        points=np.concatenate([data['start'][a : a + 1], data['end'][a:b]]),
        times=times[a : b + 1],
        height=data['height'][a:b],
        speed=data['speed'][a:b],
    )
