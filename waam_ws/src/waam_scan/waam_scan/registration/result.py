"""What a registration found, and what it could not."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


class RegistrationError(ValueError):
    """Clouds that cannot be brought together; the text says why."""


@dataclass(frozen=True)
class Registration:
    """p_reference = rotation @ p + translation."""

    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,) m
    centre: np.ndarray  # (3,) m, middle of the moving cloud
    # (6, 6), motion of the centre (m), rotation (rad); infinite where unobserved
    covariance: np.ndarray
    unobserved: list[str]  # motions that the shape does not show, in words
    free: np.ndarray  # (6, k) the same as directions (m, rad)
    noise: float  # m, robust scatter of the pairs
    used: int  # points that decided
    compared: int  # points with a partner
    changed: float  # share of these where metal was added or taken away
    converged: bool
    points: np.ndarray = field(repr=False)  # (n, 3) m, for pictures
    before: np.ndarray = field(repr=False)  # (n,) m, distance of the points to the reference
    after: np.ndarray = field(repr=False)  # (n,) m
    notes: list[str] = field(default_factory=list)

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4)"""
        m = np.eye(4)
        m[:3, :3], m[:3, 3] = self.rotation, self.translation
        return m

    @property
    def sigma(self) -> np.ndarray:
        """(6,) standard uncertainty of the motion of the centre (m) and of the rotation (rad)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def shift(self) -> np.ndarray:
        """(3,) m, motion of the centre."""
        return self.rotation @ self.centre + self.translation - self.centre

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Moves points (n, 3)."""
        return points @ self.rotation.T + self.translation
