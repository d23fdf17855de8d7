"""Moves without arc must not run through metal: those of a program, against what it has laid by then."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_plan import masks
from waam_plan.import_gcode.layers import Bead, Layer
from waam_plan.plan import PlanError
from waam_plan.settings import PlanSettings
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

MARGIN = 0.5e-3  # m over the metal


@dataclass
class Metal:
    """Highest metal so far, (rows, cols) m."""

    spec: GridSpec
    z: np.ndarray

    @classmethod
    def on(cls, spec: GridSpec, found: np.ndarray) -> Metal:
        """found: (rows, cols) m, NaN where nothing is known."""
        return cls(spec, np.where(np.isfinite(found), found, -np.inf))

    def add(self, run: list[Segment]) -> None:
        """What a bead leaves: its height over its width."""
        deposits = [s for s in run if s.kind == Kind.DEPOSIT]
        if not deposits:
            return
        points = np.vstack([_along(np.array([s.start, s.end]), self.spec) for s in deposits])
        top = max(s.start[2] + s.height for s in deposits)
        row, col = self.spec.cell(points[:, 0], points[:, 1])
        reach = math.ceil(deposits[0].width / 2 / self.spec.resolution)
        rows = slice(max(0, row.min() - reach), max(0, row.max() + reach + 1))
        cols = slice(max(0, col.min() - reach), max(0, col.max() + reach + 1))
        part = np.zeros(self.z[rows, cols].shape, bool)
        inside = self.spec.contains(points[:, 0], points[:, 1])
        if not inside.any():
            return
        part[row[inside] - rows.start, col[inside] - cols.start] = True
        covered = masks.overrun(part, ~part, reach)
        self.z[rows, cols] = np.where(
            covered, np.maximum(self.z[rows, cols], top), self.z[rows, cols]
        )

    def above(self, points: np.ndarray) -> np.ndarray:
        """(n,) m of metal over the points (n, 3), below 0 where there is air."""
        row, col = self.spec.cell(points[:, 0], points[:, 1])
        inside = self.spec.contains(points[:, 0], points[:, 1])
        out = np.full(len(points), -np.inf)
        out[inside] = self.z[row[inside], col[inside]] - points[inside, 2]
        return out


def _along(ends: np.ndarray, spec: GridSpec) -> np.ndarray:
    count = 2 + int(math.dist(*ends) / (0.5 * spec.resolution))
    return np.linspace(ends[0], ends[1], count)


def check_way(
    layer: Layer, runs: list[list[Segment]], metal: Metal, settings: PlanSettings
) -> None:
    """Adds the beads of a layer to the metal. PlanError naming the line of a move that would run through it.

    Next to the bead that ends and the one that begins, half a bead and more, the wire may be as low as these are.
    """
    metal.add(runs[0])
    for bead, run in zip(layer.beads[1:], runs[1:], strict=True):
        _check(bead, metal, settings)
        metal.add(run)


def _check(bead: Bead, metal: Metal, settings: PlanSettings) -> None:
    moves = [m for m in bead.way if not m.dwell and m.length > 0]
    if not moves:  # also from an unknown place, which becomes a hop
        return
    ends = np.array([moves[0].start, moves[-1].end])[:, :2]
    for m in moves:
        points = np.vstack(
            [
                _along(np.array(e), metal.spec)
                for e in zip(m.corners(), m.corners()[1:], strict=False)
            ]
        )
        near = np.linalg.norm(points[:, None, :2] - ends[None], axis=2).min(axis=1)
        high = metal.above(points)[near > settings.bead_width]
        if high.size and float(high.max()) > -MARGIN:
            depth = float(high.max()) * 1e3
            how = f'{depth:.1f} mm deep in metal' if depth > 0.05 else 'along the metal'
            raise PlanError(
                f'line {m.line}: the way to the bead of line {bead.line} runs {how} that lies there by then; let the '
                'slicer lift there, or lift by the dialect (idle: lift)'
            )
