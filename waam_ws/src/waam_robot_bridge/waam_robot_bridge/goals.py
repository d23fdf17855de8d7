"""What the robot is to do next, as one goal for its trajectory controller: from what was commanded last to standstill.

The goal comes from a copy of the controller that is run ahead: `horizon` seconds as if nothing intervened, then held,
so that it slows down as the controller itself would. A goal that is not replaced in time therefore ends at rest. The
robot follows the controller `delay` seconds late; the goal begins with what was commanded in that time, so one that
replaces another goes on where the other one was.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_bridge.embedded import Controller
from waam_bridge.frames import HOLD_NOW
from waam_process.plant_port import SAMPLE
from waam_robot.station import Reach, StationError

from .limits import Limits, of_axes

STANDS = 1e-9  # m between two points
POSTURE = 0.35  # rad (m) that an axis may be from where the goal begins: more is another posture
SETTLED = 4  # points of a goal, until its axes are where they would be if they had always followed
MIN_GOAL_DURATION = 0.5  # s: a JointTrajectoryController refuses a goal that has ended already
STOPPING = 0.4  # s at most that slowing down may take: 0.2 m/s at 0.5 m/s^2


class GoalError(ValueError):
    """There is no goal that the robot can follow; the text says why."""


@dataclass(frozen=True)
class Goal:
    """start_us: controller time of time 0; time: (N,) s, rising from 0; tips: (N, 3) m, machine coordinates; joints,
    rates: (N, 8) rad, rad/s, the last rate is 0."""

    start_us: int
    time: np.ndarray
    tips: np.ndarray
    joints: np.ndarray
    rates: np.ndarray


def tips_of(samples: np.ndarray) -> np.ndarray:
    """(n, 3) m: the torch in machine coordinates by samples (n,) of SAMPLE."""
    return np.column_stack([-samples['table_x'], -samples['table_y'], samples['tool_z']])


class Preview:
    """Runs a copy of the controller ahead. horizon: s; every: ms between the points of a goal."""

    def __init__(self, horizon: float, every: int) -> None:
        self._copy = Controller(0)
        self._ahead = np.zeros(_whole(horizon, every), SAMPLE)
        self._stop = np.zeros(_whole(STOPPING, every), SAMPLE)

    @property
    def running(self) -> int:
        """ms of what `run` returns until it begins to slow down."""
        return len(self._ahead)

    def close(self) -> None:
        """Frees the copy."""
        self._copy.close()

    def run(self, controller: Controller) -> np.ndarray:
        """(n, 3) m: where the controller will command the torch in every ms to come; at the end it stands."""
        self._copy.copy(controller)
        self._copy.step(self._ahead)
        self._copy.feed(HOLD_NOW)
        self._copy.step(self._stop)
        return np.concatenate([tips_of(self._ahead), tips_of(self._stop)])


def _whole(seconds: float, every: int) -> int:
    """ms, a multiple of `every`."""
    return every * max(1, round(seconds * 1e3 / every))


def make(
    station: Reach,
    past: np.ndarray,
    ahead: np.ndarray,
    every: int,
    now_us: int,
    near: np.ndarray,
    limits: Limits,
    lag: float = 0.0,
    running: int = 0,
) -> Goal:
    """past (m + 1, 3), ahead (n, 3): torch positions of every ms, commanded and to come; m, n multiples of `every` ms.

    now_us: controller time of the end of `past`, when the goal begins. near: (8,) joints as they are; lag: s, of the
    servos, for which the positions lead. GoalError where the arm does not reach, where it stands in another posture
    than the goal begins with, where a joint would have to be too fast, or, in the first `running` ms of `ahead`,
    accelerate or jerk too much: what stops the robot afterwards must never be refused.
    """
    tips = np.concatenate([past, ahead])[::every]
    tips = _ended(tips)
    try:
        joints = station.joints(tips, near)
    except StationError as e:
        raise GoalError(str(e)) from None
    apart = np.abs(joints[0] - near)
    if apart.max() > POSTURE:
        n = int(np.argmax(apart))
        raise GoalError(
            f'axis {n + 1} stands at {near[n]:.2f} rad, the way begins with {joints[0, n]:.2f}: bring the arm to '
            f'{np.round(joints[0], 2).tolist()} first'
        )
    dt = every * 1e-3
    time = np.arange(len(tips)) * dt
    rates = _rates(joints, dt)
    counts = (len(past) - 1 + running) // every if running else 0
    said = _too_much(joints, rates, dt, limits, lag, counts)
    if said:
        raise GoalError(said)
    return _reaching(Goal(now_us, time, tips, joints, rates))


def _reaching(goal: Goal) -> Goal:
    """The goal, held at its end until MIN_GOAL_DURATION: it must not be over when it comes late."""
    if goal.time[-1] >= MIN_GOAL_DURATION:
        return goal
    longer = [np.append(a, a[-1:], axis=0) for a in (goal.tips, goal.joints, goal.rates)]
    return Goal(goal.start_us, np.append(goal.time, MIN_GOAL_DURATION), *longer)


def _too_much(
    joints: np.ndarray, rates: np.ndarray, dt: float, limits: Limits, lag: float, counts: int
) -> str:
    """Which limit a goal exceeds, '' = none. counts: of its points, those whose acceleration and jerk are looked at."""
    over = np.abs(rates) / limits.speed
    if over.max() > 1:
        return limits.text(0, int(over.max(axis=0).argmax()), float(over.max()))
    some = slice(0, counts + 1)
    if len(joints[some]) <= SETTLED + 3:
        return ''
    moved = of_axes(joints[some], rates[some], dt, lag)[2 * SETTLED :]
    shares = limits.shares(moved, dt / 2).max(axis=0)
    if shares[1:].max() <= 1:
        return ''
    kind, axis = np.unravel_index(int(shares[1:].argmax()), shares[1:].shape)
    return limits.text(int(kind) + 1, int(axis), float(shares[1:].max()))


def led(path: np.ndarray, lag: float) -> np.ndarray:
    """(n, 3) m: what servos with the time constant `lag` (s) make (n, 3), the positions of every ms, of."""
    return np.asarray(path + lag * np.gradient(path, 1e-3, axis=0)) if lag else path


def _rates(joints: np.ndarray, dt: float) -> np.ndarray:
    """(N, 8) rad/s: differences of fourth order inside, 0 at the end."""
    rates = np.asarray(np.gradient(joints, dt, axis=0))
    rates[1:-1] -= np.diff(rates, 2, axis=0) / 6
    rates[-1] = 0.0
    return rates


def _ended(tips: np.ndarray) -> np.ndarray:
    """Without the points at the end where the torch stands, but the first three of them."""
    moves = np.flatnonzero(np.abs(np.diff(tips, axis=0)).max(axis=1) > STANDS)
    last = int(moves[-1]) + 1 if len(moves) else 0
    end = min(last + 3, len(tips))
    return np.concatenate([tips[: last + 1], np.tile(tips[last], (max(end - last - 1, 2), 1))])
