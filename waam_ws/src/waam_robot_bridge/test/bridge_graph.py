"""Bridge, simulated cell and a client over real DDS, for test_robot_bridge_node.py and test_robot_driver.py."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import threading
import time
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from control_msgs.msg import DynamicInterfaceGroupValues
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from sensor_msgs.msg import JointState

from waam_msgs.msg import MachineState, SegmentDone, Telemetry
from waam_msgs.srv import Command, Enqueue
from waam_node import qos
from waam_node.conversions import segment_to_msg
from waam_node.testing import fresh_domain
from waam_process.segment import Segment


def executable(package: str, name: str) -> str:
    return str(Path(get_package_prefix(package)) / 'lib' / package / name)


def until(condition, timeout=60.0, what='condition'):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f'{what}: not reached within {timeout} s'
        time.sleep(0.01)


class Graph:
    """Two processes and a client in a domain of their own. `weld`: (s of controller time, A) as the device tells;
    tilt: rad, of bridge and cell."""

    def __init__(
        self,
        logs: Path,
        cell: bool = True,
        tilt: float = 0.0,
        pace: float = 2.0,
        cell_params: dict[str, str] | None = None,
        **bridge_params: str,
    ) -> None:
        self.domain, self.logs = fresh_domain(), logs
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node('robot_test', context=self.context)
        self.telemetry: list[Telemetry] = []
        self.states: list[MachineState] = []
        self.done: list[int] = []
        self.weld: list[tuple[float, float]] = []
        self.joints: dict[str, float] = {}
        subscribe = self.node.create_subscription
        subscribe(Telemetry, 'telemetry', self.telemetry.append, qos.TELEMETRY)
        subscribe(MachineState, 'machine_state', self.states.append, qos.LATCHED)
        subscribe(SegmentDone, 'segment_done', lambda m: self.done.append(m.index), qos.EVENTS)
        subscribe(DynamicInterfaceGroupValues, 'weld_state', self._on_weld, qos.BEAT)
        subscribe(JointState, 'joint_states', self._on_joints, qos.BEAT)
        self._command = self.node.create_client(Command, 'bridge/command')
        self._enqueue = self.node.create_client(Enqueue, 'bridge/enqueue')
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._stop = threading.Event()
        threading.Thread(target=self._spin, daemon=True).start()
        sim = str(cell).lower()
        self.bridge = self._start(
            'waam_robot_bridge', 'robot_bridge', use_sim_time=sim, tilt=f'{tilt}', **bridge_params
        )
        self.processes = [self.bridge]
        if cell:
            own = {'robot_tilt': f'{tilt}', **(cell_params or {})}
            made = self._start(
                'waam_sim', 'robot_cell', use_sim_time='false', pace=f'{pace}', **own
            )
            self.processes.append(made)

    def _start(self, package: str, name: str, **params: str) -> subprocess.Popen:
        args = [a for key, value in params.items() for a in ('-p', f'{key}:={value}')]
        return self.start(name, [executable(package, name), '--ros-args', *args])

    def start(self, name: str, command: list[str]) -> subprocess.Popen:
        """A process in the domain of the graph, with a log of its name; `close` ends those of `processes`."""
        env = {**os.environ, 'ROS_DOMAIN_ID': str(self.domain)}
        env.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        with open(self.logs / f'{name}.log', 'w') as log:
            return subprocess.Popen(command, env=env, stdout=log, stderr=log)

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            while not self._stop.is_set():
                self._executor.spin_once(timeout_sec=0.05)

    def _on_joints(self, msg: JointState) -> None:
        self.joints.update(zip(msg.name, msg.position, strict=True))

    def _on_weld(self, msg: DynamicInterfaceGroupValues) -> None:
        group = msg.interface_values[0]
        found = dict(zip(group.interface_names, group.values, strict=True))
        stamp = msg.header.stamp
        self.weld.append((stamp.sec + 1e-9 * stamp.nanosec, found['current']))

    @property
    def state(self) -> MachineState:
        return self.states[-1] if self.states else MachineState()

    @property
    def burns(self) -> bool:
        return bool(self.weld) and self.weld[-1][1] > 30.0

    def call(self, client, request):
        until(client.service_is_ready, what='service')
        future = client.call_async(request)
        until(future.done, what='answer')
        return future.result()

    def ask(self, code: int, **values) -> Command.Response:
        vector = values.pop('vector', None)
        request = Command.Request(code=code, **values)
        if vector:
            request.vector.x, request.vector.y, request.vector.z = vector
        return self.call(self._command, request)

    def command(self, code: int, **values) -> None:
        answer = self.ask(code, **values)
        assert answer.error_code == 0, answer.message

    def enqueue(self, segments: list[Segment]) -> Enqueue.Response:
        request = Enqueue.Request(job_id='job', last=True)
        request.segments = [segment_to_msg(s) for s in segments]
        return self.call(self._enqueue, request)

    def log(self, name: str) -> str:
        return (self.logs / f'{name}.log').read_text()

    def close(self) -> None:
        for process in self.processes:
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
        for process in self.processes:
            process.wait(15.0)
        self._stop.set()
        self._executor.shutdown()
        rclpy.shutdown(context=self.context)
