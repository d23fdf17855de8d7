"""A sweep that something refuses: the machine stops and the shaper of the axis is in force again. No graph."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from geometry_msgs.msg import Point

from waam_bringup import shaking
from waam_bringup.client import ClientError
from waam_bringup.shaking import Shaking
from waam_calibrate.sweep import Sweep
from waam_msgs.msg import AccelerationBatch, Telemetry
from waam_msgs.srv import Command

ZVD = 2.0
SETTINGS = {
    'shape_x': ZVD, 'shape_y': ZVD, 'max_accel_x': 300.0, 'max_accel_y': 200.0,
    'accel_limit_x': 500.0, 'accel_limit_y': 500.0,
}  # fmt: skip
SWEEP = Sweep(low=20.0, high=30.0, rate=5.0)


class Machine(Shaking):
    """The client with a controller of its own. `refuses`: the step that does not work, and with what."""

    def __init__(self, refuses: str = '', why: type[BaseException] = ClientError) -> None:
        self.settings = dict(SETTINGS)
        self.during: dict[str, float] = {}
        self.telemetry, self.blocks, self.done = Telemetry(), [], -1
        self.commands: list[int] = []
        self.machine = SimpleNamespace(
            state=Telemetry.STATE_IDLE,
            message='',
            fault=0,
            fault_text='',
            homed=True,
            connected=True,
        )
        self.machine.work_offset = Point(x=1e-6)
        self.refuses, self.why = refuses, why
        self.ticks = None  # who hears the clock of the cell
        self.node = SimpleNamespace(
            get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=1)),
            create_subscription=self._hear,
            destroy_subscription=lambda heard: setattr(self, 'ticks', None),
        )

    def _hear(self, kind, topic, ticks, profile):
        assert topic == '/clock'
        self.ticks = ticks

    def __exit__(self, *_: object) -> None:
        pass

    def running_job(self):
        return None

    def until(self, condition, timeout):
        for _ in range(10):
            self._sample()
            if condition():
                return True
        return False

    def _sample(self) -> None:
        values = [0.0] * 1000
        batch = AccelerationBatch(x=values, y=values, z=values, sample_rate=1000.0, range=160.0)
        batch.sequence = len(self.blocks)
        self.blocks.append(batch)

    def _perhaps(self, step: str) -> None:
        if step == self.refuses:
            raise self.why(step)

    def told(self):
        return dict(self.settings)

    def command(self, code, text='', value=0.0):
        self.commands.append(code)
        if code == Command.Request.RESET:
            self.machine.state, self.machine.homed = Telemetry.STATE_IDLE, False
        elif code == Command.Request.HOME:
            self.machine.homed = True
        elif code == Command.Request.STOP:
            self.machine.state = Telemetry.STATE_IDLE
        elif code == Command.Request.CONFIGURE:
            if not self.takes_settings():
                raise ClientError('settings only in IDLE or ALARM')
            self.settings[text] = value
        return ''

    def enqueue(self, segments, job):
        sweeping = segments[0].index > 0
        if sweeping:
            self.begun = segments[0].start
        self._perhaps('sweep' if sweeping else 'approach')
        self.during = dict(self.settings)
        if sweeping:
            self.machine.state = Telemetry.STATE_RUN

    def wait_done(self, index, progress=None):
        self._perhaps('moves' if self.machine.state == Telemetry.STATE_RUN else 'way')
        self.machine.state = Telemetry.STATE_IDLE

    def listen(self, on):
        self._perhaps('listen' if on else 'deaf')


@pytest.fixture
def sweep(monkeypatch):
    def run(machine: Machine, simulated: bool = False):
        monkeypatch.setattr(shaking, 'Shaking', lambda domain: machine)
        return shaking.shake(1, SWEEP, 'x', (0.1, 0.1, 0.05), simulated)

    return run


def test_a_sweep_runs_unshaped_and_with_the_acceleration_of_the_machine(sweep):
    machine = Machine()
    assert len(sweep(machine).values) > 0
    assert machine.begun[0] + 1e-6 == pytest.approx(0.1, abs=1e-9), 'on a step of the machine'
    assert machine.during == SETTINGS | {'shape_x': 0.0, 'max_accel_x': 500.0}
    assert machine.settings == SETTINGS


def test_older_firmware_has_no_acceleration_to_set(sweep):
    machine = Machine()
    machine.settings = {'shape_x': ZVD, 'shape_y': ZVD}
    sweep(machine)
    assert machine.during == {'shape_x': 0.0, 'shape_y': ZVD}
    assert machine.settings == {'shape_x': ZVD, 'shape_y': ZVD}


@pytest.mark.parametrize('step', ['approach', 'way', 'listen', 'sweep', 'moves', 'deaf'])
@pytest.mark.parametrize('why', [ClientError, KeyboardInterrupt])
def test_shaper_and_acceleration_are_back_after_a_sweep_that_was_refused(sweep, step, why):
    machine = Machine(step, why)
    with pytest.raises(why):
        sweep(machine)
    assert machine.settings == SETTINGS
    assert machine.machine.state == Telemetry.STATE_IDLE


@pytest.mark.parametrize('compiles', [7, 99])
def test_a_simulated_cell_that_still_compiles_is_waited_for(sweep, compiles):
    """Without it no accelerometer answers; nothing moves before."""
    machine = Machine()
    sample = machine._sample

    def later() -> None:
        sample()
        if machine.ticks is not None and len(machine.blocks) >= compiles:
            machine.ticks('tick')

    machine._sample = later
    if compiles < 10:
        sweep(machine, simulated=True)
        assert len(machine.blocks) >= compiles and machine.ticks is None
        return
    with pytest.raises(ClientError, match='has not met the controller'):
        sweep(machine, simulated=True)
    assert machine.during == {} and machine.ticks is None


def test_a_controller_that_was_just_switched_on_is_reset_and_homed(sweep):
    machine = Machine()
    machine.machine.state, machine.machine.fault = Telemetry.STATE_ALARM, 306
    sweep(machine)
    assert machine.commands[:2] == [Command.Request.RESET, Command.Request.HOME]


@pytest.mark.parametrize('fault', [300, 301, 307, 308])
def test_any_other_alarm_is_left_to_a_person(sweep, fault):
    machine = Machine()
    machine.machine.state, machine.machine.fault = Telemetry.STATE_ALARM, fault
    machine.machine.fault_text = 'as told'
    with pytest.raises(ClientError, match='ALARM: as told; see to it'):
        sweep(machine)
    assert machine.commands == []
