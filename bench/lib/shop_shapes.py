"""What the parts of a repair shop are made from: grids in plan view, distances, uneven wear. All in mm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

STEP = 0.5  # of the grids
HEIGHT = 16.0
Map = np.ndarray  # (m, n) over the corners of a grid


@dataclass(frozen=True)
class Worn:
    """A body over a grid of quadrangles that may bend (`waam_lab.parts.body`)."""

    plan: np.ndarray  # (m, n, 2)
    nominal: Map
    wear: Map  # what is missing; below 0 counts as 0
    inside: Map | None = None  # the body is where this is positive; None = everywhere

    @property
    def kept(self) -> np.ndarray:
        """(m - 1, n - 1) bool, quadrangles with metal."""
        if self.inside is None:
            return np.ones((self.plan.shape[0] - 1, self.plan.shape[1] - 1), bool)
        on = self.inside > 0
        return on[:-1, :-1] & on[1:, :-1] & on[1:, 1:] & on[:-1, 1:]


def soft(d: Map, width: float) -> Map:
    """0 at and below 0, 1 from `width` on."""
    t = np.clip(d / width, 0, 1)
    return t * t * (3 - 2 * t)


def waves(x: Map, y: Map, size: float, turn: float) -> Map:
    """Uneven wear."""
    return size * (np.sin(x / 4.3 + turn) * np.cos(y / 5.1) + 0.5 * np.sin((x + 2 * y) / 7 + turn))


def over(length: float, width: float) -> tuple[np.ndarray, Map, Map]:
    """Grid of a rectangle: plan, x, y."""
    x, y = (np.linspace(0, end, round(end / STEP) + 1) for end in (length, width))
    plan = np.stack(np.meshgrid(x, y, indexing='ij'), axis=2)
    return plan, plan[..., 0], plan[..., 1]


def around(inner: float | Callable[[Map], Map], outer: float | Callable[[Map], Map]) -> tuple:
    """Grid between two outlines about a centre (radii, or functions of the angle in rad): plan, radius, angle."""
    angle = np.linspace(0, 2 * np.pi, 241)
    angle[-1] = 0.0
    low, high = (r(angle) if callable(r) else np.full(241, float(r)) for r in (inner, outer))
    share = np.linspace(0, 1, max(3, round(float((high - low).max()) / STEP) + 1))[:, None]
    radius = low + share * (high - low)
    plan = radius[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    plan = np.round(plan - plan.reshape(-1, 2).min(axis=0), 6)
    return plan, radius, np.broadcast_to(angle, radius.shape)


def along(length: float, thick: Callable[[Map], Map], bow: float) -> tuple[np.ndarray, Map, Map]:
    """Grid of a band, bent by `bow` rad over its length, `thick` a function of the share of its way: plan, share, and
    place across (-1 .. 1)."""
    share, across = np.meshgrid(
        np.linspace(0, 1, round(length / STEP) + 1), np.linspace(-1, 1, 13), indexing='ij'
    )
    angle, radius = (share - 0.5) * bow, length / bow - across * thick(share) / 2
    plan = np.stack([radius * np.sin(angle), -radius * np.cos(angle)], axis=2)
    return plan - plan.reshape(-1, 2).min(axis=0), share, across


def box(x: Map, y: Map, at: tuple[float, float], half: tuple[float, float], corner: float) -> Map:
    """Distance inside a rectangle with round corners about `at`."""
    dx, dy = abs(x - at[0]) - half[0] + corner, abs(y - at[1]) - half[1] + corner
    return (
        corner - np.hypot(np.maximum(dx, 0), np.maximum(dy, 0)) - np.minimum(np.maximum(dx, dy), 0)
    )
