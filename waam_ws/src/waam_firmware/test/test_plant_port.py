"""The plant port, with a small cell written from waam_firmware/doc/plant_port.md: layout, lock-step, faults."""

from __future__ import annotations

import socket
import time
from contextlib import closing

import pytest
from plant_cell import ACCELEROMETER, ESTOP, LIMIT, Cell

ALARM, HOLD = 3, 2


def test_steps_carry_the_true_machine_position_and_setpoints(port):
    _, cell, client = port
    client.wait(lambda: cell.steps)
    assert cell.steps[0][1][0][:3] == pytest.approx((-0.008, -0.006, 0.195))
    client.ask('$Z 10 20 30')
    client.weld()
    client.wait(lambda: client.frame['x_um'] > 53_000)
    times = [t for t, _ in cell.steps]
    assert all(b - a == 10_000 for a, b in zip(times, times[1:], strict=False))
    x, y, z, wire, voltage, outputs = cell.steps[-1][1][-1]
    assert (y, z) == pytest.approx((-0.070, 0.130)) and -0.2 < x < -0.06
    assert (wire, voltage, outputs) == (pytest.approx(5 / 60), pytest.approx(22.0, abs=0.05), 3)
    moved = [s[0] for _, samples in cell.steps[-20:] for s in samples]
    # 10 mm/s, 1 ms, one step
    assert all(abs(b - a + 10e-6) < 4e-6 for a, b in zip(moved, moved[1:], strict=False))


def simulated_over(cell: Cell, client, seconds: float) -> float:
    """Simulated seconds that pass in so many of the wall clock."""
    first, end = cell.steps[-1][0], time.monotonic() + seconds
    client.wait(lambda: time.monotonic() > end)
    return (cell.steps[-1][0] - first) * 1e-6


def test_time_rests_until_a_job_is_armed(start, tmp_path):
    path = tmp_path / 'cell.sock'
    controller = start('--plant', str(path), '--rate', '30', '--rest', '--start', '8,6,195')
    with closing(Cell(path)) as cell:
        client = controller.connect()
        client.home()
        assert simulated_over(cell, client, 0.5) < 0.8
        client.ask('$A test')
        assert simulated_over(cell, client, 0.5) > 2.0
        client.ask('$D')
        assert simulated_over(cell, client, 0.5) < 0.8


def test_no_discontinuity_when_homing_sets_the_position(port):
    _, cell, client = port
    client.home()
    path = [s[:3] for _, samples in cell.steps for s in samples]
    jumps = [
        max(abs(a - b) for a, b in zip(p, q, strict=True))
        for p, q in zip(path, path[1:], strict=False)
    ]
    assert max(jumps) < 50e-6
    assert path[-1] == pytest.approx((0.0, 0.0, 0.2), abs=1e-9)


@pytest.mark.parametrize(('flag', 'code'), [(ESTOP, 300), (LIMIT, 301)])
def test_emergency_stop_and_limit_switch_are_alarms(port, flag, code):
    controller, cell, client = port
    client.weld()
    cell.flags = flag
    assert client.wait_line('^! ALARM').startswith(f'! ALARM E{code} ')
    frame = client.next_frame()
    assert frame['state'] == ALARM and not frame['flags'] & (1 | 2 | 4 | 8 | 16)
    assert frame['wire_cmd_um_s'] == frame['v_um_s'] == 0
    assert controller.time_of('arc off') == controller.time_of('state ALARM')
    client.send('G0 X5')
    assert 'E108 ' in client.wait_line('^er N5')
    if flag == ESTOP:
        assert client.ask('$X').startswith('$X error E300')
        cell.flags = 0
        client.wait(lambda: not client.frame['flags'] & 64)
    assert client.ask('$X') == '$X ok'
    assert client.ask('$P') == '$P ok' and client.ask('$S') == '$S ok'
    cell.flags = 0
    released = client.next_frame()['t_us'] + 100_000
    client.wait(lambda: client.frame['t_us'] > released)
    client.home()


def test_with_the_limit_switch_pressed_only_the_way_out_is_free(port):
    _, cell, client = port
    client.home()
    client.run('G0 X20')
    client.send('G1 X10 F12')  # slow: still on its way when the switch is pressed
    client.wait(lambda: client.frame['x_um'] < 19_990)
    cell.flags = LIMIT
    client.wait_line('^! ALARM E301')
    client.next_frame()
    stood = client.next_frame()['x_um']
    assert client.ask('$X') == '$X ok'
    for jog, way in [('-50 0 0', 'X may only go up'), ('0 1 0', 'Y may not move')]:
        assert client.ask(f'$J {jog} 600').startswith(
            '$J error E301 the limit switch is pressed: ' + way
        )
    client.numbered(client.sequence + 1, 'G28')  # Z would have to move first
    assert client.next_frame()['x_um'] == stood
    assert client.ask('$J 1 0 0 600') == '$J ok'
    client.wait(lambda: client.frame['x_um'] == stood + 1000)
    assert client.ask('$J 20 0 0 1200') == '$J ok'  # the switch does not let go: the way out ends
    assert client.wait_line('^! ALARM E301', len(client.lines) - 1).startswith(
        '! ALARM E301 limit switch: still pressed'
    )
    assert client.next_frame()['x_um'] <= stood + 10_000
    cell.flags = 0


def test_lost_arc(port):
    controller, cell, client = port
    client.weld()
    cell.current = 0.0
    before = cell.steps[-1][0]
    assert client.wait_line('^! HOLD') == '! HOLD E204 the arc was lost'
    assert 180_000 <= controller.time_of('arc off') - before < 250_000
    cell.current = 180.0
    client.ask('$R')
    client.wait(lambda: client.frame['flags'] & 2 and client.frame['v_um_s'] > 0)


@pytest.mark.parametrize('coast_s', [0.01, 0.3, 1.0])
def test_at_the_end_of_the_wire_the_wire_is_the_cause_not_the_arc(port, coast_s):
    """The wheel runs down, then the arc burns back and goes out: what came first is the cause."""
    controller, cell, client = port
    client.weld()
    client.wait(lambda: client.frame['wire_um_s'] == client.frame['wire_cmd_um_s'] > 80_000)
    begin = cell.steps[-1][0]
    cell.coast = coast_s
    assert client.wait_line('^! HOLD').startswith('! HOLD E206 ')
    assert controller.time_of('arc off') - begin < 400_000
    cell.thread_wire()
    client.ask('$R')
    client.wait(lambda: client.frame['flags'] & 2 and client.frame['v_um_s'] > 0)


def test_without_wire_no_strike_is_a_fault_of_the_arc(port):
    _, cell, client = port
    cell.wire, cell.current = 0.0, 0.0
    client.ready_for_arc()
    client.send('G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X200 F600')
    assert client.wait_line('^! HOLD').startswith('! HOLD E206 ')
    cell.thread_wire()
    client.ask('$R')
    client.wait(lambda: client.frame['flags'] & 2 and client.frame['v_um_s'] > 0)


def test_no_arc_after_three_tries(port):
    controller, cell, client = port
    cell.current = 0.0
    client.ready_for_arc()
    client.send('G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X200 F600')
    assert client.wait_line('^! HOLD').startswith('! HOLD E205 ')
    assert sum(what == 'arc on' for _, what in controller.events()) == 3
    assert client.next_frame()['line_executed'] == 2


def test_wire_fault(port):
    controller, cell, client = port
    client.weld()
    client.wait(lambda: client.frame['wire_um_s'] == client.frame['wire_cmd_um_s'] > 80_000)
    cell.wire = 0.85 * 5 / 60
    begin = cell.steps[-1][0]
    assert client.wait_line('^! HOLD').startswith('! HOLD E206 ')
    assert 480_000 < controller.time_of('state HOLD') - begin < 550_000


def test_missing_gas(port):
    _, cell, client = port
    cell.gas = False
    client.ready_for_arc()
    client.send('M3 W5000 S22', 'G0 X1')
    assert client.wait_line('^! HOLD') == '! HOLD E207 no gas flow'
    assert not any(f['flags'] & 1 for f in client.frames)


@pytest.mark.parametrize('how', ['hang up', 'silence', 'nonsense', 'nan'])
def test_lost_cell_is_an_alarm_and_time_goes_on(port, how):
    controller, cell, client = port
    client.weld()
    if how == 'hang up':
        cell.socket.shutdown(socket.SHUT_RDWR)
    elif how == 'silence':
        cell.answering = False
    elif how == 'nonsense':
        cell.magic = 1
    else:
        cell.current = float('inf')
    assert client.wait_line('^! ALARM').startswith('! ALARM E303 ')
    assert not client.next_frame()['flags'] & 1
    at = client.frame['t_us']
    client.wait(lambda: client.frame['t_us'] > at + 100_000)
    if how != 'nan':
        assert client.ask('$X').startswith('$X error E303')
        cell.close()
        again = Cell(cell.path)
        client.wait(lambda: again.steps)
        client.next_frame()
    cell.current = 180.0
    client.next_frame()
    assert client.ask('$X') == '$X ok'
    client.home()


def test_only_one_cell(port):
    _, cell, client = port
    client.wait(lambda: cell.steps)
    second = Cell(cell.path)
    second.thread.join(5)
    assert not second.steps
    count = len(cell.steps)
    client.wait(lambda: len(cell.steps) > count + 3)


def counts(line: str) -> list[tuple[int, ...]]:
    """Samples of an A line, (x, y, z)."""
    packed = line.split(',', 3)[3].encode()
    found = []
    for i in range(0, 112, 7):
        bits = 0
        for digit in packed[i : i + 7]:
            bits = bits << 6 | digit - 48
        found.append(tuple((bits >> shift & 0x3FFF) - 8192 for shift in (28, 14, 0)))
    return found


def test_what_the_cell_feels_comes_over_the_link_sample_by_sample(port):
    _, cell, client = port
    cell.flags |= ACCELEROMETER
    client.wait(lambda: len(cell.steps) > 3)
    first = len(client.lines)
    client.ask('$M 1')
    client.wait(lambda: sum(line.startswith('A ') for line in client.lines[first:]) > 40)
    client.ask('$M 0')
    seen = [s for line in client.lines[first:] if line.startswith('A ') for s in counts(line)]
    begun = next(i for i, s in enumerate(seen) if s[1] == -4000)
    assert begun < 32, 'at rest until the first samples of the cell come'
    x = [s[0] for s in seen[begun:]]
    steps = {(b - a) % 4000 for a, b in zip(x, x[1:], strict=False)}
    assert steps == {2}, 'none lost, none doubled'
    assert {s[1:] for s in seen[begun:]} == {(-4000, 256)}
    client.wait(lambda: not cell.steps[-1][1][-1][5] & 4)


def test_a_cell_without_an_accelerometer_is_told_as_a_sensor_that_is_not_there(port):
    _, cell, client = port
    client.wait(lambda: len(cell.steps) > 3)
    client.ask('$M 1')
    client.wait_line('E213 accelerometer: no ADXL345 answers')
