"""The machine of a robot cell, behind the interface of `Machine`: the same job runs on it."""

from __future__ import annotations

import numpy as np

from waam_bridge import faults
from waam_bridge.outbox import INFO
from waam_node.params import ParameterError
from waam_process.plant_port import SAMPLE
from waam_robot.station import Reach, Station
from waam_robot_bridge.controller import JointState, RobotController
from waam_robot_bridge.goals import Goal
from waam_robot_bridge.pace import Pacer
from waam_robot_bridge.params import RobotParams
from waam_robot_bridge.station_file import station_of
from waam_sim.plant import Plant, Profiles
from waam_sim.robot import RobotParams as SimParams
from waam_sim.robot import SimRobot
from waam_sim.urdf_arm import UrdfArm
from waam_sim.urdf_file import arm_of

from ..machine import EPOCH_US, EXCHANGE_MS, Machine

PARK = (0.060, 0.050, 0.150)  # m, where the torch is when the cell is switched on
SAME = 1e-6  # rad
WATCHDOG = 0.1  # s without outputs after which the welding device drops the arc by itself


class LabDriver:
    """The driver of the simulated robot (`waam_robot_bridge.controller.Driver`). `problem`: why it refuses goals."""

    def __init__(self, arm: SimRobot) -> None:
        self.arm, self.problem = arm, ''
        self.goals = 0

    def follow(self, goal: Goal) -> None:
        """Hands a goal over that is within the limits of the joints."""
        self.goals += 1
        self.problem = self.arm.beyond(goal.joints)
        if self.problem:
            return
        self.arm.follow(goal.start_us, goal.time, goal.joints, goal.rates)

    def state(self, now_us: int) -> JointState:
        """As the robot last told it."""
        return JointState(*self.arm.state())


class RobotMachine(Machine):
    """`bridge_dead`: the process of the bridge is gone: nobody sends goals, outputs or anything else."""

    def __init__(self, params: RobotParams, plant: Plant) -> None:
        if abs(params.tilt - plant.params.robot.tilt) > SAME:
            raise ParameterError(
                f'robot_bridge.tilt is {params.tilt:g} rad, cell.robot_tilt {plant.params.robot.tilt:g}: '
                'both are the tilt of one positioner'
            )
        station = station_of(params)
        start, taught = np.array(PARK), np.array(plant.params.work_zero)
        true = _true(params, plant.params.robot, station)
        plant.put_on_robot()
        self.robot = SimRobot(true, plant.params.robot, plant.seed, start, taught, EPOCH_US)
        self.driver = LabDriver(self.robot)
        self._params, self._station = params, station
        self._unheard = 0  # ms since the welding device heard of the bridge
        self._seen = np.zeros(EXCHANGE_MS, SAMPLE)  # the scanner in the place of the torch
        self.bridge_dead = False
        super().__init__(params, plant)
        pacer = Pacer(station, params)
        pacer.on_slowed = lambda slowed: self.bridge.notice(INFO, 'link', f'robot: {slowed.text}')
        self.bridge.pace = pacer

    def _make_controller(self) -> RobotController:
        made = RobotController(EPOCH_US, self._params, self._station, self.driver)
        made.place(np.array(PARK))
        made.on_problem = self._on_problem
        return made

    def _on_problem(self, text: str) -> None:
        faults.held(self.bridge, f'robot: {text}; the arc is cut')

    def step(self) -> None:
        """One exchange; without the bridge, robot and welding device are alone."""
        if not self.bridge_dead:
            super().step()
            return
        self._samples['outputs'] &= np.uint32(3)
        self.time_us += self._step_us
        self._live()

    def _live(self) -> None:
        """The robot moves on; the plant sees the torch where it truly is."""
        self._unheard = self._unheard + EXCHANGE_MS if self.bridge_dead else 0
        if self._unheard > WATCHDOG * 1e3:
            self._samples['outputs'], self._samples['wire_cmd'] = 0, 0.0
        tips, scanner = self.robot.advance(EXCHANGE_MS)
        _put(self._samples, tips)
        self._seen[:] = self._samples
        _put(self._seen, tips + scanner)
        self.controller.answer(self.plant.step(self._samples, self.time_us))

    def _profiles(self) -> Profiles | None:
        return self.plant.profiles(self._seen)


def _true(params: RobotParams, robot: SimParams, station: Reach) -> Station | UrdfArm:
    """The arm of the cell. ParameterError where it is not that of the bridge."""
    if bool(params.urdf) != bool(robot.urdf):
        raise ParameterError(
            f"robot_bridge.urdf is '{params.urdf}', cell.robot_urdf '{robot.urdf}': both are one arm (--urdf)"
        )
    if isinstance(station, Station):
        return station
    if max(abs(a - b) for a, b in zip(params.origin, robot.origin, strict=False)) > SAME:
        raise ParameterError(
            f'robot_bridge.origin is {params.origin} m, cell.robot_origin {robot.origin}: both are machine zero'
        )
    middle = np.add(params.work_low, params.work_high) / 2
    posture = tuple(map(float, station.joints(middle[None])[0]))
    return arm_of(robot, tuple(map(str, params.joint_names)), posture)


def _put(samples: np.ndarray, tips: np.ndarray) -> None:
    """Torch positions (n, 3), m, machine coordinates, into samples (n,)."""
    samples['table_x'], samples['table_y'], samples['tool_z'] = -tips[:, 0], -tips[:, 1], tips[:, 2]
