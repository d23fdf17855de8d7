"""The controller of a robot cell: the controller core of the gantry, in this process, in front of a robot.

Queue, look-ahead, arc sequence, faults and lease are those of the core (`waam_bridge.embedded.Controller`): one piece
of code for both machines. What the core commands every millisecond goes to the robot as goals (`goals`); the welding
outputs follow when the torch is there (`weld`); telemetry tells where the robot is, not where it should be. When the
robot's driver is late, lost or off the path, the arc goes out at once and the core is held.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from waam_bridge import frames
from waam_bridge.embedded import Controller, Reading
from waam_robot.station import Reach

from .blend import blended
from .goals import Goal, GoalError, Preview, led, make, tips_of
from .limits import smoothing
from .params import RobotParams
from .weld import Delayed

APART = 5e-6  # m: the core does something else than the goal shows
KEPT = 1000  # ms of commanded positions that are kept
HORIZON = 0.3  # s of a goal, then it slows down: three goals may get lost
PERIOD_MS = 100  # between goals while the torch moves; shorter than HORIZON
POINT_MS = 10  # between the points of a goal


@dataclass(frozen=True)
class JointState:
    """time_us: controller time; joints, rates: (8,) rad, rad/s, as the driver measures them."""

    time_us: int
    joints: np.ndarray
    rates: np.ndarray


@dataclass(frozen=True)
class Seen:
    """time_us: controller time; tip, rate: (3,) m, m/s, the torch by the joint states, machine coordinates."""

    time_us: int
    tip: np.ndarray
    rate: np.ndarray


class Driver(Protocol):
    """The robot's trajectory controller and its joint states."""

    def follow(self, goal: Goal) -> None:
        """Replaces the goal."""

    def state(self, now_us: int) -> JointState | None:
        """The newest joint state that is not later than controller time now_us; None before the first."""

    @property
    def problem(self) -> str:
        """Why it follows no goal, '' = nothing."""


class RobotController:
    """Used as `Controller` is. `on_problem` is told once when the arc is cut, and why. `cut`: it is, now."""

    def __init__(
        self, start_us: int, params: RobotParams, station: Reach, driver: Driver, boot: int = 1
    ) -> None:
        self.params, self.station, self.driver = params, station, driver
        self.on_problem: Callable[[str], None] = lambda text: None
        self.problem = ''
        self._told = False  # since it ran last
        self.now_us = start_us
        self._core = Controller(start_us, boot)
        self._core.widen(params.work_low, params.work_high)
        self._delay = POINT_MS * round(params.delay * 1e3 / POINT_MS)
        self._preview = Preview(HORIZON, POINT_MS)
        self._weld: Delayed | None = None
        self._tips = np.zeros((0, 3))  # (KEPT, 3) of every ms until now
        self._ahead = np.zeros((0, 3))  # of every ms since the last goal
        self._since = 0  # ms since the last goal
        self._last = Seen(-1, np.zeros(3), np.zeros(3))
        self._limits = params.limits_of_joints()
        self._smooth = smoothing(station.gains, self._limits)

    def close(self) -> None:
        """Frees the core; may be called twice."""
        self._core.close()
        self._preview.close()

    def place(self, tip: np.ndarray) -> None:
        """Where the torch stands at first, (3,) m, machine coordinates."""
        self._core.place(*map(float, tip))
        self._tips = np.tile(np.asarray(tip, float), (KEPT, 1))

    # ---- as Controller

    def feed(self, data: bytes) -> None:
        """Bytes from the host."""
        self._core.feed(data)

    def answer(self, reading: Reading) -> None:
        """Sets what the inputs read from now on."""
        self._core.answer(reading)

    def step(self, samples: np.ndarray) -> None:
        """Runs len(samples) ms; samples (n,) of SAMPLE takes what was commanded, with the welding outputs that act
        now. The robot gets a new goal when one is due."""
        n = len(samples)
        self._core.step(samples)
        if self._core.look().state == frames.RUN and not self.problem:
            self._told = False
        self.now_us += 1000 * n
        tips = tips_of(samples)
        self._tips = np.concatenate([self._tips, tips])[-KEPT:]
        self._since += n
        if self._due(tips):
            self._send()
        self._watch()
        self._outputs(samples)

    def take(self) -> bytes:
        """Bytes sent to the host since the last call; telemetry with the measured position and speed."""
        data = self._core.take()
        if b'T ' not in data:
            return data
        lines = data.split(b'\n')
        return b'\n'.join(self._measured(line) if line[:2] == b'T ' else line for line in lines)

    # ---- the robot

    def commanded(self, time_us: int) -> np.ndarray:
        """(3,) m: where the core had the torch at controller time time_us, within the last second."""
        back = (self.now_us - time_us) // 1000
        return self._tips[max(len(self._tips) - 1 - max(back, 0), 0)]

    def _due(self, tips: np.ndarray) -> bool:
        """The goal is old and the torch moves, or the core does something else than it shows."""
        shown = self._ahead[self._since - len(tips) : self._since]
        rest = self._ahead[-1:] if len(self._ahead) else self._tips[:1]
        shown = np.concatenate([shown, np.tile(rest, (len(tips) - len(shown), 1))])
        if np.abs(shown - tips).max() > APART:
            return True
        if self._since < PERIOD_MS:
            return False
        return bool(np.abs(self._ahead[self._since :] - tips[-1]).max(initial=0.0) > 0) or bool(
            self._core.look().queued
        )

    def _send(self) -> None:
        state = self.driver.state(self.now_us)
        if state is None:
            return
        self._ahead, self._since = self._preview.run(self._core), 0
        params, whole = self.params, np.concatenate([self._tips, self._ahead])
        path = led(blended(whole, params.corner, self._smooth), params.servo_lag)
        now = len(self._tips)
        past, ahead = path[now - self._delay - 1 : now], path[now:]
        running = self._preview.running if self._core.look().state == frames.RUN else 0
        try:
            goal = make(
                self.station, past, ahead, POINT_MS, self.now_us, state.joints, self._limits, params.servo_lag,
                running,
            )  # fmt: skip
        except GoalError as e:
            self._fail(f'the robot cannot follow: {e}')
            return
        self.driver.follow(goal)

    def _watch(self) -> None:
        """The driver answers and is where it should be, or the arc is cut."""
        wrong = self._wrong()
        if wrong:
            self._fail(wrong)
        elif self.problem and self._core.look().state != frames.RUN:
            self.problem = ''

    def _wrong(self) -> str:
        if self.driver.problem:
            return self.driver.problem
        state = self.driver.state(self.now_us)
        if state is None:
            return 'the driver has told no joint states'
        age = (self.now_us - state.time_us) * 1e-6
        if age > self.params.state_timeout:
            return f'the last joint states are {age:.2f} s old'
        off = self._off(state)
        if off > self.params.follow_max:
            return f'the torch is {off * 1e3:.1f} mm from where it should be'
        return ''

    def _off(self, state: JointState) -> float:
        """m: how far the torch is from the path of the time in which it may be."""
        late = round(self.params.weld_delay * 1e6)
        last = len(self._tips) - 1 - max(self.now_us - state.time_us + late, 0) // 1000
        window = self._tips[max(last - 50, 0) : max(last, 0) + 31]
        return float(np.linalg.norm(window - self._seen(state).tip, axis=1).min(initial=np.inf))

    def _seen(self, state: JointState) -> Seen:
        """Where the joint state has the torch; computed once for each."""
        if state.time_us != self._last.time_us:
            tip = self.station.tips(state.joints[None])[0]
            passed = (state.time_us - self._last.time_us) * 1e-6
            rate = (tip - self._last.tip) / passed if 0 < passed < 0.1 else np.zeros(3)
            self._last = Seen(state.time_us, tip, rate)
        return self._last

    def _fail(self, text: str) -> None:
        """Cuts the arc and holds the core, as often as it is resumed; told once."""
        if not self.problem or self._core.look().state == frames.RUN:
            self._core.feed(frames.HOLD_NOW)
        if not self._told:
            self.on_problem(text)
        self.problem, self._told = text, True

    def _outputs(self, samples: np.ndarray) -> None:
        if self._weld is None:
            self._weld = Delayed(round(self.params.weld_delay * 1e3 / len(samples)))
        ending = self._core.look().state in (frames.HOLD, frames.ALARM)
        self._weld.next(samples, ending, bool(self.problem))

    # ---- telemetry

    def _measured(self, line: bytes) -> bytes:
        """A T line with the measured position and speed in place of the commanded ones."""
        state = self.driver.state(self.now_us)
        if state is None:
            return line
        payload, digits = frames.unseal(line)
        fields = payload[2:].split(b',')
        t_us = int(fields[1])
        seen = self._seen(state)
        ahead = min(max((t_us - seen.time_us) * 1e-6, -0.05), 0.05)
        tip = seen.tip + ahead * seen.rate
        off = np.round((tip - self.commanded(t_us)) * 1e6).astype(int)
        for n in range(3):
            fields[4 + n] = b'%d' % (int(fields[4 + n]) + off[n])
        fields[7] = b'%d' % round(float(np.linalg.norm(seen.rate)) * 1e6)
        return frames.seal(b'T ' + b','.join(fields), digits)[:-1]
