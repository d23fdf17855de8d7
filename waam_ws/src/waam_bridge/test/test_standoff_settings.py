"""Settings of the standoff control on their way into the controller, and what is published of it."""

from __future__ import annotations

import math

import pytest
from bridge_cell import Able, Cell
from bridge_fake_controller import RUN, FakeCore

from waam_bridge import commands, conversions, frames, requests
from waam_bridge.outbox import FAULT
from waam_bridge.params import BridgeParams
from waam_bridge.standoff import settings
from waam_node.params import ParameterError, from_dict


def sent(cell: Cell) -> list[str]:
    return [line for line in cell.fake.seen if line.startswith('$C')]


def test_switched_off_nothing_is_sent():
    cell = Cell(Able('STANDOFF')).ready()
    cell.step(50)
    assert sent(cell) == []
    assert cell.command(commands.ARM, 'j')[0] == requests.OK


def test_all_settings_go_in_between_off_and_the_source():
    cell = Cell(
        Able('STANDOFF'),
        standoff_source='laser',
        standoff_up=0.003,
        standoff_kp=4.0,
        standoff_cross=0.0,
    ).ready()
    cell.until(lambda: cell.bridge.standoff.settled)
    taken = cell.fake.taken
    assert taken[0] == ('source', 0.0) and taken[-1] == ('source', 1.0)
    values = dict(taken)
    assert (
        values['up_mm'] == 3.0
        and values['kp'] == 4.0
        and values['cross_mm'] == 0.0
        and values['set_mm'] == 100.0
    )
    assert values['law'] == 1.0
    assert cell.command(commands.ARM, 'j')[0] == requests.OK


@pytest.mark.parametrize(
    ('source', 'set_mm', 'number', 'answer'),
    [('infrared', 100.0, 2, 1.0), ('arc', 15.0, 3, 3.0)],
)
def test_what_is_left_open_fits_the_source(source, set_mm, number, answer):
    values = dict(settings(BridgeParams(standoff_source=source, standoff_arc_wander=1.6e-3)))
    assert values['answer_mm'] == answer and values['arc_wander_mm'] == pytest.approx(1.6)
    assert values['set_mm'] == set_mm and values['source'] == number
    assert not any(math.isnan(v) for v in values.values())


def test_no_job_before_the_settings_are_in():
    fake = Able('STANDOFF')
    fake.mute.add('C')
    cell = Cell(fake, standoff_source='laser').ready()
    code, text = cell.command(commands.ARM, 'j')
    assert code == requests.WRONG_STATE and 'standoff' in text
    fake.mute.clear()
    cell.until(lambda: cell.bridge.standoff.settled)
    assert cell.command(commands.ARM, 'j')[0] == requests.OK


def test_a_controller_that_runs_gets_them_when_it_stands():
    fake = Able('STANDOFF')
    fake.go(RUN)
    fake.stuck = True
    cell = Cell(fake, standoff_source='arc').ready()
    cell.step(30)
    assert sent(cell) == []
    fake.stuck = False  # nothing is left: IDLE
    cell.until(lambda: cell.bridge.standoff.settled)
    assert fake.taken[-1] == ('source', 3.0)


def test_a_refused_setting_is_told_and_no_job_is_armed():
    fake = Able('STANDOFF')
    fake.refuse['C'] = 'E104 kp must lie within 0 .. 50'
    cell = Cell(fake, standoff_source='laser').ready()
    cell.until(lambda: cell.bridge.standoff.problem.startswith('setting'))
    told = [n for n in cell.notices if n.class_name == 'height']
    assert [n.severity for n in told] == [FAULT] and 'E104' in told[0].text
    assert cell.command(commands.ARM, 'j')[0] == requests.WRONG_STATE


def test_a_controller_without_it_is_told_so():
    cell = Cell(FakeCore(), standoff_source='laser').ready()
    code, text = cell.command(commands.ARM, 'j')
    assert code == requests.WRONG_STATE and 'no standoff control' in text


def test_a_controller_that_was_left_switched_on_is_switched_off():
    cell = Cell(Able('STANDOFF')).ready()
    cell.fake.say(f'D {cell.fake.t_us},1,1,0,100000,100000,0')
    cell.until(lambda: cell.fake.taken)
    assert cell.fake.taken == [('source', 0.0)]


def test_a_bridge_that_meets_the_same_boot_again_sends_nothing_twice():
    cell = Cell(Able('STANDOFF'), standoff_source='laser').ready()
    cell.until(lambda: cell.bridge.standoff.settled)
    before = len(cell.fake.taken)
    cell.unplug()
    cell.plug()
    cell.ready()
    cell.step(50)
    assert len(cell.fake.taken) == before
    cell.unplug()
    cell.fake.boot += 1
    cell.plug()
    cell.ready()
    cell.until(lambda: len(cell.fake.taken) == 2 * before)


def test_parameters_are_refused_by_name():
    with pytest.raises(ParameterError, match='standoff_source'):
        from_dict(BridgeParams, {'standoff_source': 'sonar'})
    with pytest.raises(ParameterError, match='standoff_up'):
        from_dict(BridgeParams, {'standoff_up': 0.1})


FOUND = frames.Standoff(1_000_000, 1, 1, 0, 100_000, 99_250, -750)


def test_what_is_published_is_si_and_unknown_is_nan():
    msg = conversions.standoff(FOUND, 5_000_000_000)
    assert (msg.header.stamp.sec, msg.source, msg.known, msg.alarm) == (5, 1, True, 0)
    assert msg.set_distance == pytest.approx(0.1)
    assert msg.measured_distance == pytest.approx(0.09925)
    assert msg.correction == pytest.approx(-0.75e-3)
    lost = conversions.standoff(FOUND._replace(known=0, alarm=1), 0)
    assert math.isnan(lost.measured_distance) and lost.alarm == lost.ALARM_NO_READING


def test_the_range_is_that_of_a_sensor_only():
    seen = conversions.distance(FOUND, 0)
    assert seen.range == pytest.approx(0.09925) and seen.min_range < seen.range < seen.max_range
    assert math.isnan(conversions.distance(FOUND._replace(known=0), 0).range)
    assert conversions.distance(FOUND._replace(source=3), 0) is None


def test_lines_come_out_twenty_times_a_second_and_alarms_at_once():
    cell = Cell(Able('STANDOFF'), standoff_source='laser').ready()
    out = []
    collect = cell.bridge.take_outbox
    cell.bridge.take_outbox = lambda: (box := collect(), out.extend(box.standoff))[0]
    for i in range(15):
        alarm = int(i >= 7)
        cell.fake.say(f'D {cell.fake.t_us},1,1,{alarm},100000,{99_000 + i},0')
        cell.step()
    assert [f.measured_um - 99_000 for f in out] == [
        0,
        5,
        7,
        12,
    ]  # every 50 ms, and the alarm at once


def changed(cell: Cell, **params) -> None:
    cell.bridge.standoff.change(BridgeParams(**params), cell.bridge)


def test_settings_are_changed_while_the_machine_stands():
    cell = Cell(Able('STANDOFF'), standoff_source='laser').ready()
    cell.until(lambda: cell.bridge.standoff.settled)
    cell.fake.taken.clear()
    changed(cell, standoff_source='arc', standoff_set=0.014)
    assert cell.command(commands.ARM, 'j')[0] == requests.WRONG_STATE, 'not before they are in'
    cell.until(lambda: cell.bridge.standoff.settled)
    taken = cell.fake.taken
    assert taken[0] == ('source', 0.0) and taken[-1] == ('source', 3.0)
    assert dict(taken)['set_mm'] == 14.0 and dict(taken)['lead_mm'] == 0.0
    cell.fake.taken.clear()
    changed(cell)
    cell.until(lambda: cell.fake.taken)
    assert cell.fake.taken == [('source', 0.0)] and cell.bridge.standoff.problem == ''


def test_an_answer_to_settings_that_were_replaced_does_not_count_for_the_new_ones():
    cell = Cell(Able('STANDOFF'), standoff_source='laser').ready()
    cell.step(1)
    while cell.bridge.standoff.settled:
        cell.step(1)
    changed(cell, standoff_source='arc')  # the first answer may still be under way
    cell.until(lambda: cell.bridge.standoff.settled)
    names = [name for name, _ in settings(BridgeParams(standoff_source='arc'))]
    assert [name for name, _ in cell.fake.taken[-len(names) :]] == names


def test_no_settings_are_changed_while_a_job_is_armed_or_the_controller_has_none():
    cell = Cell(Able('STANDOFF')).ready()
    assert cell.command(commands.ARM, 'j')[0] == requests.OK
    with pytest.raises(ValueError, match="job 'j' is armed"):
        changed(cell, standoff_source='laser')
    assert cell.command(commands.DISARM)[0] == requests.OK
    changed(cell, standoff_source='laser')
    plain = Cell(FakeCore()).ready()
    with pytest.raises(ValueError, match='has none'):
        changed(plain, standoff_source='laser')
    changed(plain)
    plain.step(20)
    assert sent(plain) == [] and plain.command(commands.ARM, 'j')[0] == requests.OK
