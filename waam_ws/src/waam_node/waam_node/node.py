"""Base class of the nodes: checked parameters, heartbeat for the arc lease, diagnostics, and one way to spin."""

from __future__ import annotations

import _thread
import dataclasses
import faulthandler
import gc
import math
import os
import secrets
import signal
import socket
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service_introspection import ServiceIntrospectionState

from waam_msgs.msg import Heartbeat, LeaseTick

from . import alive, priority
from .namesake import PROCESS, UP, Namesake, NamesakeError
from .parameter_files import check as check_files
from .parameter_files import files_in
from .params import check_value, from_dict
from .qos import BEAT, EVENTS

SILENT_SERVICES = ('rcl_interfaces', 'type_description_interfaces')
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class WaamNode(Node):
    """A node that answers lease ticks with heartbeats and publishes diagnostics at 1 Hz of steady time.

    `params` is an instance of `params_type`, filled from ROS parameters; an unknown or out-of-range one raises
    ParameterError before anything is created. `values` (shown in diagnostics) may be written at any time.
    """

    def __init__(self, name: str, params_type: type, **node_options: Any) -> None:
        super().__init__(name, **node_options)
        self.params = self._load_params(params_type)
        self.level, self.message = OK, 'ok'
        self.values: dict[str, Any] = {}
        # of this life of the node: another one by the same name has another
        me = f'{socket.gethostname()}:{os.getpid()}:{secrets.token_hex(4)}'
        self.process = f'{self.get_name()}@{me}'
        self._namesake = Namesake(self, self.process)
        self._restarted = os.environ.get(alive.RESTARTED, '')
        self._sign_of_life = alive.SignOfLife()
        self.steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._heartbeat = self.create_publisher(Heartbeat, 'heartbeat', BEAT)
        self.create_subscription(LeaseTick, 'lease_tick', self._on_tick, BEAT)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', EVENTS)
        self.create_timer(1.0, self._publish_diagnostics, clock=self.steady)

    def create_service(
        self, srv_type: type, srv_name: str, callback: Callable, **options: Any
    ) -> Any:
        """As of any node; requests and answers also go out on `<service>/_service_event`, so that a record of the
        topics holds them and a replay can ask again. Those of the middleware (parameters) stay silent."""
        service = super().create_service(srv_type, srv_name, callback, **options)
        if not srv_type.__module__.startswith(SILENT_SERVICES):
            service.configure_introspection(
                self.get_clock(), EVENTS, ServiceIntrospectionState.CONTENTS
            )
        return service

    def _load_params(self, params_type: type) -> Any:
        check_files(files_in(sys.argv), self.get_fully_qualified_name())
        overrides = {n: p.value for n, p in self._parameter_overrides.items()}
        params = from_dict(params_type, overrides, self.get_name())
        for f in dataclasses.fields(params_type):
            value = getattr(params, f.name)
            unit = f' [{f.metadata["unit"]}]' if f.metadata.get('unit') else ''
            descriptor = ParameterDescriptor(
                description=f.metadata['description'] + unit,
                read_only=not f.metadata['changeable'],
                dynamic_typing=isinstance(value, tuple),
                **_range(value, f.metadata),
            )
            self.declare_parameter(
                f.name, list(value) if isinstance(value, tuple) else value, descriptor
            )
        return params

    def on_change(self, take: Callable[[Any], None]) -> None:
        """From now on changeable parameters may be set: `take` gets what `params` would be then, and refuses it by a
        ValueError. All that one request sets together are taken together."""

        def changed(wanted: list[Parameter]) -> SetParametersResult:
            fields = {f.name: f for f in dataclasses.fields(self.params)}
            given = {p.name: p.value for p in wanted if p.name in fields}
            try:
                checked = {n: check_value(n, v, fields[n]) for n, v in given.items()}
                params = dataclasses.replace(self.params, **checked)
                take(params)
            except ValueError as e:
                return SetParametersResult(successful=False, reason=str(e))
            self.params = params
            return SetParametersResult(successful=True)

        self.add_on_set_parameters_callback(changed)

    def responsive(self) -> bool:
        """Whether the node does its work. A node with threads of its own overrides it: a stuck one gives no
        heartbeat, and the supervisor treats it as hanging."""
        return True

    def _on_tick(self, tick: LeaseTick) -> None:
        # the executor still runs what was due when the node was stopped
        if not self.context.ok() or not self.responsive():
            return
        beat = Heartbeat(
            node=self.get_name(), controller_us=tick.controller_us, boot_id=tick.boot_id
        )
        beat.level = self.level[0]
        self._heartbeat.publish(beat)

    def _publish_diagnostics(self) -> None:
        if not self.context.ok():
            return
        if self.responsive():
            self._sign_of_life.give()
        self._namesake.look()
        status = DiagnosticStatus(
            level=self.level, name=f'{self.get_name()}: state', message=self.message
        )
        status.hardware_id = self.get_name()
        status.values = [KeyValue(key=str(k), value=str(v)) for k, v in self.values.items()]
        status.values.append(KeyValue(key=PROCESS, value=self.process))
        status.values.append(KeyValue(key=UP, value=f'{self._namesake.up:.1f}'))
        if self._restarted:
            status.values.append(KeyValue(key='restarted', value=self._restarted))
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def now_s(self) -> float:
        """ROS time in seconds."""
        return self.get_clock().now().nanoseconds * 1e-9


def _range(value: Any, meta: Mapping[str, Any]) -> dict[str, Any]:
    """What a descriptor says of the limits of a parameter; no range for NaN, which ROS would refuse."""
    low, high = meta.get('minimum'), meta.get('maximum')
    if isinstance(value, bool) or value != value or (low is None and high is None):
        return {}
    if isinstance(value, int):
        low, high = -(2**63) if low is None else low, 2**63 - 1 if high is None else high
        return {'integer_range': [IntegerRange(from_value=int(low), to_value=int(high))]}
    ends = (-math.inf if low is None else float(low), math.inf if high is None else float(high))
    return {'floating_point_range': [FloatingPointRange(from_value=ends[0], to_value=ends[1])]}


class CallError(RuntimeError):
    """A service that is missing or did not answer; the text names it."""


def call(
    client: Any, request: Any, timeout: float, abort: Callable[[], str | None] | None = None
) -> Any:
    """Calls a service from a thread that is NOT the executor's and waits at most `timeout` seconds (steady time).

    `abort` is called while waiting; when it returns a reason, the wait ends with CallError.
    """
    done = threading.Event()
    end = time.monotonic() + timeout
    while not client.service_is_ready():
        if time.monotonic() > end:
            raise CallError(f'service {client.srv_name} is not there (waited {timeout:.1f} s)')
        if abort and (reason := abort()):
            raise CallError(reason)
        time.sleep(0.01)
    future = client.call_async(request)
    future.add_done_callback(lambda _: done.set())
    while not done.wait(0.05):
        if abort and (reason := abort()):
            client.remove_pending_request(future)
            raise CallError(reason)
        if time.monotonic() > end:
            client.remove_pending_request(future)
            raise CallError(f'service {client.srv_name} did not answer within {timeout:.1f} s')
    return future.result()


def spin(node: Node) -> None:
    """Spins until shutdown. Finite timeouts: the untimed spin dispatches nothing in these wheels."""
    executor = EventsExecutor()
    executor.add_node(node)
    _spinning.set()
    try:
        while rclpy.ok() and not _stopped.is_set():
            executor.spin_once(timeout_sec=0.1)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        _spinning.clear()
        executor.shutdown()


_spinning, _stopped = threading.Event(), threading.Event()
STUCK = 2.0  # s that a callback may take to end before the context goes all the same


def _end(*_: object) -> None:
    """Of SIGTERM and SIGINT. In a thread, for it may interrupt `rclpy.ok()`, which holds the lock that a shutdown
    needs."""
    _stopped.set()
    _thread.start_new_thread(_shut_down, ())


def _shut_down() -> None:
    """Between two callbacks: when the context goes under one, what it raises can abort the process."""
    end = time.monotonic() + STUCK
    while _spinning.is_set() and time.monotonic() < end:
        time.sleep(0.01)
    rclpy.try_shutdown()


def run(factory: Callable[[], Node], args: list[str] | None = None) -> int:
    """The main of every node: exit status 0 after a clean stop, 2 for bad parameters and for a node whose name is
    taken, 1 for a crash."""
    faulthandler.register(signal.SIGUSR1)  # where every thread is, into the log
    turn = priority.take()  # before the middleware starts its threads
    rclpy.init(args=args)
    for told in (signal.SIGTERM, signal.SIGINT):
        signal.signal(told, _end)
    node = None
    try:
        node = factory()
        node.get_logger().info(f'priority: {turn}')
        gc.collect()
        gc.freeze()  # a collection over all imported modules takes 40 ms, every few seconds
        spin(node)
    except Exception as e:
        if _stopped.is_set() or not rclpy.ok():  # it was being made, or a callback was running
            return 0
        if isinstance(e, NamesakeError) or (node is None and isinstance(e, ValueError)):
            print(f'error: {e}', file=sys.stderr)
            return 2
        traceback.print_exc()
        return 1
    finally:
        if node is not None:
            if hasattr(node, 'close'):
                node.close()
            node.destroy_node()
        rclpy.try_shutdown()
    return 0


def main(factory: Callable[[], Node]) -> None:
    """For entry points. Leaves without waiting for stray threads of the middleware."""
    code = run(factory)
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
