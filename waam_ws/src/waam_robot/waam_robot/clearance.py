"""Joint paths of whole parts that touch nothing: a bead is checked against what stands when it is laid (needs coal).

The part grows bead by bead, and within a bead too: what was laid more than OWN behind the torch counts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .bead import Bead
from .bodies import NAMES
from .collision import Scene
from .joint_path import BeadPath, Refused, plan
from .ways import WayError, way_between

STRETCH = 20e-3  # m of a bead that are looked at with the same part
OWN = 15e-3  # m behind the torch
ANYWHERE = ('nozzle',)  # turns about its own axis only, so spin and branch do not matter to it


def plan_clear(beads: list[Bead], scene: Scene, width: float = 6e-3) -> list[BeadPath]:
    """`joint_path.plan` on the machine of the scene, without contacts. PlanError: bead, place and what is too near.

    width: m, of the beads. Nothing is said of the ways between them (`plan_part`).
    """
    return plan(beads, scene.machine, _refusing(_laid(beads, scene, width), scene))


def plan_part(
    beads: list[Bead], scene: Scene, width: float = 6e-3
) -> tuple[list[BeadPath], list[np.ndarray]]:
    """`plan_clear`, and the ways (N, 8) rad from each bead to the next, straight in the joints between their places.
    WayError (a PlanError) where no such way was found."""
    laid = _laid(beads, scene, width)
    paths = plan(beads, scene.machine, _refusing(laid, scene))
    ways = []
    for n, (before, after) in enumerate(zip(paths, paths[1:], strict=False)):
        try:
            ways.append(way_between(before, after, scene, int(laid[n][1][-1])))
        except WayError as e:
            raise WayError(f'the way from bead {n} to bead {n + 1}: {e}') from None
    return paths, ways


_Laid = list[tuple[np.ndarray, np.ndarray]]


def _laid(beads: list[Bead], scene: Scene, width: float) -> _Laid:
    """Lays the beads in the scene. For each: points at which stretches of it begin and end, and how many pieces the
    part has there."""
    counts: _Laid = []
    for bead in beads:
        marks = _marks(bead)
        laid = [scene.lay(bead.points[a : b + 1], width) for a, b in _pairs(marks)]
        before = counts[-1][1][-1] if counts else 0
        counts.append((marks, np.array([before, *laid])))
    return counts


def _refusing(counts: _Laid, scene: Scene) -> Callable[[int, BeadPath], Refused | None]:
    """For `joint_path.plan`: refuses paths that touch what is there before them."""

    def refuse(number: int, path: BeadPath) -> Refused | None:
        marks, laid = counts[number]
        way = path.bead.way
        for a, b in _pairs(marks):
            behind = int(np.searchsorted(way[marks], way[a] - OWN, 'right')) - 1
            found = scene.first(path.joints[a : b + 1], int(laid[max(behind, 0)]))
            if found is not None:
                fixed = found.bodies[0] in ANYWHERE and found.bodies[1] not in NAMES
                return Refused(float(way[a + found.at]), found.text, fixed)
        return None

    return refuse


def _marks(bead: Bead) -> np.ndarray:
    """Points at which stretches of the bead begin and end."""
    count = max(1, int(np.ceil(bead.length / STRETCH)))
    marks = np.searchsorted(bead.way, np.linspace(0, bead.length, count + 1)[1:-1])
    return np.array([0, *marks, len(bead.points) - 1])


def _pairs(marks: np.ndarray) -> list[tuple[int, int]]:
    return [(int(a), int(b)) for a, b in zip(marks, marks[1:], strict=False)]
