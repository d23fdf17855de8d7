"""Feed that answers late and corners that take time: the command to the wire for metal that arrives in its place.

Arrays of length n, one entry per segment in the order they are driven; SI. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BOOST = 1.0  # most of a change of feed that is added on top of it: more would ring
SHARP = 1e-3  # rad, turns below this are none


@dataclass(frozen=True)
class Drives:
    """How fast wire and table follow their commands."""

    # s, time constant of the wire drive; 0 = none, or the controller leads it
    wire_lag: float = 0.0
    acceleration: float = np.inf  # m/s2, of travel; inf = corners take no time


def runs(joined: np.ndarray) -> list[slice]:
    """Beads: stretches of segments that follow each other; joined[i]: segment i goes on where i - 1 ended, arc on."""
    starts = np.flatnonzero(~joined)
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(joined)], strict=True)]


def wire_lead(feed: np.ndarray, duration: np.ndarray, joined: np.ndarray, lag: float) -> np.ndarray:
    """Feed to command so that its mean over every segment is `feed` behind a first-order lag of `lag` s.

    A bead begins with the wire running at its first feed (the arc is struck on the spot). A change of feed is exceeded
    by at most `BOOST` times itself, so short segments do not make it swing; the rest is left to the next segment.
    """
    if lag <= 0:
        return feed.copy()
    out = feed.copy()
    share = lag / duration * -np.expm1(-duration / lag)  # of the old feed in the mean of a segment
    boost = np.minimum(share / np.maximum(1 - share, 1e-9), BOOST)
    for run in runs(joined):
        actual = feed[run.start]
        for i in range(run.start, run.stop):
            out[i] = max(feed[i] + boost[i] * (feed[i] - actual), 0.0)
            actual = out[i] + (actual - out[i]) * np.exp(-duration[i] / lag)
    return out


def corner_time(
    direction: np.ndarray, speed: np.ndarray, joined: np.ndarray, acceleration: float
) -> np.ndarray:
    """Extra seconds that each segment takes because the torch slows down at its ends; direction (n, 2) of unit length.

    At a corner of angle a the speed falls to v*cos(a/2)^2 (none straight on, a stop at a reversal); braking from v to c
    at acceleration A and from there on again costs (v - c)^2/(2*v*A) on each side. Beads begin and end at rest.
    """
    cos = np.ones(len(speed))
    cos[1:] = np.clip((direction[1:] * direction[:-1]).sum(axis=1), -1, 1)
    # at the start of every segment; cos(a/2)^2
    corner = np.where(joined, speed * (1 + cos) / 2, 0.0)
    corner = np.where(joined & (np.arccos(cos) < SHARP), speed, corner)
    after = np.append(corner[1:], 0.0)
    lost = (speed - np.minimum(corner, speed)) ** 2 + (speed - np.minimum(after, speed)) ** 2
    return lost / (2 * np.maximum(speed, 1e-9) * acceleration)


def factor(
    start: np.ndarray,
    end: np.ndarray,
    deposit: np.ndarray,
    speed: np.ndarray,
    feed: np.ndarray,
    drives: Drives,
) -> np.ndarray:
    """(n,) what the feed of every segment is multiplied with; 1 where nothing is laid. start, end: (n, 3) m."""
    length = np.linalg.norm(end - start, axis=1)
    use = deposit & (length > 0) & (feed > 0)
    if not use.any() or (drives.wire_lag <= 0 and not np.isfinite(drives.acceleration)):
        return np.ones(len(feed))
    at = np.flatnonzero(use)
    touch = np.linalg.norm(start[at[1:]] - end[at[:-1]], axis=1) < 1e-6
    joined = np.concatenate([[False], touch & (np.diff(at) == 1)])
    way = (end - start)[at, :2] / length[at, None]
    duration = length[at] / speed[at]
    extra = corner_time(way, speed[at], joined, drives.acceleration)
    wanted = feed[at] * duration / (duration + extra)
    out = np.ones(len(feed))
    out[at] = wire_lead(wanted, duration + extra, joined, drives.wire_lag) / feed[at]
    return out
