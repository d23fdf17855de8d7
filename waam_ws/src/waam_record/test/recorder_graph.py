"""The recorder as a process over DDS, and a node that publishes and calls it."""

import os
import subprocess
import sys
import time

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from waam_msgs.srv import Record

START = 'from waam_record.recorder_node import main; main()'


class Graph:
    """A recorder process and a node that publishes and calls it, in a domain of their own."""

    def __init__(self, domain: int, *parameters: str, program: str = START) -> None:
        arguments = [a for p in parameters for a in ('-p', p)]
        command = [sys.executable, '-c', program, '--ros-args', *arguments]
        env = {**os.environ, 'ROS_DOMAIN_ID': str(domain)}
        self.process = subprocess.Popen(command, env=env, stderr=subprocess.PIPE, text=True)
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = Node('tester', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.client = self.node.create_client(Record, 'recorder/control')
        self.matched = False

    def call(self, code: int, **fields) -> Record.Response:
        assert self.client.wait_for_service(timeout_sec=90)
        if not self.matched:
            self._match()
        future = self.client.call_async(Record.Request(code=code, **fields))
        self.spin_until(future.done, 60)
        return future.result()

    def _match(self) -> None:
        """A server that has not yet found the reader of a new client loses its answer: ask something harmless first."""
        for _ in range(20):
            future = self.client.call_async(Record.Request(code=0))
            end = time.monotonic() + 3
            while not future.done() and time.monotonic() < end:
                self.executor.spin_once(timeout_sec=0.02)
            if future.done():
                assert not future.result().success
                self.matched = True
                return
        raise AssertionError('the recorder answers nothing')

    def spin_until(self, condition, timeout: float) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, 'timeout'
            self.executor.spin_once(timeout_sec=0.02)

    def close(self) -> None:
        self.node.destroy_node()
        self.context.try_shutdown()
        if self.process.poll() is None:
            self.process.terminate()
        self.process.communicate(timeout=60)


SLOW_DISK = '''
import os, time
sync = os.fsync
def slow(descriptor):
    time.sleep({seconds})
    sync(descriptor)
os.fsync = slow
'''
STOP_SOON = 'import waam_record.node_thread\nwaam_record.node_thread.CLOSE_S = 0.5\n'
