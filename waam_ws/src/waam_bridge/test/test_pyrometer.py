"""The pyrometer beside the controller: what its answers mean, and instruments on a real terminal, on Modbus, on DDS."""

from __future__ import annotations

import asyncio
import dataclasses
import math
import os
import select
import subprocess
import threading
import time
import tty
from pathlib import Path

import pytest
import rclpy
import yaml
from ament_index_python.packages import get_package_prefix
from bridge_harness import until
from hypothesis import given
from hypothesis import strategies as st
from pymodbus import FramerType
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Temperature
from std_msgs.msg import Float32, Float64, String

from waam_bridge.instruments import Reader, instrument
from waam_bridge.pyrometer import Lines, PyrometerParams, Reading, address, from_line
from waam_node import qos
from waam_node.params import ParameterError, from_dict, markdown
from waam_node.testing import fresh_domain

PACKAGE = Path(__file__).parents[1]
NODE = [str(Path(get_package_prefix('waam_bridge')) / 'lib/waam_bridge/pyrometer')]
DEFAULT = PyrometerParams()


# ---- what a line says


@pytest.mark.parametrize(
    ('line', 'celsius'),
    [
        ('312.4', 312.4), (' +312.4 C', 312.4), ('312,4', 312.4), ('-3 °C', -3.0), ('0', 0.0), ('1200', 1200.0),
    ],
)  # fmt: skip
def test_a_number_is_a_temperature(line, celsius):
    assert from_line(line.encode(), DEFAULT) == Reading(celsius)


@pytest.mark.parametrize(
    'line',
    ['', 'E07', '----', 'nan', 'inf', '1e3', '1_0', '0x1F', '3 4', '312.4 K', '9999', '-60', 'T=312.4', '12.4.1', '١٢'],
)  # fmt: skip
def test_what_is_not_a_temperature_is_unknown_by_name(line):
    found = from_line(line.encode(), DEFAULT)
    assert math.isnan(found.celsius) and found.problem


def test_unit_pattern_and_range_are_those_of_the_instrument():
    raytek = PyrometerParams(pattern=r'!T(\d{4}\.\d)', unit='degF')
    assert from_line(b'!T0212.0', raytek).celsius == pytest.approx(100.0)
    assert from_line(b'212.0', raytek).problem == "'212.0' is no temperature"
    kelvin = PyrometerParams(unit='K', range_low=200.0, range_high=1000.0)
    assert from_line(b'773.15', kelvin).celsius == pytest.approx(500.0)
    assert '26.9 degC, outside 200 .. 1000' in from_line(b'300', kelvin).problem
    assert from_line(b'\xff\xfe312', DEFAULT).problem == "'\\xff\\xfe312' is no temperature"
    assert from_line(b'312 \xb0C', DEFAULT).celsius == 312.0


@given(st.binary(max_size=300))
def test_no_bytes_are_a_temperature_outside_the_range_or_an_error(data):
    found = from_line(data, DEFAULT)
    assert (found.problem == '') == math.isfinite(found.celsius)
    if not found.problem:
        assert DEFAULT.range_low <= found.celsius <= DEFAULT.range_high
        number = data.decode('latin-1').strip().rstrip('\xc2\xb0C ').replace(',', '.')
        assert float(number) == found.celsius


@given(
    st.lists(st.integers(0, 9999).map(lambda n: b'%d.%d' % divmod(n, 10)), max_size=20),
    st.lists(st.integers(1, 7), min_size=1),
    st.sampled_from([b'\r', b'\n', b'\r\n']),
)
def test_lines_are_whole_however_they_are_cut(lines, cuts, end):
    """All but the first, whose begin nobody has seen."""
    data, found, split, at, i = end.join(lines) + end, [], Lines(asked=False), 0, 0
    while at < len(data):
        found += split.add(data[at : at + cuts[i % len(cuts)]])
        at, i = at + cuts[i % len(cuts)], i + 1
    assert found == lines[1:]


@given(st.binary(max_size=2000), st.integers(1, 400))
def test_noise_does_not_pile_up(data, cut):
    split = Lines(asked=True)
    for at in range(0, len(data), cut):
        for line in split.add(data[at : at + cut]):
            from_line(line, DEFAULT)
    assert len(split._rest) <= 256


@pytest.mark.parametrize(
    ('source', 'expected'),
    [
        ('serial:/dev/ttyUSB0', ('serial', '/dev/ttyUSB0', 0)), ('modbus:/dev/ttyUSB0', ('modbus', '/dev/ttyUSB0', 0)),
        ('modbus:10.0.0.7:502', ('modbus', '10.0.0.7', 502)), ('topic:/ir/spot', ('topic', '/ir/spot', 0)),
    ],
)  # fmt: skip
def test_the_source_says_where_it_is(source, expected):
    assert address(source) == expected


@pytest.mark.parametrize(
    'source', ['', 'serial:', '/dev/ttyUSB0', 'modbus:host', 'modbus:host:0', 'modbus:host:x', 'i2c:1']
)  # fmt: skip
def test_what_is_no_source_is_refused(source):
    with pytest.raises(ValueError, match=r'pyrometer|Modbus'):
        address(source)


@pytest.mark.parametrize(
    ('values', 'name'),
    [
        ({'pattern': '('}, 'pattern'), ({'pattern': r'\d+'}, 'pattern'), ({'unit': 'C'}, 'unit'),
        ({'request': '\\x'}, 'request'), ({'range_low': 500.0, 'range_high': 400.0}, 'range_high'),
    ],
)  # fmt: skip
def test_a_parameter_that_makes_no_sense_is_refused_by_name(values, name):
    with pytest.raises(ParameterError, match=name):
        from_dict(PyrometerParams, values)


def test_the_yaml_and_the_readme_list_every_parameter_with_its_default():
    told = yaml.safe_load((PACKAGE / 'config/pyrometer.yaml').read_text())
    loaded = told['/**/pyrometer']['ros__parameters']
    assert from_dict(PyrometerParams, loaded) == DEFAULT
    assert list(loaded) == [f.name for f in dataclasses.fields(PyrometerParams)]
    assert markdown(PyrometerParams) in (PACKAGE / 'README.md').read_text()


# ---- instruments


class Watched:
    """Readings of a Reader, with the steady time of each."""

    def __init__(self, source: str, **params: object) -> None:
        p = PyrometerParams(source=source, **params)
        self.got: list[tuple[float, Reading]] = []
        self.reader = Reader(instrument(address(source), p), p.rate, self.take)

    def take(self, reading: Reading) -> None:
        self.got.append((time.monotonic(), reading))

    @property
    def last(self) -> Reading | None:
        return self.got[-1][1] if self.got else None

    def __enter__(self) -> Watched:
        self.reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.reader.close()
        assert not self.reader.alive


@pytest.fixture
def terminal():
    """The instrument's end, and the name of the computer's."""
    near, far = os.openpty()
    tty.setraw(far)
    tty.setraw(near)
    yield near, os.ttyname(far)
    os.close(near)
    os.close(far)


def test_an_instrument_that_speaks_by_itself(terminal):
    near, name = terminal
    with Watched(f'serial:{name}', rate=100.0) as w:
        until(lambda: os.write(near, b'7\r\n') and w.last is not None)  # the port is open now
        for line, expected in (
            (b'312.4\r\n', 312.4),
            (b'E03\r\n', math.nan),
            (b'298.1\r\n', 298.1),
        ):
            time.sleep(0.05)
            os.write(near, line[:2])
            time.sleep(0.02)
            os.write(near, line[2:])
            until(
                lambda e=expected: (
                    math.isnan(w.last.celsius) if math.isnan(e) else w.last.celsius == e
                )
            )
    assert any(r.problem == "'E03' is no temperature" for _, r in w.got)


def test_a_line_whose_begin_nobody_saw_is_no_temperature(terminal):
    """The rest 12.4 of 312.4 would let the next layer begin."""
    near, name = terminal
    w = Watched(f'serial:{name}', rate=100.0)
    w.reader._source.open()
    os.write(near, b'12.4\r\n312.5\r\n')
    end = time.monotonic() + 5.0
    while (found := w.reader._source.read()) is None:
        assert time.monotonic() < end
    w.reader._source.close()
    assert found == Reading(312.5)


def test_an_instrument_that_is_asked_and_falls_silent(terminal):
    near, name = terminal
    asked, silent = [], threading.Event()

    def answer() -> None:
        while not silent.is_set():
            asked.append(os.read(near, 64))
            if not silent.is_set():
                os.write(near, b'!T0451.5\r')

    thread = threading.Thread(target=answer, daemon=True)
    thread.start()
    with Watched(
        f'serial:{name}', request=r'?T\r', pattern=r'!T(\d+\.\d)', rate=20.0, timeout=0.3
    ) as w:
        until(lambda: len(w.got) > 10)
        assert {r for _, r in w.got} == {Reading(451.5)} and asked[0].startswith(b'?T\r')
        pauses = [b - a for (a, _), (b, _) in zip(w.got, w.got[1:], strict=False)]
        assert sorted(pauses)[len(pauses) // 2] >= 0.03  # not faster than asked
        silent.set()
        until(lambda: w.last.problem == 'no answer')
        assert math.isnan(w.last.celsius)


def test_a_port_that_is_not_there_is_named_and_taken_when_it_comes(tmp_path):
    link = tmp_path / 'pyrometer'
    near, far = os.openpty()
    tty.setraw(far)
    with Watched(f'serial:{link}', rate=100.0) as w:
        until(lambda: w.last is not None)
        assert math.isnan(w.last.celsius) and 'No such file' in w.last.problem
        link.symlink_to(os.ttyname(far))
        until(lambda: os.write(near, b'20.0\n') and w.last == Reading(20.0))
    os.close(near)
    os.close(far)


class ModbusDevice:
    """A pymodbus server, device 3: input registers 0.. = `registers`. On 127.0.0.1, or on the terminal `serial`."""

    def __init__(self, registers: list[int], port: int = 0, serial: str = '') -> None:
        self._registers, self.port, self._serial = registers, port, serial
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._ready = threading.Event()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        block = SimData(0, values=self._registers, datatype=DataType.REGISTERS)
        device = SimDevice(3, [block])
        self._server = (
            ModbusSerialServer(device, framer=FramerType.RTU, port=self._serial, baudrate=9600)
            if self._serial
            else ModbusTcpServer(device, address=('127.0.0.1', self.port))
        )
        assert await self._server.listen()
        if not self._serial:
            self.port = self._server.transport.sockets[0].getsockname()[1]
        self._ready.set()
        await self._server.serving

    def __enter__(self) -> ModbusDevice:
        self._thread.start()
        assert self._ready.wait(10.0)
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(10.0)
        self._thread.join(10.0)


@pytest.mark.parametrize(
    ('registers', 'kind', 'scale', 'celsius'),
    [
        ([3124], 'int16', 0.1, 312.4), ([65486], 'int16', 0.1, -5.0), ([65486], 'uint16', 0.01, 654.86),
        ([0x439C, 0x3333], 'float32', 1.0, 312.4), ([0x3333, 0x439C], 'float32_swapped', 1.0, 312.4),
    ],
)  # fmt: skip
def test_registers_of_a_modbus_device(registers, kind, scale, celsius):
    with ModbusDevice(registers) as device:
        source = f'modbus:127.0.0.1:{device.port}'
        with Watched(source, device=3, register_type=kind, scale=scale, rate=20.0) as w:
            until(lambda: len(w.got) > 3)
    assert w.got[1][1].celsius == pytest.approx(celsius, abs=1e-4)


def test_a_modbus_device_that_goes_is_unknown_and_comes_back():
    with ModbusDevice([3000]) as device:
        port = device.port
        w = Watched(f'modbus:127.0.0.1:{port}', device=3, scale=0.1, rate=20.0, timeout=0.3)
        w.__enter__()
        until(lambda: w.last == Reading(300.0))
    until(lambda: math.isnan(w.last.celsius))
    assert w.last.problem
    with ModbusDevice([3100], port):
        until(lambda: w.last == Reading(310.0))
    w.__exit__()


def test_modbus_over_a_serial_line():
    """RTU: two terminals with a cable between them."""
    ends = [os.openpty() for _ in range(2)]
    for pair in ends:
        for end in pair:
            tty.setraw(end)
    (near, far), (nearer, farther) = ends
    cut = threading.Event()

    def carry() -> None:
        while not cut.is_set():
            for a in select.select([near, nearer], [], [], 0.05)[0]:
                os.write(nearer if a == near else near, os.read(a, 256))

    cable = threading.Thread(target=carry)
    cable.start()
    try:
        with (
            ModbusDevice([0, 4515], serial=os.ttyname(far)),
            Watched(
                f'modbus:{os.ttyname(farther)}', device=3, register=1, scale=0.1, rate=10.0
            ) as w,
        ):
            until(lambda: w.last == Reading(451.5))
    finally:
        cut.set()
        cable.join()
        for pair in ends:
            for end in pair:
                os.close(end)


def test_a_register_that_the_device_does_not_have_is_unknown():
    with ModbusDevice([3000]) as device:
        source = f'modbus:127.0.0.1:{device.port}'
        with Watched(source, device=3, register=500, rate=20.0, timeout=0.3) as w:
            until(lambda: w.last is not None)
            assert math.isnan(w.last.celsius) and 'Modbus' in w.last.problem


# ---- the node, over DDS


class Graph:
    """The node as a process and a reader of its topic in a domain of their own."""

    def __init__(self, **params: object) -> None:
        self.domain = fresh_domain()
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=self.domain)
        self.node = rclpy.create_node('pyrometer_test', context=self.context)
        self.got: list[Temperature] = []
        self.node.create_subscription(Temperature, 'temperature', self.got.append, qos.BEAT)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        args = [w for name, value in params.items() for w in ('-p', f'{name}:={value}')]
        env = {**os.environ, 'ROS_DOMAIN_ID': str(self.domain)}
        self.process = subprocess.Popen([*NODE, '--ros-args', *args], env=env)

    def until(self, condition, act=lambda: None, timeout: float = 30.0) -> None:
        end = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < end and self.process.poll() is None
            act()
            self.executor.spin_once(timeout_sec=0.05)

    def close(self) -> None:
        self.process.terminate()
        code = self.process.wait(10)
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()
        assert code == 0


@pytest.fixture
def graph():
    made: list[Graph] = []

    def make(**params: object) -> Graph:
        made.append(Graph(**params))
        return made[-1]

    yield make
    for g in made:
        g.close()


def now_ns(g: Graph) -> int:
    return g.node.get_clock().now().nanoseconds


def test_the_node_publishes_as_the_simulated_cell_does_and_silence_is_unknown(graph, terminal):
    near, name = terminal
    g = graph(source=f'serial:{name}', timeout=0.5)
    g.until(
        lambda: any(m.temperature == 312.4 for m in g.got), lambda: os.write(near, b'312.4\r\n')
    )
    msg = next(m for m in g.got if m.temperature == 312.4)
    assert (msg.header.frame_id, msg.variance) == ('work', 0.0)
    assert abs(now_ns(g) - msg.header.stamp.sec * 10**9 - msg.header.stamp.nanosec) < 10e9
    g.got.clear()
    g.until(lambda: g.got and math.isnan(g.got[-1].temperature))
    g.got.clear()
    g.until(lambda: any(m.temperature == 30.0 for m in g.got), lambda: os.write(near, b'30.0\r\n'))


@pytest.mark.parametrize(
    ('reliability', 'durability'),
    [
        (ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        (ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL),
    ],
)
def test_a_topic_is_relayed_whatever_its_quality_of_service(graph, reliability, durability):
    g = graph(source='topic:/ir/spot', timeout=0.5)
    profile = QoSProfile(depth=1, reliability=reliability, durability=durability)
    driver = g.node.create_publisher(Float32, '/ir/spot', profile)
    g.until(
        lambda: any(m.temperature == 412.5 for m in g.got),
        lambda: driver.publish(Float32(data=412.5)),
    )
    g.got.clear()
    g.until(lambda: g.got and math.isnan(g.got[-1].temperature))


def test_a_driver_that_comes_back_with_another_quality_is_heard_again(graph):
    g = graph(source='topic:/ir/spot', timeout=0.5, unit='K')
    for kind, value, profile in (
        (Float64, 573.15, QoSProfile(depth=1)),
        (Float64, 673.15, QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)),
    ):
        driver = g.node.create_publisher(kind, '/ir/spot', profile)
        told = kind(data=value)
        g.until(
            lambda v=value: any(abs(m.temperature - v + 273.15) < 1e-6 for m in g.got),
            lambda d=driver, t=told: d.publish(t),
        )
        g.node.destroy_publisher(driver)


def test_an_old_stamp_and_a_text_are_no_temperature(graph):
    g = graph(source='topic:/ir/spot', timeout=0.5)
    driver = g.node.create_publisher(Temperature, '/ir/spot', 10)

    def tell(age: float) -> None:
        stamp = now_ns(g) - round(age * 1e9)
        msg = Temperature(temperature=300.0)
        msg.header.stamp.sec, msg.header.stamp.nanosec = divmod(stamp, 10**9)
        driver.publish(msg)

    g.until(lambda: any(m.temperature == 300.0 for m in g.got), lambda: tell(0.0))
    g.until(lambda: math.isnan(g.got[-1].temperature), lambda: tell(5.0))
    g.node.destroy_publisher(driver)
    text = g.node.create_publisher(String, '/ir/spot', 10)
    g.got.clear()
    end = time.monotonic() + 2.0
    g.until(lambda: time.monotonic() > end, lambda: text.publish(String(data='300')))
    assert g.got and all(math.isnan(m.temperature) for m in g.got)


def test_with_a_source_that_is_none_the_node_does_not_start():
    env = {**os.environ, 'ROS_DOMAIN_ID': str(fresh_domain())}
    command = [*NODE, '--ros-args', '-p', 'source:=i2c:1']
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and 'is no pyrometer' in done.stderr
