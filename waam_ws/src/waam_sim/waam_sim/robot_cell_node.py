"""The simulated cell with a robot: the same metal, arc and scanner, moved by a trajectory controller over ROS.

The node is called `cell` as well. Its topics and services are those of the other one, with `joint_states`,
`weld_state`, `weld_command` and the action FollowJointTrajectory in place of the plant port. Time keeps step with the
wall clock (`pace`) and with the bridge.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from waam_node.node import OK
from waam_node.node import main as run_node
from waam_node.params import ParameterError
from waam_process.plant_port import SAMPLE
from waam_robot.station import Place, Station
from waam_robot.turning import Turning
from waam_robot.urdf_text import UrdfError

from .cell_node import Cell
from .node_trajectory import NAMES, TrajectoryController
from .node_welder import Welder
from .robot import SimRobot
from .urdf_file import arm_of

STEP_MS = 10
PARK = np.array([0.060, 0.050, 0.150])  # m, where the torch is when the cell is switched on
AHEAD_US = 20_000  # us that the cell may be ahead of its bridge
PATIENCE, PATIENCE_FAST = 0.3, 1.0  # s, and where time goes faster than the wall clock
WAKE = 0.02  # s between looks whether this node is to end
SWITCH_INTERVAL = 0.001  # s for which this thread may keep the executor from taking a command
LATE = 0.2  # s behind the wall clock from which on time is not made up for


class RobotCell(Cell):
    """Serves the robot in the thread of Cell."""

    def __init__(self) -> None:
        self._time_us = time.time_ns() // 10_000_000 * 10_000
        super().__init__()

    def _prepare(self) -> None:
        if self._has_chuck:
            raise ParameterError("parameter 'chuck_steps_per_turn': a robot has no chuck")
        self._robot, self._names = self._made()
        self._plant.put_on_robot()

    def _made(self) -> tuple[SimRobot, tuple[str, ...]]:
        """The robot and the names of its joints. ParameterError for a URDF that cannot be used, with the file."""
        plant = self._plant.params
        taught = np.array(plant.work_zero)
        arm = arm_of(plant.robot) if plant.robot.urdf else None
        start, *along = map(float, plant.robot.turning)
        turning = Turning(start, (along[0], along[1]))
        origin, high = (
            tuple(map(float, values)) for values in (plant.robot.origin, plant.robot.work_high)
        )
        place = Place(origin=origin, high=high, tilt=plant.robot.tilt, turning=turning)  # type: ignore[arg-type]
        station = arm or Station(place)
        try:
            robot = SimRobot(station, plant.robot, self.params.seed, PARK, taught, self._time_us)
        except UrdfError as e:
            raise ParameterError(f"parameter 'robot_urdf': {plant.robot.urdf}: {e}") from None
        return robot, arm.names if arm else NAMES

    def _connect(self) -> None:
        """The thread's work: time goes on, 10 ms by 10 ms."""
        robot = self._robot
        controller = TrajectoryController(
            self, self._lock, robot, self._names, lambda: self._time_us
        )
        welder = Welder(self, lambda: self._time_us)
        self.level, self.message = OK, 'running'
        due = time.monotonic()
        sys.setswitchinterval(SWITCH_INTERVAL)
        while not self._stop.is_set():
            self._step(robot, controller, welder)
            self._wait_for(welder)
            pace = self.params.pace
            due += STEP_MS * 1e-3 / (min(pace, 1.0) if welder.alone else pace)
            left = due - time.monotonic()
            if left < -LATE:
                due = time.monotonic()
            self._stop.wait(max(left, 0.0))

    def _wait_for(self, welder: Welder) -> None:
        """Time waits for a bridge that is late, but not for one that is silent: then it goes on, no faster than the
        wall clock."""
        end = time.monotonic() + (PATIENCE if self.params.pace <= 1 else PATIENCE_FAST)
        while welder.behind_us() > AHEAD_US and not self._stop.is_set():
            if time.monotonic() > end:
                welder.give_up()
                return
            welder.news.clear()
            if welder.behind_us() > AHEAD_US:
                welder.news.wait(WAKE)

    def _step(self, robot: SimRobot, controller: TrajectoryController, welder: Welder) -> None:
        start = time.perf_counter()
        samples = np.zeros(STEP_MS, SAMPLE)
        bits, wire, voltage = welder.outputs()
        with self._lock:
            tips, scanner = robot.advance(STEP_MS)
            samples['outputs'], samples['wire_cmd'], samples['voltage_set'] = bits, wire, voltage
            _put(samples, tips)
            self._time_us += 1000 * STEP_MS
            reading = self._plant.step(samples, self._time_us)
            _put(samples, tips + scanner)
            self._publish(samples, self._time_us)
            state = robot.state()
        controller.tell(*state)
        welder.tell(reading, self._time_us)
        self._busy += time.perf_counter() - start
        self._steps += 1


def _put(samples: np.ndarray, tips: np.ndarray) -> None:
    """Torch positions (n, 3), m, machine coordinates, into samples (n,)."""
    samples['table_x'], samples['table_y'], samples['tool_z'] = -tips[:, 0], -tips[:, 1], tips[:, 2]


def main() -> None:
    run_node(RobotCell)
