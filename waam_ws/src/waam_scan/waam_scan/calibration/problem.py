"""What the calibration solves: unknowns, residuals of profile points against the artefact, and prior knowledge."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..transform import Mounting
from .artefact import Artefact
from .robust import turn_vector, turned
from .scan_pass import Motion, Points

# what counts as observed: the demanded accuracy; also the scale between lengths, angles and times
TOLERANCE = np.array([20e-6] * 3 + [np.radians(0.02)] * 3 + [0.5e-3])
SCALE = np.concatenate([TOLERANCE, TOLERANCE[:6]])
WEAK = 1000.0  # tolerances by which a start value may be wrong: holds unobserved parameters, hardly moves others


@dataclass
class State:
    """offset, rotation, delay of the scanner; position and rotation of the artefact (work frame)."""

    offset: np.ndarray
    rotation: np.ndarray
    delay: float
    position: np.ndarray
    turn: np.ndarray

    def moved(self, step: np.ndarray) -> State:
        """After a step (13,): offset m, rotation rad, delay s, position m, turn rad; rotations about the work axes."""
        return State(
            self.offset + step[:3],
            turned(step[3:6]) @ self.rotation,
            self.delay + step[6],
            self.position + step[7:10],
            turned(step[10:13]) @ self.turn,
        )


@dataclass(frozen=True)
class Problem:
    """Profile points of all passes, the motion behind them, and the artefact and mounting to start from."""

    points: Points
    motion: Motion
    artefact: Artefact
    start: Mounting

    def take(self, count: int, rng: np.random.Generator) -> Problem:
        """The same problem with at most `count` points, drawn without replacement and kept in order."""
        n = len(self.points.profile)
        pick = np.sort(rng.choice(n, min(n, count), replace=False))
        points = replace(
            self.points, local=self.points.local[pick], profile=self.points.profile[pick]
        )
        return replace(self, points=points)

    def linear(self, s: State) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Residuals (n,), Jacobian (n, 13), surface numbers (n,) and whether each point counts (n,)."""
        tcp, velocity = self.motion.at(s.delay)
        k = self.points.profile
        arm = self.points.local @ s.rotation.T
        p = tcp[k] + s.offset + arm
        from_artefact = p - s.position
        c = self.artefact.contact(from_artefact @ s.turn)
        normal = c.normal @ s.turn.T
        jacobian = np.column_stack(
            [
                normal,
                np.cross(arm, normal),
                np.einsum('ij,ij->i', normal, velocity[k]),
                -normal,
                -np.cross(from_artefact, normal),
            ]
        )
        return c.distance, jacobian, c.face, c.good

    def prior(self, s: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Deviation from the start values and from the artefact's stated pose (13,), the information that these carry
        (13,), and which parameters are free (13,)."""
        sigmas = self.artefact.sigmas
        deviation = np.concatenate(
            [
                s.offset - self.start.offset,
                turn_vector(s.rotation @ self.start.rotation.T),
                [s.delay - self.start.delay],
                s.position - self.artefact.position,
                turn_vector(s.turn @ self.artefact.rotation.T),
            ]
        )
        free = np.concatenate([np.ones(7, bool), sigmas > 0])
        known = np.concatenate([WEAK * TOLERANCE, np.where(sigmas > 0, sigmas, np.inf)])
        return deviation, 1.0 / known**2, free
