"""The way of a robot's moves, whatever the language of its program. SI, radians, work frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_plan.gcode.compact import Move, circle
from waam_process.segment import Point

TOLERANCE = 4e-6  # m, between the moves of a program and the path of the plan; a corner of 6 um beside it makes 10


class RobotProgramError(ValueError):
    """A program that cannot be written; the text names the field or the place."""


@dataclass(frozen=True)
class Course:
    """The way of a move from `start`: places at any length along it, m."""

    start: np.ndarray
    end: np.ndarray
    centre: np.ndarray | None
    across: (
        tuple[np.ndarray, np.ndarray] | None
    )  # unit vectors from the centre, the first to the start
    radius: float
    sweep: float

    @property
    def length(self) -> float:
        """m"""
        if self.centre is None:
            return float(np.linalg.norm(self.end - self.start))
        return self.radius * self.sweep

    @property
    def curvature(self) -> float:
        """1/m"""
        return 1 / self.radius if self.across is not None else 0.0

    def at(self, way: np.ndarray) -> np.ndarray:
        """(N, 3) at lengths (N,) from the start."""
        way = np.asarray(way, float)
        if self.centre is None or self.across is None:
            share = way / self.length if self.length > 0 else np.zeros_like(way)
            return np.asarray(self.start + share[:, None] * (self.end - self.start))
        angle = (way / self.radius)[:, None]
        u, v = self.across
        return np.asarray(self.centre + self.radius * (np.cos(angle) * u + np.sin(angle) * v))

    def tangents(self) -> tuple[np.ndarray, np.ndarray]:
        """Directions of travel at both ends."""
        if self.across is None:
            along = (self.end - self.start) / max(self.length, 1e-12)
            return along, along
        u, v = self.across
        c, s = math.cos(self.sweep), math.sin(self.sweep)
        return v, c * v - s * u


def course(start: Point, move: Move) -> Course:
    """The way of a move. Three points on a line are a line."""
    a, b = np.array(start, float), np.array(move.end, float)
    if move.via is None:
        return Course(a, b, None, None, 0.0, 0.0)
    m = np.array(move.via, float)
    centre, radius = circle(a, m, b)
    if not math.isfinite(radius):
        return Course(a, b, None, None, 0.0, 0.0)
    u = (a - centre) / radius
    normal = np.cross(m - a, b - a)
    v = np.cross(normal / np.linalg.norm(normal), u)
    sweep = math.atan2((b - centre) @ v, (b - centre) @ u) % (2 * math.pi)
    return Course(a, b, centre, (u, v), radius, sweep)
