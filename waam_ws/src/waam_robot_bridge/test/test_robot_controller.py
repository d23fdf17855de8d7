"""The controller core in front of a robot: goals, welding outputs, telemetry, and a driver that fails."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_bridge import frames
from waam_bridge.frames import ARC_ENABLED
from waam_bridge.parsing import parse
from waam_process.plant_port import SAMPLE
from waam_robot.station import Place, Station
from waam_robot.turning import Turning
from waam_robot_bridge.controller import JointState, RobotController
from waam_robot_bridge.goals import GoalError, make
from waam_robot_bridge.params import RobotParams
from waam_robot_bridge.weld import ARC, Delayed

START_US = 1_000_000
PARK = np.array([0.06, 0.05, 0.15])


@pytest.fixture(scope='module')
def station():
    return Station()


class PerfectDriver:
    """Is where the goal says, at once. `silent`: tells no joint states any more."""

    def __init__(self, station: Station) -> None:
        self.problem = ''
        self.silent = False
        self.goals: list = []
        self._state = JointState(START_US, station.joints(PARK[None])[0], np.zeros(8))

    def follow(self, goal) -> None:
        self.goals.append(goal)

    def state(self, now_us: int) -> JointState:
        return self._state

    def advance(self, now_us: int) -> None:
        if self.silent or not self.goals:
            if not self.silent:
                self._state = JointState(now_us, self._state.joints, self._state.rates)
            return
        goal = self.goals[-1]
        t = (now_us - goal.start_us) * 1e-6
        joints = np.array([np.interp(t, goal.time, goal.joints[:, n]) for n in range(8)])
        self._state = JointState(now_us, joints, np.zeros(8))


class ControllerHarness:
    """Controller and driver in steps of 10 ms; speaks the link protocol."""

    def __init__(self, station: Station) -> None:
        self.driver = PerfectDriver(station)
        self.controller = RobotController(
            START_US, RobotParams(servo_lag=0.0), station, self.driver
        )
        self.controller.place(PARK)
        self.problems: list[str] = []
        self.controller.on_problem = self.problems.append
        self.samples = np.zeros(10, SAMPLE)
        self.telemetry: list[frames.Telemetry] = []
        self.tips: list[np.ndarray] = []

    def say(self, letter: str, args: str = '') -> None:
        self.controller.feed(frames.immediate(letter, args))

    def run(self, seconds: float) -> None:
        for n in range(round(seconds * 100)):
            if n % 10 == 0:
                self.controller.feed(frames.heartbeat(0, 0))
            self.controller.step(self.samples)
            self.driver.advance(self.controller.now_us)
            self.tips.append(self.controller.commanded(self.controller.now_us))
            for line in self.controller.take().split(b'\n'):
                if line[:2] == b'T ':
                    self.telemetry.append(parse(line))

    def close(self) -> None:
        self.controller.close()


@pytest.fixture
def harness(station):
    made = ControllerHarness(station)
    made.run(0.05)
    made.say('X')
    made.run(0.05)
    yield made
    made.close()


def test_goals_agree_where_they_overlap_and_end_at_rest(harness):
    harness.say('J', '40 20 -30 1500')
    harness.run(2.5)
    moving = [g for g in harness.driver.goals if len(g.time) > 5]
    assert len(moving) > 10
    for a, b in zip(moving[2:-3], moving[3:-2], strict=False):
        t = b.time[b.time < 0.2] + (b.start_us - a.start_us) * 1e-6
        for axis in range(8):
            then = np.interp(t, a.time, a.joints[:, axis])
            assert np.abs(then - b.joints[: len(t), axis]).max() < 2e-5
        assert np.abs(np.diff(a.tips[-2:], axis=0)).max() == 0.0
        assert (a.rates[-1] == 0.0).all()


def test_a_standing_machine_needs_no_goals(harness):
    harness.run(0.5)
    before = len(harness.driver.goals)
    harness.run(2.0)
    assert len(harness.driver.goals) <= before + 1


def test_telemetry_tells_where_the_robot_is(harness):
    harness.say('J', '40 0 0 1200')
    harness.run(1.5)
    steady = harness.telemetry[-60:]
    zero = (
        harness.telemetry[0].x_um * 1e-6 - PARK[0]
    )  # not homed: the core counts from where it was
    lag = [t.x_um * 1e-6 - zero - harness.controller.commanded(t.t_us)[0] for t in steady]
    # 20 mm/s for the 40 ms by which goals are late
    assert np.median(lag) == pytest.approx(-20e-3 * 0.04, abs=1e-4)
    assert np.median([t.v_um_s for t in steady]) == pytest.approx(20_000, rel=0.02)


def test_a_silent_driver_cuts_the_arc_and_holds(harness):
    harness.say('J', '60 0 0 600')
    harness.run(0.5)
    harness.driver.silent = True
    harness.run(0.12)
    assert not harness.problems
    harness.run(0.18)
    assert len(harness.problems) == 1 and 'joint states' in harness.problems[0]
    assert not (harness.samples['outputs'] & ARC).any()
    stopped = harness.controller.commanded(harness.controller.now_us)
    harness.run(0.5)
    assert np.array_equal(stopped, harness.controller.commanded(harness.controller.now_us))
    harness.say('R')  # resumed too early: held again, told no second time
    harness.run(0.3)
    went = harness.controller.commanded(harness.controller.now_us) - stopped
    assert np.abs(went).max() < 5e-4
    assert len(harness.problems) == 1
    harness.driver.silent = False
    harness.run(0.1)
    assert harness.controller.problem == ''


def test_a_driver_that_refuses_is_quoted(harness):
    harness.driver.problem = "the driver refused a goal: it knows no joint 'joint_9'"
    harness.run(0.05)
    assert harness.problems == [harness.driver.problem]


def test_a_robot_off_its_path_is_noticed(harness):
    harness.driver.silent = True
    state = harness.driver._state
    harness.driver._state = JointState(
        harness.controller.now_us + 10_000, state.joints + 0.01, state.rates
    )
    harness.run(0.02)
    assert 'mm from where it should be' in harness.problems[0]


def test_an_arm_that_cannot_begin_is_told_once_until_it_is_resumed(harness):
    """With moves in its queue the held core would ask for a goal ten times a second."""
    joints = Station(Place(turning=Turning(0.5))).joints(PARK[None])[0]  # the same tip
    harness.driver._state = JointState(harness.controller.now_us, joints, np.zeros(8))
    harness.say('J', '60 0 0 600')
    harness.run(2.0)
    assert len(harness.problems) == 1 and ' stands at ' in harness.problems[0]
    harness.say('R')
    harness.run(1.0)
    assert len(harness.problems) == 2


def test_too_fast_joints_give_no_goal(station):
    far = np.linspace([0.05, 0.05, 0.1], [0.35, 0.05, 0.1], 41)
    joints = station.joints(far[:1])[0]
    limits = RobotParams().limits_of_joints()
    with pytest.raises(GoalError, match=r'J\d .* times its fastest'):
        make(station, far[:1], far[1:], 10, 0, joints, limits)
    with pytest.raises(GoalError, match='out of reach'):
        make(station, far[:1], far[1:] + [3.0, 0.0, 0.0], 10, 0, joints, limits)


def test_an_arm_in_another_posture_is_not_sent_across(station):
    """The same place of the torch, the wrist turned over: a goal would swing the arm there."""
    far = np.linspace([0.05, 0.05, 0.1], [0.06, 0.05, 0.1], 41)
    joints = station.joints(far[:1])[0]
    other = joints + [0.0, 0.0, 0.0, np.pi, 0.0, np.pi, 0.0, 0.0]
    other[4] = -joints[4]
    assert np.abs(station.tips(other[None]) - far[:1]).max() < 1e-9
    limits = RobotParams().limits_of_joints()
    with pytest.raises(
        GoalError, match=r'axis \d stands at .* rad, the way begins with .*: bring the arm to \['
    ):
        make(station, far[:1], far[1:], 10, 0, other, limits)
    assert make(station, far[:1], far[1:], 10, 0, joints + 0.05, limits).joints.shape[1] == 8


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 8),
    st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=40),
)
def test_outputs_come_late_but_end_at_once(steps, orders):
    """orders: (arc wanted, the machine runs)."""
    delayed, told = Delayed(steps), []
    for n, (arc, runs) in enumerate(orders):
        samples = np.zeros(2, SAMPLE)
        samples['outputs'] = ARC if arc else 0
        samples['wire_cmd'] = n
        delayed.next(samples, not runs, False)
        told.append((int(samples['wire_cmd'][0]), bool(samples['outputs'][0] & ARC)))
        if not runs:
            assert told[-1] == (n, arc)
        assert told[-1][1] == orders[told[-1][0]][0]
        assert n - told[-1][0] <= steps
    shown = [n for n, _ in told]
    assert shown == sorted(shown)


def test_cut_leaves_gas_alone():
    samples = np.zeros(3, SAMPLE)
    samples['outputs'], samples['wire_cmd'] = ARC_ENABLED | 2, 0.1
    Delayed(0).next(samples, False, True)
    assert (samples['outputs'] == 2).all() and (samples['wire_cmd'] == 0).all()
