"""Starts the real node as a process and talks to it over DDS, for the tests of this folder."""

from __future__ import annotations

import contextlib
import os
import subprocess
import threading
import time
from pathlib import Path

import rclpy
from ament_index_python.packages import get_package_prefix
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor

from waam_msgs.msg import (
    Anomaly,
    LeaseTick,
    LinkStatus,
    MachineState,
    Override,
    SegmentDone,
    Telemetry,
)
from waam_msgs.srv import Command, Enqueue
from waam_node import qos
from waam_node.conversions import segment_to_msg
from waam_node.testing import fresh_domain

BRIDGE = [str(Path(get_package_prefix('waam_bridge')) / 'lib/waam_bridge/bridge')]


def virtual_controller():
    """The installed controller, or the build that WAAM_VIRTUAL_CONTROLLER names."""
    installed = Path(get_package_prefix('waam_firmware')) / 'lib/waam_firmware/virtual_controller'
    return Path(os.environ.get('WAAM_VIRTUAL_CONTROLLER', installed))


def until(condition, timeout=40.0, what='condition'):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, f'{what}: not reached within {timeout} s'
        time.sleep(0.005)


class Bridge:
    """A bridge process and a client node in a ROS domain of their own."""

    def __init__(self, port, **params):
        self.domain = fresh_domain()
        self.port, self.params = str(port), params
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node('bridge_test', context=self.context)
        self.got = {k: [] for k in ('telemetry', 'state', 'done', 'link', 'tick', 'anomaly')}
        for key, kind, topic, profile in (
            ('telemetry', Telemetry, 'telemetry', qos.TELEMETRY),
            ('state', MachineState, 'machine_state', qos.LATCHED),
            ('done', SegmentDone, 'segment_done', qos.EVENTS),
            ('link', LinkStatus, 'link_status', qos.BEAT),
            ('tick', LeaseTick, 'lease_tick', qos.BEAT),
            ('anomaly', Anomaly, 'anomaly', qos.EVENTS),
        ):
            self.node.create_subscription(kind, topic, self.got[key].append, profile)
        self.override = self.node.create_publisher(Override, 'override', qos.NEWEST)
        self._command = self.node.create_client(Command, 'bridge/command')
        self._enqueue = self.node.create_client(Enqueue, 'bridge/enqueue')
        self._stop = threading.Event()
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self.process = None
        self.start()

    def _spin(self):
        with contextlib.suppress(ExternalShutdownException):
            while not self._stop.is_set():
                self._executor.spin_once(timeout_sec=0.05)

    def start(self):
        args = ['--ros-args', '-p', f'port:={self.port}']
        for name, value in self.params.items():
            args += ['-p', f'{name}:={value}']
        env = {**os.environ, 'ROS_DOMAIN_ID': str(self.domain)}
        self.process = subprocess.Popen(BRIDGE + args, env=env)

    @property
    def state(self):
        return self.got['state'][-1] if self.got['state'] else MachineState()

    @property
    def telemetry(self):
        return self.got['telemetry'][-1]

    @property
    def done(self):
        return [m.index for m in self.got['done']]

    def ready(self):
        until(lambda: self.state.connected, what='connection')
        until(self._command.service_is_ready)
        until(self._enqueue.service_is_ready)
        until(lambda: self.got['telemetry'])
        # a server that has not yet found the reader of a new client loses its first answer
        time.sleep(0.5)
        return self

    def call(self, client, request):
        future = client.call_async(request)
        until(future.done, what=client.srv_name)
        return future.result()

    def command(self, code, vector=(0.0, 0.0, 0.0), **fields):
        request = Command.Request(code=code, **fields)
        request.vector.x, request.vector.y, request.vector.z = vector
        return self.call(self._command, request)

    def enqueue(self, segments, job='j', last=True):
        messages = [segment_to_msg(s) for s in segments]
        return self.call(self._enqueue, Enqueue.Request(job_id=job, segments=messages, last=last))

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(5)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait(5)
        self._stop.set()
        self._thread.join(2)
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
        return self.process.returncode


class VirtualController:
    """The real C core on a pseudo-terminal, with the plant that does nothing wrong."""

    def __init__(self, folder, *options):
        self.path, self.events = folder / 'tty', folder / 'events'
        program = virtual_controller()
        command = [
            program,
            '--null-plant',
            '--pty-link',
            self.path,
            '--events',
            self.events,
            *options,
        ]
        self.process = subprocess.Popen(
            [str(c) for c in command], stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout.readline().startswith('ready')

    def times(self, event):
        """Controller times of an event, us."""
        rows = (line.split(' ', 1) for line in self.events.read_text().splitlines())
        return [int(t) for t, text in rows if text.startswith(event)]

    def close(self):
        self.process.terminate()
        self.process.wait(5)
        self.process.stdout.close()
