"""The part's temperature: settings on their way into the controller, lines of it, and what is published."""

from __future__ import annotations

import math

import pytest
from bridge_cell import Able, Cell
from bridge_fake_controller import sealed
from hypothesis import given
from hypothesis import strategies as st

from waam_bridge import commands, frames, parsing, requests
from waam_bridge.outbox import FAULT, INFO, WARNING
from waam_bridge.params import BridgeParams
from waam_node.conversions import temperature_to_msg
from waam_node.params import ParameterError, from_dict


def told(cell: Cell, *readings: str) -> list[frames.PartTemperature]:
    """What the bridge publishes when the controller says this."""
    got: list[frames.PartTemperature] = []
    for i, reading in enumerate(readings):
        cell.bridge.line(sealed(f'P {10**6 + i},{reading}')[:-1], cell.now)
        got += cell.bridge.outbox.temperatures
        cell.collect()
    return got


def test_the_settings_go_in_between_off_and_the_input():
    cell = Cell(
        Able('TEMPERATURE'),
        temperature_input='4-20mA',
        temperature_low=-50.0,
        temperature_high=450.0,
    ).ready()
    cell.until(lambda: cell.bridge.temperature.settled)
    assert cell.fake.taken == [
        ('temperature_input', 0), ('temperature_low_c', -50), ('temperature_high_c', 450), ('temperature_input', 2),
    ]  # fmt: skip
    assert cell.bridge.temperature.problem == ''
    cell.unplug()
    cell.fake.boot += 1
    cell.fake.taken.clear()
    cell.plug()
    cell.until(lambda: len(cell.fake.taken) == 4)


def test_a_reading_becomes_a_message_and_an_unknown_one_nan():
    cell = Cell(Able('TEMPERATURE'), temperature_input='0-10V').ready()
    known, torn = told(cell, '0,312400', '1,')
    assert known == frames.PartTemperature(10**6, 0, 312.4)
    msg = temperature_to_msg(known.celsius, 5_000_000_001)
    assert (msg.temperature, msg.variance, msg.header.frame_id) == (312.4, 0.0, 'work')
    assert (msg.header.stamp.sec, msg.header.stamp.nanosec) == (5, 1)
    assert math.isnan(temperature_to_msg(torn.celsius, 1).temperature)


def test_what_is_unknown_is_named_once_and_so_is_its_return():
    cell = Cell(Able('TEMPERATURE'), temperature_input='4-20mA').ready()
    cell.until(lambda: cell.bridge.temperature.settled)
    cell.notices.clear()
    told(cell, '0,20000', '1,', '1,', '2,', '0,21000', '0,22000')
    texts = [(n.severity, n.class_name, n.text) for n in cell.notices]
    assert [t[0] for t in texts] == [WARNING, WARNING, INFO]
    assert all(t[1] == 'temperature' and '4-20mA at the controller' in t[2] for t in texts)
    assert 'broken wire' in texts[0][2] and 'open thermocouple' in texts[1][2]
    said = cell.bridge.temperature.says
    assert said == '4-20mA: 22.0 degC'
    told(cell, '3,')
    assert cell.bridge.temperature.says == '4-20mA: the converter gives no reading'


def test_a_controller_without_the_input_is_named_and_asked_nothing():
    """The simulated cell has a pyrometer of its own: its controller has no such input, so there are never two."""
    cell = Cell(Able(), temperature_input='0-10V').ready()
    cell.step(30)
    assert cell.fake.taken == []
    assert "no input for the part's temperature" in cell.bridge.temperature.problem
    assert any(n.severity == FAULT and n.class_name == 'temperature' for n in cell.notices)
    assert cell.command(commands.ARM, 'j')[0] == requests.OK  # another node may publish it


def test_by_default_nothing_is_sent_and_a_controller_left_on_is_switched_off():
    cell = Cell(Able('TEMPERATURE')).ready()
    cell.step(30)
    assert cell.fake.taken == []
    assert told(cell, '0,20000', '0,20000') == []
    cell.until(lambda: cell.fake.taken == [('temperature_input', 0)])
    assert cell.bridge.temperature.says == ''


def test_configure_leaves_them_to_the_parameters():
    cell = Cell(Able('TEMPERATURE'), temperature_input='0-10V').ready()
    code, text = cell.command(commands.CONFIGURE, 'temperature_low_c', value=100.0)
    assert code == requests.BAD_ARGUMENT and 'temperature_*' in text


@given(
    st.integers(0, 10**15), st.integers(-5, 9), st.one_of(st.none(), st.integers(-(10**9), 10**9))
)
def test_a_line_is_a_number_or_unknown_and_never_both(t_us, fault, milli):
    line = sealed(f'P {t_us},{fault},{"" if milli is None else milli}')[:-1]
    good = 0 <= fault <= 3 and (fault == 0) == (milli is not None) and abs(milli or 0) < 10**7
    if not good:
        with pytest.raises(frames.FrameError):
            parsing.parse(line)
        return
    got = parsing.parse(line)
    assert (got.t_us, got.fault) == (t_us, fault)
    assert math.isnan(got.celsius) if milli is None else got.celsius == milli / 1e3


@pytest.mark.parametrize(
    'values',
    [{'temperature_input': '0-5V'}, {'temperature_low': 500.0, 'temperature_high': 500.0}],
)
def test_a_parameter_that_makes_no_sense_is_refused_by_name(values):
    with pytest.raises(ParameterError, match='temperature_'):
        from_dict(BridgeParams, values)
