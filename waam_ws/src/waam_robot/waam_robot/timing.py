"""When the joints are where: the programmed torch speed at the part, under limits of speed, acceleration and jerk.

TOPPRA (Pham H., Pham Q.-C., 2018) finds the fastest motion along a bead's joint path under the limits of speed and
acceleration, where the way itself is a ninth axis that may not exceed the programmed speed. Its motion along the way is
then averaged over `blend` seconds, which leaves the path as it is and bounds the change of acceleration. Where the path
bends so much that the programmed speed alone would exceed a limit of jerk, the torch is slowed down before. What comes
out is checked: starts and stops become gentler until the limits of jerk hold. A bead begins and ends at rest.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from .bead import Bead

SHARE = 0.9  # of speed and acceleration that TOPPRA gets; averaging needs the rest
BEND = 0.6  # of jerk that the bends of the path may take at steady speed
GENTLER = 8  # attempts
AXIS_NAMES = ('J1', 'J2', 'J3', 'J4', 'J5', 'J6', 'B', 'C')


class TimingError(ValueError):
    """A bead cannot be timed; the text says why."""


def _drives(*values: float) -> np.ndarray:
    return np.radians(np.array(values))


@dataclass(frozen=True)
class Drives:
    """Limits of the joints, by default six, B and C: speed rad/s, acceleration rad/s^2, jerk rad/s^3; torch: m/s^2
    along the way; blend: s. Those here are of the size usual for such machines: put those of your data sheets in their
    place.
    """

    speed: np.ndarray = field(
        default_factory=lambda: _drives(205, 205, 260, 415, 415, 880, 120, 190)
    )
    acceleration: np.ndarray = field(
        default_factory=lambda: _drives(500, 500, 600, 1200, 1200, 2000, 300, 500)
    )
    jerk: np.ndarray = field(
        default_factory=lambda: 10 * _drives(500, 500, 600, 1200, 1200, 2000, 300, 500)
    )
    torch: float = 0.25
    blend: float = 0.04
    names: tuple[str, ...] = AXIS_NAMES

    def __post_init__(self) -> None:
        for name in ('speed', 'acceleration', 'jerk'):
            value = np.asarray(getattr(self, name), float)
            if value.shape != (len(self.names),) or not (np.isfinite(value) & (value > 0)).all():
                raise ValueError(f'{name}: wanted {len(self.names)} positive numbers')
        if not (self.torch > 0 and self.blend > 0):
            raise ValueError('torch and blend have to be positive')


@dataclass(frozen=True)
class Timed:
    """time (T,) s; way (T,) m and speed (T,) m/s of the torch along the bead; joints, rates (T, n) rad, rad/s; used:
    (3, n) largest speed, acceleration and jerk over their limits."""

    time: np.ndarray
    way: np.ndarray
    speed: np.ndarray
    joints: np.ndarray
    rates: np.ndarray
    used: np.ndarray


def time_bead(
    bead: Bead, joints: np.ndarray, speed: float, drives: Drives | None = None, dt: float = 1e-3
) -> Timed:
    """The bead, with joints (N, n) rad at its points, at the programmed speed (m/s), sampled every dt (s); longer
    where that gives over 10^6 samples.

    TimingError without toppra, for a speed that is none, and where TOPPRA finds no motion.
    """
    drives = drives or Drives()
    if not (np.isfinite(speed) and speed > 0):
        raise TimingError(f'travel speed {speed} m/s: wanted a positive number')
    curve = CubicSpline(bead.way / speed, joints)  # over u, the time at programmed speed
    torch, worst = drives.torch, np.inf
    for attempt in range(GENTLER):
        pace = _fastest(curve, joints, speed, replace(drives, torch=torch))
        motion = _averaged(pace, drives.blend, dt)
        if attempt == GENTLER - 1:  # what is left is no matter of starts and stops
            motion = _Motion(motion.t * 1.02 * worst, motion.u)
        timed, worst = _sampled(curve, speed, drives, motion)
        if worst <= 1.0:
            return timed
        torch *= 0.6
    raise TimingError(f'a limit is exceeded {worst:.2f} times even after slowing down')


def _toppra() -> Any:
    try:
        import toppra
        import toppra.algorithm
        import toppra.constraint
    except ImportError:
        raise TimingError(
            'timing of joint paths needs toppra: pip install -r requirements-robot.txt'
        ) from None
    import logging

    logging.getLogger('toppra').setLevel(logging.ERROR)
    return toppra


def _fastest(curve: CubicSpline, joints: np.ndarray, speed: float, drives: Drives) -> _Pace:
    """du/dt over u, by TOPPRA."""
    ta, u = _toppra(), curve.x
    spline = ta.SplineInterpolator(u, np.column_stack([joints, u]))
    cap, steady = _bend_cap(curve, u, drives), SHARE * drives.speed

    def speeds(at: float) -> np.ndarray:
        limit = np.append(steady, np.interp(at, u, cap))
        return np.column_stack([-limit, limit])

    push = SHARE * np.array([*drives.acceleration, drives.torch / speed])
    constraints = [
        ta.constraint.JointVelocityConstraintVarying(speeds),
        ta.constraint.JointAccelerationConstraint(np.column_stack([-push, push])),
    ]
    solver = ta.algorithm.TOPPRA(constraints, spline, gridpoints=_grid(u), solver_wrapper='seidel')
    _, pace, *_ = solver.compute_parameterization(0.0, 0.0)
    if pace is None or not np.isfinite(pace).all():
        raise TimingError(f'TOPPRA finds no motion along a bead of {u[-1] * speed * 1e3:.1f} mm')
    return _Pace(np.asarray(solver.problem_data.gridpoints), np.asarray(pace).ravel())


def _bend_cap(curve: CubicSpline, u: np.ndarray, drives: Drives) -> np.ndarray:
    """(N,): share of the programmed speed that the jerk at steady speed allows at u, with its neighbours' least."""
    jerk = np.abs(curve(u, 3))
    jerk = np.maximum(jerk, np.abs(curve(np.append(u[1:], u[-1]) - 1e-9, 3)))
    with np.errstate(divide='ignore'):
        cap = np.minimum(np.cbrt(BEND * drives.jerk / np.maximum(jerk, 1e-12)).min(axis=1), 1.0)
    wide = np.pad(cap, 4, mode='edge')
    return np.asarray(np.lib.stride_tricks.sliding_window_view(wide, 9).min(axis=1))


def _grid(u: np.ndarray) -> np.ndarray:
    """The samples, and finer ones near both ends, where the torch starts and stops."""
    ends = np.geomspace(1e-4, 1.0, 25) * min(0.1, u[-1] / 4)
    return np.unique(np.concatenate([u, ends, u[-1] - ends]))


@dataclass(frozen=True)
class _Pace:
    """du/dt at u: its square is linear between the points."""

    u: np.ndarray
    rate: np.ndarray

    def times(self) -> np.ndarray:
        """(N,) s."""
        mean = (self.rate[1:] + self.rate[:-1]) / 2
        return np.concatenate([[0.0], np.cumsum(np.diff(self.u) / np.maximum(mean, 1e-12))])


@dataclass(frozen=True)
class _Motion:
    """u over time t (T,), evenly sampled."""

    t: np.ndarray
    u: np.ndarray


def _averaged(pace: _Pace, blend: float, dt: float) -> _Motion:
    """u(t) of the pace, averaged twice over half of `blend` each: the acceleration along the way becomes continuous."""
    t = pace.times()
    dt = max(dt, t[-1] / 1e6)
    half = max(int(round(blend / 2 / dt)), 1)
    even = np.arange(-2 * half, int(np.ceil(t[-1] / dt)) + 2 * half + 1) * dt
    # between two points the acceleration is constant: u is a parabola
    u = np.interp(even, t, pace.u)
    at = np.clip(np.searchsorted(t, even) - 1, 0, len(t) - 2)
    inside = (even > t[0]) & (even < t[-1])
    since = even - t[at]
    push = (pace.rate[at + 1] - pace.rate[at]) / np.maximum(t[at + 1] - t[at], 1e-12)
    u = np.where(inside, pace.u[at] + pace.rate[at] * since + push * since**2 / 2, u)
    box = np.ones(half) / half
    for _ in range(2):
        padded = np.concatenate([np.full(half, u[0]), u, np.full(half, u[-1])])
        u = np.convolve(padded, box, 'same')[half:-half]
    u = np.clip(np.maximum.accumulate(u), pace.u[0], pace.u[-1])
    return _Motion(even - even[0], u)


def _sampled(
    curve: CubicSpline, speed: float, drives: Drives, motion: _Motion
) -> tuple[Timed, float]:
    """The motion with its derivatives, and the largest share of a limit that it uses."""
    h = float(motion.t[1] - motion.t[0])
    joints = curve(motion.u)
    pace = np.gradient(motion.u, h)
    rates = np.gradient(joints, h, axis=0)
    push = np.gradient(rates, h, axis=0)
    jerk = np.gradient(push, h, axis=0)
    limits = (drives.speed, drives.acceleration, drives.jerk)
    used = np.array(
        [
            np.abs(v).max(axis=0) / limit
            for v, limit in zip((rates, push, jerk), limits, strict=True)
        ]
    )
    worst = max(float(used[n].max()) ** (1 / (n + 1)) for n in range(3))
    return Timed(motion.t, motion.u * speed, pace * speed, joints, rates, used), worst
