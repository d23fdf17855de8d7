"""Passes over an artefact: profiles with stamps, and where the wire tip was meanwhile."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

MAX_GAP_NS = 250_000_000


class ScanError(ValueError):
    """A pass that cannot be used; the text names file and field."""


@dataclass(frozen=True)
class Pass:
    """One pass of n profiles."""

    stamps: np.ndarray  # (n,) int64 ns of the profiles
    x: np.ndarray  # (n, m) m, scanner frame, NaN = no return
    z: np.ndarray  # (n, m) m
    pose_stamps: np.ndarray  # (k,) int64 ns, rising
    poses: np.ndarray  # (k, 3) m, wire tip, work frame
    name: str = 'pass'

    def __post_init__(self) -> None:
        n, k = len(self.stamps), len(self.pose_stamps)
        if self.x.ndim != 2 or self.x.shape != self.z.shape or len(self.x) != n:
            raise ScanError(
                f'{n} stamps, x {self.x.shape} and z {self.z.shape} do not fit together'
            )
        if self.poses.shape != (k, 3) or k < 2:
            raise ScanError(f'{k} pose stamps and poses {self.poses.shape} do not fit together')
        if not (np.diff(self.pose_stamps) > 0).all():
            raise ScanError('pose_stamps must rise strictly')
        if not np.isfinite(self.poses).all():
            raise ScanError('poses must be finite')


@dataclass(frozen=True)
class Points:
    """Returns of all passes in one row."""

    local: np.ndarray  # (n, 3) m, scanner frame
    profile: np.ndarray  # (n,) index into the tables of `Motion`
    rejected: int  # profiles without poses on both sides


class Motion:
    """Where the wire tip was when the profiles of all passes were taken, for any delay of the profile stamps."""

    def __init__(self, passes: list[Pass]) -> None:
        self.passes = passes
        self.of_pass = np.repeat(np.arange(len(passes)), [len(p.stamps) for p in passes])

    def at(self, delay: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n, 3) in m and velocities (n, 3) in m/s at stamps + delay (s); held beyond the ends."""
        found = [_interpolate(p, delay) for p in self.passes]
        return np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])

    def directions(self) -> np.ndarray:
        """(3,) m, how much the wire tip moved along x, y and z altogether (sum of |steps|)."""
        return sum(np.abs(np.diff(p.poses, axis=0)).sum(axis=0) for p in self.passes)


def _interpolate(p: Pass, delay: float) -> tuple[np.ndarray, np.ndarray]:
    start = p.pose_stamps[0]
    t = (p.stamps - start) * 1e-9 + delay
    knots = (p.pose_stamps - start) * 1e-9
    i = np.clip(np.searchsorted(knots, t) - 1, 0, len(knots) - 2)
    velocity = (p.poses[i + 1] - p.poses[i]) / (knots[i + 1] - knots[i])[:, None]
    share = np.clip(t - knots[i], 0.0, knots[i + 1] - knots[i])
    return p.poses[i] + velocity * share[:, None], velocity


def gather(passes: list[Pass], limit: int, slack: float, seed: int = 0) -> Points:
    """At most `limit` returns, drawn evenly; profiles need poses on both sides, `slack` (s) away too."""
    if not passes:
        raise ScanError('no pass was given')
    local, profile, first, rejected = [], [], 0, 0
    for p in passes:
        known = _posed(p, slack)
        rejected += int((~known).sum())
        i, j = np.nonzero(known[:, None] & np.isfinite(p.x) & np.isfinite(p.z))
        local.append(np.column_stack([p.x[i, j], np.zeros(len(i)), p.z[i, j]]))
        profile.append(first + i)
        first += len(p.stamps)
    points, index = np.concatenate(local), np.concatenate(profile)
    if len(points) > limit:
        pick = np.sort(np.random.default_rng(seed).choice(len(points), limit, replace=False))
        points, index = points[pick], index[pick]
    return Points(points, index, rejected)


def _posed(p: Pass, slack: float) -> np.ndarray:
    """(n,) bool: poses on both sides of the stamp even when it is moved by `slack` s, and without a gap."""
    margin = round(slack * 1e9)
    inside = (p.stamps - margin >= p.pose_stamps[0]) & (p.stamps + margin <= p.pose_stamps[-1])
    after = np.clip(np.searchsorted(p.pose_stamps, p.stamps), 1, len(p.pose_stamps) - 1)
    return inside & (p.pose_stamps[after] - p.pose_stamps[after - 1] <= MAX_GAP_NS)
