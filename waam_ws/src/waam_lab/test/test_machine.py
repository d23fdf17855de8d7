"""Controller, cell and bridge in lock-step."""

from __future__ import annotations

import numpy as np
import pytest

from waam_bridge import commands
from waam_bridge.embedded import Controller
from waam_bridge.frames import ALARM, HOMED, IDLE
from waam_bridge.params import BridgeParams
from waam_lab.machine import EPOCH_US, Machine
from waam_process.plant_port import SAMPLE
from waam_sim import part
from waam_sim.plant import Plant


@pytest.fixture
def machine():
    made = Machine(BridgeParams(), Plant(part.plate(0.04, 0.03, 0.01, 4e-4, 5e-3), seed=1))
    yield made
    made.close()


def test_a_controller_begins_as_a_board_does(machine):
    machine.connect()
    assert machine.bridge.connected
    assert machine.bridge.state == ALARM
    assert machine.bridge.fault == 306
    code, text = machine.command(commands.Command(commands.RESET))
    assert (code, machine.bridge.state) == (0, IDLE), text


def test_time_goes_in_exchanges_and_its_zero_never_moves(machine):
    machine.connect()
    before = machine.time_us
    machine.advance(0.123)
    assert machine.time_us - before == 130_000
    assert before > EPOCH_US == 1_750_000_000_000_000
    assert abs(machine.bridge.link.telemetry.t_us - machine.time_us) <= 20_000


def test_homing_and_refusals_are_answered(machine):
    machine.connect()
    code, text = machine.command(commands.Command(commands.HOME))
    assert code != 0 and 'ALARM' in text
    machine.command(commands.Command(commands.RESET))
    assert machine.command(commands.Command(commands.HOME))[0] == 0
    assert machine.until(lambda: bool(machine.bridge.flags & HOMED), 60.0)
    x, y, z = machine.bridge.position
    assert abs(x) < 0.02 and abs(y) < 0.02 and z > 0.15


def test_temperature_comes_at_its_rate(machine):
    machine.connect()
    times: list[int] = []
    machine.on_temperature = lambda time_us, celsius: times.append(time_us)
    machine.advance(2.0)
    assert set(np.diff(times)) == {100_000}


def test_samples_must_fit():
    controller = Controller(EPOCH_US)
    with pytest.raises(ValueError, match='SAMPLE'):
        controller.step(np.zeros(10))
    with pytest.raises(ValueError, match='contiguous'):
        controller.step(np.zeros(20, SAMPLE)[::2])
    samples = np.zeros(10, SAMPLE)
    controller.step(samples)
    assert (samples['outputs'] == 0).all()
    assert np.allclose(samples['tool_z'], 0.150)  # where host/options.c puts the axes
    controller.close()
    controller.close()
