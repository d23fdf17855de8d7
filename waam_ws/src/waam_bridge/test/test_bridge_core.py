"""The whole core against the fake controller in simulated time: no ROS, no port, no threads."""

import math
import re

import pytest
from bridge_cell import Cell, line_of
from bridge_fake_controller import ALARM, HOLD, IDLE, RUN, FakeCore
from hypothesis import given, settings
from hypothesis import strategies as st
from test_stream import Channel

from waam_bridge import batches, commands, outbox, overrides, program, requests
from waam_bridge.faults import held
from waam_process.segment import Kind, Segment


def test_identification_enables_everything_else():
    cell = Cell()
    assert cell.refused(line_of(1))[0] == program.NOT_CONNECTED
    assert cell.send(commands.HOLD)[0][0] == requests.NOT_CONNECTED
    cell.ready()
    assert cell.fake.seen == ['$I keep', '$L 1']
    assert cell.bridge.offset == (0.0, 0.0, 0.0) and cell.bridge.message == 'ready'


def test_an_alarm_at_power_up_is_known_as_soon_as_the_link_is_ready():
    fake = FakeCore()
    fake.state, fake.fault, fake.homed = ALARM, 306, False
    cell = Cell(fake)
    seen = []

    def connected():
        if cell.bridge.connected:
            seen.append((cell.bridge.state, cell.bridge.fault))
        return seen

    line = cell.bridge.line
    cell.bridge.line = lambda *args: (line(*args), connected())  # after every line, not every step
    cell.until(connected)
    assert seen[0] == (ALARM, 306)


def test_why_the_watchdog_has_reset_the_controller_is_in_the_alarm():
    """A board tells it before its answer to `$I`; the telemetry that follows says the code alone."""
    why = 'undefined instruction: pc 08001234 lr 08005679'

    class Explains(FakeCore):
        def say(self, text: str) -> None:
            if text.startswith('$I'):
                super().say(f'! ALARM E307 {why}')
            super().say(text)

    fake = Explains()
    fake.state, fake.fault, fake.homed = ALARM, 307, False
    cell = Cell(fake).ready()
    cell.until(lambda: cell.bridge.link.newest.seq > 5)
    assert (cell.bridge.state, cell.bridge.fault, cell.bridge.fault_text) == (ALARM, 307, why)
    assert [n.text for n in cell.notices if '307' in n.text] == [f'ALARM E307 {why}']


def test_something_else_is_no_controller():
    fake = FakeCore()
    fake.name = 'OTHER_DEVICE'
    cell = Cell(fake)
    cell.until(lambda: not cell.plugged)
    assert "'OTHER_DEVICE'" in cell.bridge.message and 'WAAM_CONTROLLER_V1' in cell.bridge.message
    fake = FakeCore()
    fake.mute.add('I')
    cell = Cell(fake)
    cell.until(lambda: not cell.plugged)
    assert 'no valid answer to $I within 2 s' in cell.bridge.message


def test_segments_are_executed_once_and_reported():
    cell = Cell().ready()
    batch = cell.enqueue(line_of(30))
    assert batch.accepted == 30
    again = cell.enqueue(line_of(30))
    assert (again.accepted, again.duplicates) == (0, 30)
    cell.until(lambda: cell.done and cell.done[-1] == 29)
    assert cell.done == list(range(30))
    assert cell.fake.gcode == ['G21 G90', 'G1 X1 Y0 Z0 F600'] + [f'G1 X{i}' for i in range(2, 31)]
    assert cell.refused(line_of(1, first=31, x0=0.03))[0] == program.GAP
    assert cell.enqueue(line_of(2, first=30, x0=0.03)).accepted == 2


def test_a_new_job_starts_where_the_machine_is():
    cell = Cell().ready()
    cell.enqueue(line_of(5))
    code, text = cell.refused(line_of(2, x0=0.005), job='k')
    assert code == program.WRONG_STATE and 'still has 5 segments' in text
    cell.until(lambda: len(cell.done) == 5)
    cell.step(3)
    assert cell.refused(line_of(2, x0=0.1), job='k')[0] == program.BAD_SEGMENT
    assert cell.enqueue(line_of(2, first=7, x0=0.005), job='k').accepted == 2


def test_arc_needs_arm_and_the_lease_follows_the_slowest_node():
    cell = Cell().ready()
    assert cell.refused(line_of(2, arc=True))[0] == program.NOT_ARMED
    assert cell.bridge.link.telemetry.t_us and cell.fake.beats[-1][1] == 0
    cell.nodes = ['a', 'b']
    assert cell.command(commands.ARM, 'j', ('a', 'b')) == (0, '')
    cell.step(30)
    assert cell.fake.beats[-1][1] >= cell.fake.t_us - 120_000
    cell.nodes = ['a']
    cell.step(60)
    assert cell.bridge.silent == ['b']
    assert cell.fake.beats[-1][1] < cell.fake.t_us - 500_000  # withheld
    assert any(n.class_name == 'node' and 'b' in n.text for n in cell.notices)
    cell.nodes = ['a', 'b']
    cell.step(30)
    assert cell.bridge.silent == [] and cell.fake.beats[-1][1] >= cell.fake.t_us - 120_000
    cell.command(commands.DISARM)
    cell.step(10)
    assert cell.fake.beats[-1][1] == 0 and cell.bridge.armed_job == ''


def test_heartbeats_keep_pace_with_the_controllers_clock_and_the_wall():
    cell = Cell().ready()
    start = len(cell.fake.beats)
    cell.step(100)  # 1 s of both
    assert 18 <= len(cell.fake.beats) - start <= 22
    assert len(cell.ticks) >= 9
    start = len(cell.fake.beats)
    for _ in range(50):  # telemetry stalls, the wall does not
        cell.now += 0.02
        cell.fake.feed(cell.bridge.poll(cell.now))
    assert len(cell.fake.beats) - start >= 15


def test_commands_bring_the_controllers_own_words():
    cell = Cell().ready()
    cell.fake.refuse['J'] = 'E108 jog only in IDLE'
    code, text = cell.command(commands.JOG, vector=(0.01, 0.0, 0.0), value=0.02)
    assert code == requests.REFUSED and 'E108 jog only in IDLE' in text
    del cell.fake.refuse['J']
    assert cell.command(commands.JOG, vector=(0.01, 0.0, 0.0), value=0.02)[0] == 0
    assert cell.fake.seen[-1] == '$J 10 0 0 1200'
    assert cell.bridge.position[0] == pytest.approx(0.01)
    cell.fake.mute.add('D')
    assert cell.command(commands.DISARM)[0] == requests.TIMEOUT
    assert (
        cell.send(commands.JOG, vector=(math.nan, 0, 0), value=0.02)[0][0] == requests.BAD_ARGUMENT
    )
    assert cell.send(commands.JOG, vector=(0.01, 0, 0), value=9.0)[0][0] == requests.BAD_ARGUMENT
    assert cell.send(99)[0][0] == requests.BAD_ARGUMENT
    assert cell.send(commands.ARM, 'x*y')[0][0] == requests.BAD_ARGUMENT
    assert cell.send(commands.RESUME)[0][0] == requests.WRONG_STATE


def test_homing_is_a_queued_line():
    fake = FakeCore()
    fake.homed = False
    cell = Cell(fake).ready()
    assert cell.refused(line_of(1)) == (program.WRONG_STATE, 'not homed: HOME first')
    assert cell.command(commands.HOME)[0] == 0
    cell.until(lambda: cell.fake.homed)
    cell.fake.refuse_line = 'G28'
    cell.step(3)
    code, text = cell.command(commands.HOME)
    assert code == requests.REFUSED and 'E103 unknown word' in text
    cell.step(20)
    assert cell.enqueue(line_of(1)).accepted == 1
    cell.until(lambda: cell.done)


def test_the_work_zero_moves_the_limits():
    cell = Cell().ready()
    assert cell.command(commands.SET_ZERO, vector=(0.39, 0.08, 0.02))[0] == 0
    assert cell.bridge.offset == pytest.approx((0.39, 0.08, 0.02))
    start = cell.bridge.position
    assert start == pytest.approx((-0.39, -0.08, -0.02))
    far = Segment(index=0, kind=Kind.IDLE, start=start, end=(0.011, 0.0, 0.0), speed=0.05)
    code, text = cell.refused([far])
    assert code == program.BAD_SEGMENT and '401.000 mm in machine coordinates' in text
    assert cell.enqueue([far.at(end=(0.01, 0.0, 0.0))]).accepted == 1
    cell.until(lambda: cell.done)
    cell.step(3)
    assert cell.command(commands.SET_ZERO, value=1.0)[0] == 0
    assert cell.bridge.offset == pytest.approx((0.4, 0.08, 0.02))
    assert cell.bridge.position == pytest.approx((0, 0, 0))


def test_the_work_zero_of_a_running_controller_is_asked_for_not_guessed():
    fake = FakeCore()
    fake.offset_mm = [100.0, 80.0, 20.0]
    assert Cell(fake).ready().bridge.offset == pytest.approx((0.1, 0.08, 0.02))
    fake.tells_offset = False
    cell = Cell(fake).ready()
    assert cell.bridge.offset is None and 'SET_ZERO first' in cell.refused(line_of(1))[1]
    assert cell.send(commands.SET_ZERO, value=1.0)[0][0] == requests.WRONG_STATE
    assert cell.command(commands.SET_ZERO, vector=(0.1, 0.08, 0.02))[0] == 0
    assert cell.enqueue(line_of(1)).accepted == 1


def test_stop_drops_the_queue_and_the_job_can_go_on():
    cell = Cell().ready()
    cell.enqueue(line_of(50))
    cell.until(lambda: len(cell.done) == 10)
    assert cell.command(commands.STOP)[0] == 0
    count = len(cell.done)
    assert cell.bridge.queued == 0 and 'stopped by host' in cell.bridge.message
    assert f'{50 - count} segments dropped' in cell.bridge.message
    cell.step(20)
    assert len(cell.done) == count == sum('G1' in g for g in cell.fake.gcode)
    again = cell.enqueue(line_of(50)[count - 3 :])  # three of them are known
    assert (again.accepted, again.duplicates) == (50 - count, 3)
    cell.until(lambda: len(cell.done) == 50)
    assert cell.done == list(range(50))


def test_hold_keeps_the_queue_alarm_drops_it():
    cell = Cell().ready()
    cell.enqueue(line_of(60))
    cell.until(lambda: len(cell.done) == 5)
    assert cell.command(commands.HOLD)[0] == 0
    cell.step(30)
    assert (
        cell.bridge.state == HOLD
        and cell.refused(line_of(1, first=60, x0=0.06))[0] == program.WRONG_STATE
    )
    assert cell.command(commands.RESUME)[0] == 0
    cell.until(lambda: len(cell.done) == 30)
    cell.fake.alarm(301, 'limit switch')
    cell.step(5)
    assert cell.bridge.state == ALARM and cell.bridge.queued == 0
    assert 'limit switch' in cell.bridge.fault_text and 'segments dropped' in cell.bridge.message
    alarm = [n for n in cell.notices if n.severity == outbox.ALARM_SEVERITY]
    assert len(alarm) == 1 and alarm[0].reaction == 'abort'
    assert cell.refused(line_of(1, first=60, x0=0.06))[0] == program.WRONG_STATE
    assert cell.command(commands.RESET)[0] == 0
    assert 'not homed' in cell.refused(line_of(1))[1]
    cell.fake.homed = True
    cell.step(5)
    done = len(cell.done)
    assert cell.enqueue(line_of(60)[done:]).accepted == 60 - done
    cell.until(lambda: len(cell.done) == 60)
    assert cell.done == list(range(60))


def test_a_lost_distance_is_a_warning_and_the_job_goes_on():
    cell = Cell().ready()
    cell.enqueue(line_of(60))
    cell.step(5)
    cell.fake.say('! RUN E212 no reading of the distance')
    cell.until(lambda: len(cell.done) == 60)
    told = [(n.class_name, n.severity, n.text) for n in cell.notices if 'distance' in n.text]
    assert told == [('height', outbox.WARNING, 'E212 no reading of the distance')]
    assert cell.bridge.fault == 0


def test_a_fault_has_its_class_and_is_told_once():
    cell = Cell().ready()
    cell.enqueue(line_of(60))
    cell.step(5)
    cell.fake.go(HOLD, 204, 'the arc was lost')
    cell.step(20)
    faults = [(n.class_name, n.severity, n.reaction) for n in cell.notices]
    assert faults == [('arc', outbox.FAULT, 'hold')]
    assert cell.bridge.fault == 204 and cell.bridge.fault_text == 'the arc was lost'


def test_a_hold_by_this_end_tells_its_reason_until_it_is_over():
    cell = Cell().ready()
    cell.enqueue(line_of(60))
    cell.step(5)
    held(cell.bridge, 'the driver is late')
    cell.fake.go(HOLD, 200, 'hold by host')
    cell.step(5)
    assert (cell.bridge.fault, cell.bridge.fault_text) == (200, 'the driver is late')
    cell.fake.go(IDLE, 0, '')
    cell.step(5)
    cell.fake.go(HOLD, 200, 'hold by host')
    cell.step(5)
    assert cell.bridge.fault_text == 'hold by host'


def test_a_refused_line_stops_the_program_but_not_what_was_accepted():
    cell = Cell().ready()
    cell.fake.refuse_line = 'X20'
    cell.enqueue(line_of(40))
    cell.until(lambda: cell.fake.state == IDLE and cell.fake.gcode)
    cell.step(10)
    assert cell.done == list(range(19))
    code, text = cell.refused(line_of(1, first=40, x0=0.04))
    assert code == program.WRONG_STATE and 'E103 unknown word' in text
    cell.fake.refuse_line = ''
    assert cell.command(commands.STOP)[0] == 0
    assert cell.enqueue(line_of(40)[19:]).accepted == 21
    cell.until(lambda: len(cell.done) == 40)
    assert cell.done == list(range(40))


def test_a_cable_pulled_and_put_back_repeats_and_skips_nothing():
    for silence in (3, 40, 200):
        cell = Cell().ready()
        cell.enqueue(line_of(80))
        for _ in range(3):
            cell.step(9)
            cell.unplug()
            assert cell.refused(line_of(1))[0] == program.NOT_CONNECTED
            cell.step(silence)
            cell.plug()
            cell.until(lambda cell=cell: cell.bridge.connected)
        cell.until(lambda cell=cell: len(cell.done) == 80, 2000)
        assert cell.done == list(range(80))
        moves = [g for g in cell.fake.gcode if 'G1' in g]
        assert len(moves) == 80 and len([n for n in cell.notices if n.class_name == 'link']) == 6


def test_another_boot_loses_the_queue_and_says_so():
    cell = Cell().ready()
    cell.command(commands.ARM, 'j', ())
    cell.enqueue(line_of(80))
    cell.step(20)
    cell.unplug()
    cell.fake = FakeCore(boot=8)
    cell.plug()
    cell.ready()
    assert cell.bridge.queued == 0 and cell.bridge.armed_job == ''
    assert any(n.severity == outbox.ALARM_SEVERITY and 'restarted' in n.text for n in cell.notices)
    start = len(cell.done)
    assert cell.enqueue(line_of(3), job='k').accepted == 3
    cell.until(lambda: len(cell.done) == start + 3)


def test_a_new_bridge_disarms_a_controller_that_somebody_armed():
    fake = FakeCore()
    fake.armed = True
    fake.received = fake.executed = 12
    fake.state = RUN
    fake.queue = ['G4 P1'] * 3
    fake.stuck = True
    Cell(fake).ready()
    assert '$D' in fake.seen and '$L 13' in fake.seen and not fake.armed


def test_a_silent_controller_is_given_up():
    cell = Cell().ready()
    for _ in range(310):
        cell.now += 0.01
        cell.fake.feed(cell.bridge.poll(cell.now))
    assert 'silent for 3 s' in cell.bridge.link.failed


def test_overrides_are_checked_and_remembered():
    cell = Cell().ready()
    overrides.operator(cell.bridge, 1.2, math.nan, 'panel', cell.now)
    cell.step(2)
    overrides.operator(cell.bridge, math.nan, 0.9, 'panel', cell.now)
    cell.step(2)
    assert (cell.fake.speed, cell.fake.wire) == (1200, 900)
    overrides.operator(cell.bridge, 3.0, 1.0, 'panel', cell.now)
    cell.step(2)
    assert cell.fake.speed == 1200
    assert 'speed_factor is 3, limits 0.1 .. 2' in cell.notices[-1].text


def test_a_full_queue_takes_nothing_of_a_batch(monkeypatch):
    monkeypatch.setattr(batches, 'QUEUE_SIZE', 20)
    cell = Cell().ready()
    cell.fake.stuck = True
    assert cell.enqueue(line_of(15), last=False).accepted == 15
    code, text = cell.refused(line_of(10, first=15, x0=0.015))
    assert code == program.QUEUE_FULL and '15 segments wait' in text
    assert cell.enqueue(line_of(5, first=15, x0=0.015)).accepted == 5


def test_a_batch_that_a_stop_overtakes_is_refused():
    cell = Cell().ready()
    permit = cell.bridge.permit('j', line_of(5))
    batch = program.prepare(permit, line_of(5), True)
    cell.command(commands.JOG, vector=(0.01, 0.0, 0.0), value=0.02)
    with pytest.raises(program.Refusal):
        cell.bridge.commit(permit, batch)


def test_clear_queue_only_at_rest_and_for_its_job():
    cell = Cell().ready()
    cell.enqueue(line_of(60))
    cell.until(lambda: len(cell.done) == 5)
    assert cell.send(commands.CLEAR_QUEUE, 'other')[0][0] == requests.WRONG_STATE
    assert cell.send(commands.CLEAR_QUEUE, 'j')[0][0] == requests.WRONG_STATE
    cell.command(commands.HOLD)
    assert cell.command(commands.CLEAR_QUEUE, 'j')[0] == 0
    assert cell.bridge.queued == 0 and 'queue cleared' in cell.bridge.message


def test_many_resends_are_reported():
    cell = Cell().ready()
    cell.bridge.link.sender.lines_sent += 100
    cell.bridge.link.sender.resends += 20
    cell.step(1100)
    assert any('20 of 100 lines were sent again' in n.text for n in cell.notices)


def test_segments_that_come_before_the_numbers_are_agreed_are_not_skipped():
    cell = Cell().ready()
    cell.enqueue(line_of(20))
    cell.until(lambda: len(cell.done) == 8)
    cell.fake.mute.add('L')
    assert cell.command(commands.STOP)[0] == 0
    cell.step(3)
    count = len(cell.done)
    cell.enqueue(line_of(20)[count:])
    cell.step(30)
    cell.fake.mute.clear()
    cell.until(lambda: len(cell.done) == 20, 1000)
    assert [g for g in cell.fake.gcode if 'G1' in g][-1] == 'G1 X20'
    assert sum('G1' in g for g in cell.fake.gcode) == 20


@settings(max_examples=25, deadline=None)
@given(
    st.integers(0, 2**32),
    st.floats(0, 0.2),
    st.floats(0, 0.2),
    st.lists(st.tuples(st.integers(1, 60), st.integers(1, 80)), max_size=4),
)
def test_noise_and_pulled_cables_neither_repeat_nor_skip_metal(seed, loss, damage, pulls):
    cell = Cell().ready()
    up, down = Channel(seed, loss, 0.0, damage), Channel(seed + 1, loss, 0.0, damage)
    feed, take = cell.fake.feed, cell.fake.take
    cell.fake.feed = lambda data: feed(up(data))
    cell.fake.take = lambda: down(take())
    cell.enqueue(line_of(60))
    for before, silence in pulls:
        cell.step(before)
        cell.unplug()
        cell.step(silence)
        while not cell.bridge.connected:  # noise may spoil an attempt
            if not cell.plugged:
                cell.plug()
            cell.step()
    for _ in range(6000):
        if not cell.plugged:
            cell.plug()
        cell.step()
        if len(cell.done) == 60:
            break
    assert cell.done == list(range(60))
    moves = [re.search(r'X([\d.]+)', g)[1] for g in cell.fake.gcode if 'G1' in g]
    assert moves == [str(n) for n in range(1, 61)]
