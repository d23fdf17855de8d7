"""The gantry of the parameters: told to the controller, read back, compared; what the machine says of its reach."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from bridge_cell import Cell
from bridge_fake_controller import IDLE, FakeCore
from hypothesis import given
from hypothesis import strategies as st

from waam_bridge import commands, conversions, requests
from waam_bridge.gantry import MAX_STEP_RATE, NAMES, differing, wanted
from waam_bridge.outbox import FAULT
from waam_bridge.params import BridgeParams
from waam_node.params import ParameterError, from_dict

LARGE = {
    'envelope_x': 3.0, 'envelope_y': 3.0, 'envelope_z': 2.0, 'max_speed_x': 0.5, 'max_speed_y': 0.5, 'rapid_speed': 0.5,
    'home_direction_y': 1, 'steps_per_mm_x': 150.0, 'steps_per_mm_y': 150.0,
}  # fmt: skip
PULSES = float(MAX_STEP_RATE)


class Large(FakeCore):
    """A controller as in docs/link_protocol.md. `deaf`: settings that it confirms and does not keep."""

    def __init__(self, *deaf: str) -> None:
        super().__init__()
        self.deaf = deaf
        self.has = dict.fromkeys(NAMES, 320.0) | {
            'envelope_x': 400.0, 'envelope_y': 300.0, 'envelope_z': 200.0, 'max_speed_x': 200.0, 'max_speed_y': 200.0,
            'max_speed_z': 100.0, 'rapid_speed': 50.0, 'max_accel_z': 300.0, 'home_direction_x': -1.0,
            'home_direction_y': -1.0, 'accel_limit_x': 500.0, 'accel_limit_y': 500.0, 'home_seek_speed': 40.0,
            'home_latch_speed': 2.0,
        }  # fmt: skip
        self.taken: list[str] = []

    def _do(self, letter: str, args: list[str]) -> str:
        if letter != 'C':
            return super()._do(letter, args)
        assert self.state == IDLE and not self.queue
        if not args:
            return ' '.join(f'{n}={v:g}' for n, v in self.has.items())
        self.taken.append(args[0])
        new = self.has | ({args[0]: float(args[1])} if args[0] not in self.deaf else {})
        if any(new[f'max_speed_{a}'] * new[f'steps_per_mm_{a}'] > PULSES for a in 'xyz'):
            return f'error E105 {args[0]}: too many pulses'
        self.has = new
        return 'ok'


def met(fake: FakeCore, **params) -> Cell:
    cell = Cell(fake, **params).ready()
    cell.until(lambda: cell.bridge.gantry.settled)
    return cell


def test_only_what_differs_is_sent_and_the_reach_becomes_known():
    cell = met(Large(), **LARGE, max_speed_z=0.1)
    assert cell.bridge.gantry.problem == ''
    assert set(cell.fake.taken) == set(LARGE)
    assert cell.fake.has['envelope_x'] == 3000 and cell.fake.has['max_speed_x'] == 500
    told = conversions.machine_state(cell.bridge, 'p')
    low, high = told.limit_min, told.limit_max
    assert (high.x, high.y, high.z) == (3.0, 3.0, 2.0) and (low.x, low.y, low.z) == (0, 0, 0)
    assert cell.command(commands.ARM, 'j')[0] == requests.OK


def test_a_controller_that_restarted_is_told_anew_and_one_that_did_not_keeps_homing():
    cell = met(Large(), **LARGE)
    cell.unplug()
    cell.plug()
    cell.until(lambda: cell.bridge.connected)
    cell.fake.taken.clear()
    cell.step(30)
    assert cell.fake.taken == []
    cell.unplug()
    cell.fake.boot += 1
    cell.fake.has = Large().has
    cell.plug()
    cell.until(lambda: set(cell.fake.taken) == set(LARGE))


def test_nothing_homes_and_no_job_is_armed_before_both_agree():
    cell = Cell(Large(), **LARGE)
    cell.until(lambda: cell.bridge.connected)
    for code, text in ((commands.HOME, ''), (commands.ARM, 'j')):
        got = cell.send(code, text)
        assert (
            got[0][0] == requests.WRONG_STATE
            and 'gantry are not in the controller yet' in got[0][1]
        )


@pytest.mark.parametrize(
    ('fake', 'params', 'why'),
    [
        (Large('envelope_y'), LARGE, 'the controller has envelope_y 300, the parameters say 3000'),
        (
            Large(),
            {'max_speed_x': 0.5},
            'setting max_speed_x of the gantry: controller: E105 max_speed_x',
        ),
        (FakeCore(), LARGE, "the controller does not tell the gantry's settings"),
    ],
)
def test_a_difference_is_named_and_refuses_to_arm(fake, params, why):
    cell = met(fake, **params)
    assert why in cell.bridge.gantry.problem
    assert any(n.severity == FAULT and why in n.text for n in cell.notices)
    code, text = cell.command(commands.ARM, 'j')
    assert code == requests.WRONG_STATE and why in text


def test_without_parameters_nothing_is_asked():
    cell = Cell(Large()).ready()
    cell.step(30)
    assert not any(line.startswith('$C') for line in cell.fake.seen)
    assert cell.command(commands.ARM, 'j')[0] == requests.OK


def test_calibrated_steps_stay():
    fake = Large()
    fake.has['steps_per_mm_x'] = 151.2
    met(fake, **LARGE)
    assert 'steps_per_mm_x' not in fake.taken and fake.has['max_speed_x'] == 500


def test_configure_leaves_them_to_the_parameters_but_not_the_steps():
    cell = met(Large(), **LARGE)
    code, text = cell.command(commands.CONFIGURE, 'envelope_x', value=100.0)
    assert code == requests.BAD_ARGUMENT and 'parameter' in text
    assert cell.command(commands.CONFIGURE, 'steps_per_mm_x', value=149.5)[0] == requests.OK


steps = st.floats(10, 2000)
speed = st.floats(10, 500)


@given(steps, speed, steps, speed)
def test_no_order_of_steps_and_speed_is_refused_on_the_way(has_steps, has_speed, steps, speed):
    if has_steps * has_speed > PULSES or steps * speed > PULSES:
        return
    has = {'steps_per_mm_x': has_steps, 'max_speed_x': has_speed}
    for name, value in differing({'max_speed_x': speed, 'steps_per_mm_x': steps}, has):
        has[name] = value
        assert has['steps_per_mm_x'] * has['max_speed_x'] <= PULSES * 1.06


def test_units_are_those_of_the_controller():
    got = wanted(
        from_dict(BridgeParams, {'envelope_z': 2.0, 'max_accel_z': 0.1, 'home_direction_x': -1})
    )
    assert got == {'envelope_z': 2000.0, 'max_accel_z': 100.0, 'home_direction_x': -1.0}


@pytest.mark.parametrize(
    'values', [{'envelope_x': 4.0}, {'max_speed_y': 0.6}, {'home_direction_x': 2}]
)
def test_a_parameter_that_no_gantry_has_is_refused_by_name(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        from_dict(BridgeParams, values)


def test_accelerations_and_speeds_of_homing_are_told_in_mm():
    told = wanted(
        from_dict(
            BridgeParams, {'accel_limit_x': 2.0, 'home_seek_speed': 0.08, 'home_direction_y': 1}
        )
    )
    assert told == {'accel_limit_x': 2000.0, 'home_seek_speed': 80.0, 'home_direction_y': 1.0}


def test_older_firmware_is_refused_only_for_what_it_does_not_have():
    older = Large()
    older.has = {
        n: v for n, v in older.has.items() if not n.startswith(('accel', 'home_s', 'home_l'))
    }
    assert met(older, **LARGE).bridge.gantry.problem == ''
    cell = met(older, **LARGE, home_seek_speed=0.08)
    assert "does not tell the gantry's settings" in cell.bridge.gantry.problem


def test_the_greatest_step_rate_is_that_of_the_firmware():
    header = Path(__file__).parents[2] / 'waam_firmware/core/machine/waam_scale.h'
    (rate,) = re.findall(r'#define WAAM_STEP_RATE_MOST ([\d.]+)', header.read_text())
    assert float(rate) == MAX_STEP_RATE
