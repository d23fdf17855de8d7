"""The panel as a process in a graph: what the page asks for reaches bridge and job, what they say reaches the page."""

from __future__ import annotations

import asyncio
import http.server
import json
import os
import re
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from pathlib import Path

import aiohttp
import numpy as np
import pytest
import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from waam_msgs.msg import Heartbeat, JobStatus, LeaseTick, MachineState, Override, Telemetry
from waam_msgs.srv import Command
from waam_node.qos import BEAT, LATCHED, NEWEST, TELEMETRY
from waam_panel.node_standoff import NAMES, OF_SOURCE

START = 'from waam_panel.panel_node import main; main()'


def free_port() -> int:
    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        return s.getsockname()[1]


class Receiver:
    """A webhook of this machine; titles and texts of what it was sent."""

    def __init__(self) -> None:
        self.messages: list[str] = []
        told = self.messages

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers['Content-Length'])))
                told.append(f'{body["title"]}: {body["message"]}')
                self.send_response(200)
                self.end_headers()

            def log_message(self, *_: object) -> None:
                pass

        self.server = http.server.HTTPServer(('127.0.0.1', 0), Handler)
        self.address = f'json://127.0.0.1:{self.server.server_port}/secret'
        threading.Thread(target=self.server.serve_forever, daemon=True).start()


class Graph:
    """The panel, and a node that plays bridge and job_sequencer."""

    def __init__(self, domain: int, folder) -> None:
        self.folder, self.told = folder, Receiver()
        shop = folder / '.shop'
        shop.mkdir()
        notify = shop / 'notify.yaml'
        notify.write_text(f'targets: [{{name: hook, url: "{self.told.address}"}}]\nwire_m: 40\n')
        notify.chmod(0o600)
        self.port = free_port()
        self.url = f'http://127.0.0.1:{self.port}/'
        values = {'port': self.port, 'jobs_dir': folder, 'part_folders': f'[{folder}/parts]'}
        given = [x for k, v in values.items() for x in ('-p', f'{k}:={v}')]
        self.process = subprocess.Popen(
            [sys.executable, '-c', START, '--ros-args', *given],
            env={**os.environ, 'ROS_DOMAIN_ID': str(domain)}, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        self.context = rclpy.context.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = node = rclpy.create_node('cell', context=self.context)
        self.commands: list[Command.Request] = []
        self.switched: list[str] = []
        self.overrides: list[Override] = []
        self.beats: list[int] = []
        node.create_service(Command, 'bridge/command', self._on_command)
        for name in ('pause', 'resume'):  # abort is missing: a job_sequencer that hangs
            node.create_service(Trigger, f'job_sequencer/{name}', self._on_switch(name))
        node.create_subscription(
            Heartbeat, 'heartbeat', lambda m: self.beats.append(m.controller_us), BEAT
        )
        self.telemetry = node.create_publisher(Telemetry, 'telemetry', TELEMETRY)
        self.machine = node.create_publisher(MachineState, 'machine_state', LATCHED)
        self.ticks = node.create_publisher(LeaseTick, 'lease_tick', BEAT)
        self.job = node.create_publisher(JobStatus, 'job_status', LATCHED)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(node)
        # the parameters of the bridge that the page sets
        self.bridge = rclpy.create_node('bridge', context=self.context)
        for name in (*NAMES, *OF_SOURCE):
            text = {'standoff_source': 'none', 'standoff_law': 'pid'}
            self.bridge.declare_parameter(name, text.get(name, 0.004))
        self.obeys = True
        self.listen()
        self._executor.add_node(self.bridge)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self.until(self.served, 'the page')
        self.until(lambda: self.telemetry.get_subscription_count() > 0, 'the panel')
        self.until(lambda: self.post('resume')[0] == 200, 'the first answer')
        self.commands.clear()

    def _spin(self) -> None:
        while not self._over.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def listen(self) -> None:
        reader = self.bridge.create_subscription(Override, 'override', self._on_override, NEWEST)
        self.override_reader = reader

    def _on_override(self, message: Override) -> None:
        self.overrides.append(message)
        if self.obeys:
            factors = {'speed_override': message.speed_factor, 'wire_override': 1.0}
            self.telemetry.publish(Telemetry(**factors))

    def _on_command(self, request, response):
        self.commands.append(request)
        if request.code == Command.Request.RESET:
            response.error_code, response.message = Command.Response.REFUSED, 'the cause is there'
        return response

    def _on_switch(self, name: str):
        def answer(_request, response):
            self.switched.append(name)
            response.success = True
            return response

        return answer

    def until(self, condition, what: str, timeout: float = 40.0) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end, f'{what} did not come'
            assert self.process.poll() is None, self.process.stderr.read()
            time.sleep(0.02)

    def served(self) -> bool:
        try:
            page = urllib.request.urlopen(self.url, timeout=5).read().decode()
        except OSError:
            return False
        self.csrf = re.search(r'name="csrf" content="(\w+)"', page)[1]
        return True

    def post(self, name: str, data: dict | None = None) -> tuple[int, dict]:
        headers = {'Content-Type': 'application/json', 'X-Waam-Csrf': self.csrf}
        body = json.dumps(data or {}).encode()
        request = urllib.request.Request(f'{self.url}api/{name}', body, headers)
        try:
            with urllib.request.urlopen(request, timeout=40) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as e:
            return e.code, json.load(e)

    def frame(self, good) -> dict:
        """The first state of a page for which `good` holds: what has come so far, put together."""

        async def go() -> dict:
            origin = {'Origin': self.url.rstrip('/')}
            async with aiohttp.ClientSession() as session:
                async with session.ws_connect(f'{self.url}stream', headers=origin) as stream:
                    sections, alarms = {}, {}
                    while True:
                        frame = await stream.receive_json(timeout=30)
                        if 'history' in frame:
                            continue
                        sections |= frame['sections']
                        alarms |= {a['id']: a for a in frame['alarms']}
                        newest = sorted(alarms.values(), key=lambda a: -a['id'])
                        frame |= {'sections': sections, 'alarms': newest}
                        if good(frame):
                            return frame

        return asyncio.run(asyncio.wait_for(go(), 40))

    def close(self) -> None:
        self.process.terminate()
        self.process.communicate(timeout=20)
        self._over.set()
        self._thread.join(5)
        self._executor.shutdown()
        self.node.destroy_node()
        self.bridge.destroy_node()
        self.context.try_shutdown()
        self.told.server.shutdown()
        self.told.server.server_close()


@pytest.fixture(scope='module')
def cell(domain, tmp_path_factory):
    graph = Graph(domain, tmp_path_factory.mktemp('panel'))
    yield graph
    graph.close()
    assert graph.process.returncode == 0


def test_commands_reach_the_bridge_in_si_and_its_words_come_back(cell):
    assert cell.post('home')[0] == 200
    assert cell.post('jog', {'axis': 'y', 'direction': -1, 'step': 10})[0] == 200
    assert cell.post('jog_wire', {'mm': 10})[0] == 200
    home, jog, wire = cell.commands[-3:]
    assert home.code == Command.Request.HOME
    assert (jog.code, jog.vector.y, jog.value) == (Command.Request.JOG, -0.01, 0.02)
    assert (wire.code, wire.value) == (Command.Request.JOG_WIRE, 0.01)
    assert cell.post('reset') == (409, {'ok': False, 'message': 'the cause is there'})


def test_stop_reaches_the_machine_although_the_job_does_not_answer(cell):
    status, answer = cell.post('stop')
    assert status == 200 and 'stopped' in answer['message'] and 'abort' in answer['message']
    assert cell.commands[-1].code == Command.Request.STOP


STANDOFF = {
    'source': 'laser',
    'law': 'pid',
    'set_mm': 102.0,
    'up_mm': 5.0,
    'down_mm': 3.0,
    'wander_mm': 1.6,
}


def test_the_standoff_control_is_set_by_parameters_of_the_bridge(cell):
    def value(name: str):
        return cell.bridge.get_parameter(name).value

    other = {'standoff_source': 'none', **dict.fromkeys(OF_SOURCE, 0.004)}
    cell.bridge.set_parameters([Parameter(n, value=v) for n, v in other.items()])
    cell.until(lambda: cell.post('standoff', STANDOFF)[0] == 200, 'the bridge')
    assert value('standoff_source') == 'laser' and value('standoff_set') == pytest.approx(0.102)
    assert value('standoff_up') == 0.005 and value('standoff_down') == 0.003
    assert value('standoff_arc_wander') == pytest.approx(0.0016)
    assert all(np.isnan(value(n)) for n in OF_SOURCE), 'what fitted another source'
    kp = Parameter('standoff_kp', value=7.0)
    cell.bridge.set_parameters([kp])
    assert cell.post('standoff', STANDOFF | {'set_mm': None})[0] == 200
    assert value('standoff_kp') == 7.0 and np.isnan(value('standoff_set'))
    no = SetParametersResult(successful=False, reason="job 'j' is armed")

    def refuse(_parameters):
        return no

    cell.bridge.add_on_set_parameters_callback(refuse)
    try:
        assert cell.post('standoff', STANDOFF) == (409, {'ok': False, 'message': no.reason})
    finally:
        cell.bridge.remove_on_set_parameters_callback(refuse)
    assert np.isnan(value('standoff_set')), 'all together or none'


def test_an_override_is_said_until_telemetry_shows_it(cell):
    cell.obeys = False  # the first ones are lost
    threading.Timer(1.2, lambda: setattr(cell, 'obeys', True)).start()
    status, answer = cell.post('override', {'speed': 0.8})
    assert (status, answer['message']) == (200, 'override in force: speed 0.8')
    last = cell.overrides[-1]
    assert (last.speed_factor, last.source) == (0.8, 'panel') and last.wire_factor != last.wire_factor  # fmt: skip
    assert len(cell.overrides) >= 2


def test_an_override_that_nobody_takes_is_refused(cell):
    cell.obeys = False
    status, answer = cell.post('override', {'wire': 0.9})
    assert status == 409 and 'override: not in force after 5 s' in answer['message']
    cell.bridge.destroy_subscription(cell.override_reader)
    cell.until(
        lambda: (
            'the bridge is not in the graph' in cell.post('override', {'wire': 0.9})[1]['message']
        ),
        'the reason',
    )
    cell.obeys = True
    cell.listen()


def test_what_the_cell_says_is_on_the_page_and_goes_stale(cell):
    state = MachineState(connected=True, identity='WAAM_CONTROLLER_V1', homed=True, fault=204)
    state.state, state.fault_text = MachineState().state + 2, 'arc lost'
    frame = Telemetry(arc_current=181.0, wire_feed_speed=0.1, arc_established=True, state=2)
    frame.wire_feed = Telemetry.WIRE_FEED_UNDERFEED
    frame.header.stamp.sec = 5
    over = threading.Event()

    def speak() -> None:
        while not over.wait(0.02):
            cell.machine.publish(state)
            cell.telemetry.publish(frame)

    speaker = threading.Thread(target=speak)
    speaker.start()
    try:
        shown = cell.frame(
            lambda f: f['samples'] and 'machine' in f['sections'] and f.get('alarms')
        )
    finally:
        over.set()
        speaker.join()
    assert shown['sections']['telemetry']['current'] == 181.0
    assert shown['sections']['telemetry']['feed'] == pytest.approx(6.0)
    assert shown['sections']['telemetry']['wire_feed'] == 'underfeed'
    assert shown['sections']['machine']['identity'] == 'WAAM_CONTROLLER_V1'
    assert shown['alarms'][0]['code'] == '204' and shown['alarms'][0]['action']
    assert 'telemetry' in cell.frame(lambda f: 'telemetry' in f['stale'])['stale']


def test_people_are_told_what_happens_in_the_graph(cell):
    """Done, paused, alarm, out of tolerance and low wire, each once: from topics and job files to a webhook."""
    folder = Path(tempfile.mkdtemp(prefix='told', dir=cell.folder))
    job, told = folder.name, cell.told.messages
    cause, before = f'no arc in {job}', len(told)
    fault = 205 + len(list(cell.folder.glob('told*')))  # an alarm that comes again is told of later
    words = (
        '12 m of wire',
        f'{job} is paused. scanner is dirty',
        cause,
        f'{job}: done. 2 layers',
        f'{job} is out of tolerance',
    )

    def wait(*some: str) -> None:
        cell.until(lambda: all(any(w in m for m in told[before:]) for w in some), f'{some}')

    def say(state: int, message: str = '') -> None:
        status = JobStatus(job_id=job, job_dir=str(folder), state=state, message=message)
        cell.job.publish(status)

    cell.machine.publish(MachineState(connected=True, state=1))
    say(JobStatus.DEPOSITING)
    cell.frame(lambda f: f['sections'].get('job', {}).get('id') == job)
    (folder / 'records.json').write_text('{"spool": 12.0}')
    wait(words[0])
    say(JobStatus.PAUSED, 'scanner is dirty')
    wait(words[1])
    cell.machine.publish(MachineState(connected=True, state=2, fault=fault, fault_text=cause))
    wait(words[2])
    (folder / 'report.json').write_text('{"verdict": "out of tolerance"}')
    say(JobStatus.DONE, '2 layers')
    wait(*words[3:])
    time.sleep(1.5)  # the panel looks once a second
    assert [sum(w in m for m in told[before:]) for w in words] == [1] * 5, told


def test_heartbeats_are_answered_while_pages_hang(cell):
    hanging = []
    for _ in range(4):
        s = socket.create_connection(('127.0.0.1', cell.port))
        s.sendall(
            f'GET /stream HTTP/1.1\r\nHost: 127.0.0.1:{cell.port}\r\nOrigin: {cell.url.rstrip("/")}\r\nUpgrade: '
            'websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n'
            'Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n'.encode()
        )
        hanging.append(s)
    for us in range(1, 31):
        cell.ticks.publish(LeaseTick(controller_us=us))
        cell.until(lambda n=us: n in cell.beats, f'heartbeat {us}')
    for s in hanging:
        s.close()


@pytest.mark.parametrize(
    'given,words',
    [
        (('bind:=0.0.0.0',), "'token_file'"),
        (('token_file:=/none/there',), 'No such file'),
        (('prot:=1',), "did you mean 'port'"),
    ],
)
def test_what_must_not_start_does_not(domain, given, words):
    arguments = [x for g in given for x in ('-p', g)]
    done = subprocess.run(
        [sys.executable, '-c', START, '--ros-args', *arguments], capture_output=True, text=True,
        timeout=60, env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
    )  # fmt: skip
    assert done.returncode == 2 and words in done.stderr and 'Traceback' not in done.stderr


def test_a_port_in_use_is_said_and_the_node_lives(domain):
    with socket.socket() as s:
        s.bind(('127.0.0.1', 0))
        s.listen()
        node = subprocess.Popen(
            [sys.executable, '-c', START, '--ros-args', '-p', f'port:={s.getsockname()[1]}'],
            stderr=subprocess.PIPE, text=True, env={**os.environ, 'ROS_DOMAIN_ID': str(domain)},
        )  # fmt: skip
        line = node.stderr.readline()
        assert 'no page' in line and 'in use' in line
        assert node.poll() is None
        node.terminate()
        node.communicate(timeout=20)
    assert node.returncode == 0
