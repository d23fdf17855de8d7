"""The controller of the robot cell in a thread of the node, behind the interface of a serial port."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
from rclpy.clock import ROSClock
from rclpy.node import Node

from waam_bridge.transport import Owner
from waam_process.plant_port import SAMPLE

from .controller import RobotController
from .node_driver import RosDriver, RosWelder
from .params import RobotParams
from .station_file import station_of

STEP_MS = 10
MAX_STEPS = 100  # that are made up for at once
IDLE = 0.02  # s
# a simulated clock comes from the process of the joint states, and may be read before them:
BEHIND_US = 50_000  # us that it may be ahead of those that are on their way
PATIENCE = 0.3  # s of the steady clock, for so long
SLOW = 0.05  # s of the steady clock for a step while a node is late
BOOTS = 2**31
RETRY = 0.3  # s
OUTSIDE = 0.05  # m that the torch may stand outside its box: farther away it would not find home


class RobotTransport:
    """Opens when the robot is there; then the controller runs with ROS time. on_problem is told when the arc is cut;
    keeps_up: whether all nodes answer in time at controller time, us. A simulated clock waits for those that do not:
    simulated time costs nothing. A dead one still ends the arc by the lease."""

    def __init__(
        self,
        node: Node,
        params: RobotParams,
        owner: Owner,
        on_problem: Callable[[str], None],
        keeps_up: Callable[[int], bool] = lambda now_us: True,
    ) -> None:
        self._node, self._params, self._owner = node, params, owner
        self._on_problem, self._keeps_up = on_problem, keeps_up
        self._news = threading.Event()
        self._stop = threading.Event()
        self._lock = threading.Lock()
        self._waiting = bytearray()  # bytes for the controller
        self._urgent = self._open = False  # some of them act now; there is a controller
        self._reason = ''
        self.driver = RosDriver(node, params, self._news.set)
        self.welder = RosWelder(node)
        self.station = station_of(params)
        self._samples = np.zeros(STEP_MS, SAMPLE)
        self._thread = threading.Thread(target=self._run, name='link', daemon=True)

    def start(self) -> None:
        """Starts the thread."""
        self._thread.start()

    def close(self) -> None:
        """Ends the thread; the welding device is told that nothing is on."""
        self._stop.set()
        self._news.set()
        if self._thread.is_alive():
            self._thread.join(2.0)

    def reopen(self, reason: str) -> None:
        """Begins anew, because of `reason`."""
        self._reason = reason
        self._news.set()

    def write(self, data: bytes) -> None:
        """Bytes for the controller; they act in its next step."""
        with self._lock:
            self._waiting += data

    def write_now(self, data: bytes) -> str:
        """Real-time bytes act before all that waits, and before the controller's next step; '' or why they do not."""
        with self._lock:
            self._waiting[:0] = data
            self._urgent = True
        self._news.set()
        return '' if self._open else 'the robot is not there'

    # ---- the thread

    def _run(self) -> None:
        try:
            while not self._stop.is_set():
                absent = self.driver.absent() or self.welder.problem() or self._outside()
                if absent:
                    self._owner.on_close(f'robot: {absent}')
                    self._stop.wait(RETRY)
                    continue
                self._serve()
        except Exception as e:
            if self._stop.is_set():
                return  # the node ends, and what this stood on is gone
            self._owner.on_crash(e)  # a defect: the node ends, the device's watchdog ends the arc

    def _serve(self) -> None:
        controller = self._make()
        self._reason = ''
        with self._lock:
            self._waiting.clear()
        self._open = True
        self._owner.on_open()
        rest = b''
        try:
            while not self._stop.is_set() and not self._reason:
                self._news.wait(IDLE)
                self._news.clear()
                self._feed(controller)
                self.driver.device = self.welder.problem()
                rest = self._catch_up(controller, rest)
                self._owner.on_idle()
        finally:
            self._open = False
            self._samples[:] = 0
            if self._node.context.ok():
                self.welder.command(self._samples[-1], controller.now_us)
            controller.close()
        if not self._stop.is_set():
            self._owner.on_close(f'robot: {self._reason}')

    def _make(self) -> RobotController:
        """A controller that was just switched on, its torch where the robot has it."""
        now_us = self._now_us()
        state = self.driver.state(now_us)
        assert state is not None  # of a robot that is there
        boot = int(time.time() * 10) % BOOTS
        made = RobotController(now_us, self._params, self.station, self.driver, boot)
        made.place(self.station.tips(state.joints[None])[0])
        made.on_problem = self._on_problem
        return made

    def _outside(self) -> str:
        """Where the torch stands, if that is so far outside its box that it must not be moved; '' = it is not."""
        state = self.driver.state(self._now_us())
        if state is None:
            return ''
        tip, p = self.station.tips(state.joints[None])[0], self._params
        low, high = np.array(p.work_low, float), np.array(p.work_high, float)
        off = float(np.maximum(np.maximum(low - tip, tip - high), 0.0).max())
        if off <= OUTSIDE:
            return ''
        x, y, z = (f'{v:.0f}' for v in tip * 1e3)
        near = np.round(self.station.joints(np.clip(tip, low, high)[None])[0], 2).tolist()
        return (
            f'the torch stands at ({x}, {y}, {z}) mm of the machine, {off * 1e3:.0f} mm outside its box. Bring it '
            f'there, to the joints {near} for one; or origin, positioner or joint_names are wrong'
        )

    @property
    def simulated(self) -> bool:
        """The clock is that of a simulated cell, which waits for this bridge."""
        clock = self._node.get_clock()
        return isinstance(clock, ROSClock) and clock.ros_time_is_active

    def _now_us(self) -> int:
        """ROS time; joint states may be ahead of a simulated clock, and for a moment it waits for them."""
        clock, newest = self._node.get_clock().now().nanoseconds // 1000, self.driver.newest_us
        if self.simulated and time.monotonic() - self.driver.heard < PATIENCE:
            clock = min(clock, newest + BEHIND_US)
        return max(clock, newest)

    def _wait(self, now_us: int) -> None:
        """For the cell to take a goal that is on its way, and for nodes that are late at controller time now_us."""
        while self.driver.waits(now_us) and not self._stop.is_set() and not self._urgent:
            self._news.wait(IDLE)
            self._news.clear()
        if not self._urgent and not self._keeps_up(now_us):
            self._stop.wait(SLOW)

    def _feed(self, controller: RobotController) -> None:
        """Bytes of the host; those of real time act at once."""
        with self._lock:
            data, self._urgent = bytes(self._waiting), False
            self._waiting.clear()
        controller.feed(data)

    def _catch_up(self, controller: RobotController, rest: bytes) -> bytes:
        """Steps until ROS time is reached; hands the controller's lines over and returns the incomplete one."""
        for _ in range(MAX_STEPS):
            if controller.now_us + 1000 * STEP_MS > self._now_us():
                break
            if self.simulated:
                self._wait(controller.now_us)
            self._feed(controller)
            controller.answer(self.welder.reading)
            controller.step(self._samples)
            self.welder.command(self._samples[-1], controller.now_us)
            *lines, rest = (rest + controller.take()).split(b'\n')
            if lines:
                self._owner.on_lines(lines, time.monotonic())
        return rest
