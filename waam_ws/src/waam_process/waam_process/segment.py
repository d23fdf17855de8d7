"""The path segment that every package shares: where the torch goes, with which setpoints. SI, work frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from enum import IntEnum, IntFlag
from typing import Any

Point = tuple[float, float, float]


class SegmentError(ValueError):
    """A segment that must not reach a machine; the text names index, field and limit."""


class Kind(IntEnum):
    """What a segment is for; numbers as in waam_msgs/Segment."""

    IDLE = 0
    DEPOSIT = 1
    SCAN = 2
    DWELL = 3


class Clamp(IntFlag):
    """What was limited on the way to the setpoints; bits as in waam_msgs/Segment."""

    NONE = 0
    SPEED_LOW = 1
    SPEED_HIGH = 2
    FEED_LOW = 4
    FEED_HIGH = 8
    VOLTAGE = 16
    PSI = 32


@dataclass(frozen=True)
class Segment:
    """One straight piece of path. Fields, units and meanings are those of waam_msgs/Segment, name by name."""

    index: int
    kind: Kind
    start: Point
    end: Point
    speed: float
    layer: int = 0
    bead: int = 0
    arc: bool = False
    tool_axis: Point = (0.0, 0.0, 1.0)
    wire_feed_speed: float = 0.0
    voltage: float = 0.0
    dwell: float = 0.0
    height: float = 0.0
    width: float = 0.0
    speed_programmed: float = 0.0
    wire_feed_base: float = 0.0
    psi: float = 0.0
    k_gain: float = 0.0
    residual_height: float = 0.0
    heat_factor: float = 1.0
    flow_factor: float = 1.0
    clamps: Clamp = Clamp.NONE

    @property
    def length(self) -> float:
        """m"""
        return math.dist(self.start, self.end)

    @property
    def duration(self) -> float:
        """s at constant speed, without acceleration"""
        if self.kind == Kind.DWELL:
            return self.dwell
        return self.length / self.speed if self.speed > 0 else 0.0

    @property
    def midpoint(self) -> Point:
        """m, work frame."""
        (x0, y0, z0), (x1, y1, z1) = self.start, self.end
        return 0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.5 * (z0 + z1)

    def at(self, **changes: Any) -> Segment:
        """A copy with some fields changed."""
        return replace(self, **changes)

    def check(self) -> None:
        """Raises SegmentError when a number is not finite or a field contradicts another."""
        total = 0.0  # not finite when one of them is not
        for value in vars(self).values():
            total += sum(value) if isinstance(value, tuple) else value
        if not math.isfinite(total):
            self._check_finite()
        if self.kind != Kind.DWELL and self.speed <= 0:
            raise SegmentError(f'segment {self.index}: speed is {self.speed} m/s, must be above 0')
        if self.dwell < 0:
            raise SegmentError(
                f'segment {self.index}: dwell is {self.dwell} s, must not be negative'
            )
        if self.arc and self.kind not in (Kind.DEPOSIT, Kind.DWELL):
            raise SegmentError(
                f'segment {self.index}: arc is on for a segment of kind {self.kind.name}'
            )
        if self.wire_feed_speed < 0:
            raise SegmentError(
                f'segment {self.index}: wire_feed_speed is {self.wire_feed_speed} m/s'
            )
        if abs(math.hypot(*self.tool_axis) - 1.0) > 1e-6:
            raise SegmentError(
                f'segment {self.index}: tool_axis {self.tool_axis} is not a unit vector'
            )

    def _check_finite(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            numbers = value if isinstance(value, tuple) else (value,)
            if not all(math.isfinite(v) for v in numbers):
                raise SegmentError(
                    f'segment {self.index}: {f.name} is {value}, not a finite number'
                )


def check_chain(segments: list[Segment], tolerance: float = 1e-6) -> None:
    """Raises SegmentError when indices do not rise by one or a segment does not start where the last ended."""
    for before, after in zip(segments, segments[1:], strict=False):
        if after.index != before.index + 1:
            raise SegmentError(f'segment {after.index} follows segment {before.index}')
        if math.dist(before.end, after.start) > tolerance:
            raise SegmentError(
                f'segment {after.index} starts at {after.start}, {math.dist(before.end, after.start) * 1e3:.3f} mm '
                f'from the end of segment {before.index}'
            )
