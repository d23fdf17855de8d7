"""Speeds of segments that the drives can hold, before they are queued. Pure.

The controller core moves at the programmed speed; it knows no joints. So segments whose speed would ask more of a joint
than it has are slowed down here. Along every stretch without a sharp corner TOPPRA (`waam_robot.timing`) finds the
fastest speed under the limits of speed, acceleration and jerk, up to the programmed one. Without toppra the limits of
speed alone count, place by place. With the arc on, the wire is slowed down as the torch is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

from waam_bridge.program import BAD_SEGMENT, Refusal
from waam_process.segment import Kind, Point, Segment
from waam_robot.bead import make_bead
from waam_robot.station import Reach, StationError
from waam_robot.timing import SHARE, TimingError, time_bead

from .blend import MIN_TURN
from .limits import TORCH
from .params import RobotParams

STEP = 2e-3  # m between the places that are looked at
POINT = 0.5e-3  # m between the points that TOPPRA gets
TINY = 1e-6  # share: less is no slowing down
LIBRARY = 'TOPPRA'
OWN = 'the limits of speed alone (toppra is not installed: pip install -r requirements-robot.txt)'


@dataclass(frozen=True)
class Slowed:
    """count: segments that were slowed down; share: the least of the programmed speed; joint: which one holds it."""

    count: int
    share: float
    joint: str
    by: str

    @property
    def text(self) -> str:
        """One line for people."""
        return (
            f'{self.count} segments are slowed down, to {self.share:.0%} of the programmed speed at the least, because '
            f'{self.joint} cannot go faster; by {self.by}'
        )


class Pacer:
    """Used as `waam_bridge.core.Bridge.pace`. `by`: what times the segments. `on_slowed` is told about each batch."""

    def __init__(self, station: Reach, params: RobotParams) -> None:
        self._station, self._limits = station, params.limits_of_joints()
        self._corner, self._least = params.corner, (params.arc_speed_min, params.wire_feed_min)
        self.by = LIBRARY if find_spec('toppra') else OWN
        self.on_slowed: Callable[[Slowed], None] = lambda slowed: None

    def __call__(self, segments: Sequence[Segment], zero: Point) -> list[Segment]:
        """The segments (work frame; zero: m, machine coordinates), none faster than the drives allow. Refusal for one
        that would be too slow for the arc."""
        out = list(segments)
        worst, joint = 1.0, ''
        for run in _runs(out):
            some = [out[n] for n in run]
            shares, name = self._shares(some, zero)
            if shares.min() < worst:
                worst, joint = float(shares.min()), name
            for n, share in zip(run, shares.tolist(), strict=True):
                if share < 1 - TINY:
                    out[n] = self._slower(out[n], share, name)
        count = sum(a is not b for a, b in zip(out, segments, strict=True))
        if count:
            self.on_slowed(Slowed(count, worst, joint, self.by))
        return out

    def _shares(self, run: list[Segment], zero: Point) -> tuple[np.ndarray, str]:
        """((n,) shares of their speeds that are possible, the joint that holds them most)."""
        speeds = np.array([s.speed for s in run])
        usual = np.ones(len(run)), ''
        most = self._station.gains * speeds.max() / self._limits.speed
        if most.max() <= SHARE:  # anywhere in the box
            return usual
        corners = np.array([run[0].start, *(s.end for s in run)]) + zero
        try:
            asked, joint = self._asked(corners, speeds)
        except StationError:  # the box is what such a segment is refused by
            return usual
        possible = np.minimum(1.0, SHARE / np.maximum(asked, 1e-12))
        if possible.min() >= 1 or self.by != LIBRARY:
            return possible, joint
        return np.minimum(possible, self._timed(corners, speeds)), joint

    def _asked(self, corners: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, str]:
        """((n,) largest share of a joint's speed along each segment, the joint of the largest)."""
        lengths = np.linalg.norm(np.diff(corners, axis=0), axis=1)
        counts = np.maximum(np.ceil(lengths / STEP), 1).astype(int)
        of = np.repeat(np.arange(len(speeds)), counts)
        along = np.concatenate([np.arange(n) / n for n in counts])
        points = corners[of] + along[:, None] * np.diff(corners, axis=0)[of]
        joints = self._station.joints(np.vstack([points, corners[-1:]]))
        rates = np.abs(np.diff(joints, axis=0)) * (speeds * counts / lengths)[of, None]
        shares = rates / self._limits.speed
        found = np.zeros(len(speeds))
        np.maximum.at(found, of, shares.max(axis=1))
        return found, self._limits.names[int(shares.max(axis=0).argmax())]

    def _timed(self, corners: np.ndarray, speeds: np.ndarray) -> np.ndarray:
        """(n,) shares by TOPPRA, 1 where the torch is only starting or stopping."""
        try:
            bead = make_bead(corners, step=POINT, corner=self._corner)
            fastest = float(speeds.max())
            timed = time_bead(bead, self._station.joints(bead.points), fastest, self._limits)
        except (TimingError, StationError, ValueError):
            return np.ones(len(speeds))
        ramp = fastest**2 / TORCH  # twice what it takes
        whole = timed.way[-1]
        ends = np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))
        inner = (timed.way > ramp) & (timed.way < whole - ramp)
        of = np.searchsorted(ends / ends[-1], timed.way[inner] / whole).clip(0, len(speeds) - 1)
        least = speeds.copy()
        np.minimum.at(least, of, timed.speed[inner])
        return np.asarray(least / speeds)

    def _slower(self, s: Segment, share: float, joint: str) -> Segment:
        speed, wire = s.speed * share, s.wire_feed_speed * share
        if not s.arc:
            return s.at(speed=speed)
        if speed < self._least[0] or wire < self._least[1]:
            raise Refusal(
                BAD_SEGMENT,
                f'segment {s.index}: {joint} allows {speed * 1e3:.2f} mm/s and {wire * 60:.2f} m/min of wire, with the '
                f'arc on at least {self._least[0] * 1e3:g} mm/s and {self._least[1] * 60:g} m/min are needed',
            )
        return s.at(speed=speed, wire_feed_speed=wire)


def _runs(segments: Sequence[Segment]) -> Iterator[list[int]]:
    """Numbers of segments that follow each other without a stop or a corner of MIN_TURN and more."""
    run: list[int] = []
    for n, s in enumerate(segments):
        if s.kind == Kind.DWELL or s.length <= 0:
            if run:
                yield run
            run = []
            continue
        if run and not _goes_on(segments[run[-1]], s):
            yield run
            run = []
        run.append(n)
    if run:
        yield run


def _goes_on(before: Segment, s: Segment) -> bool:
    if before.arc != s.arc or np.abs(np.subtract(before.end, s.start)).max() > 1e-5:
        return False
    a, b = (np.subtract(v.end, v.start) / v.length for v in (before, s))
    return bool(a @ b > np.cos(MIN_TURN))
