"""Faults of arc, wire and sensors: found and answered by the configured reaction; and what may start the machine."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from plant_cell import CONTACT, DRIVE, ESTOP, HOT, Cell

IDLE, RUN, HOLD, ALARM = range(4)
ARC, ESTABLISHED, HOMED, ARMED, UNDERFEED = 1, 2, 8, 16, 256


def runs_with_arc(client) -> bool:
    f = client.frame
    return f['state'] == RUN and bool(f['flags'] & ESTABLISHED) and f['v_um_s'] > 0


def wait_until_in_use(cell: Cell, client) -> None:
    """Waits until the controller works with what the cell says now."""
    before = len(cell.steps)
    client.wait(lambda: len(cell.steps) > before + 3)


def arc_changes(controller) -> list[str]:
    return [what for _, what in controller.events() if what in ('arc on', 'arc off')]


# ---- arc


def test_stubbing_is_tried_again_without_leaving_run(port):
    controller, cell, client = port
    client.weld()
    begin = cell.steps[-1][0]
    cell.shorted, cell.voltage = True, 3.5  # wire in the pool, current flows
    assert 'try 1 of 2' in client.wait_line('^! RUN E208')
    off = controller.time_of('arc off')
    assert 80_000 < off - begin < 200_000
    client.wait_line('^! RUN E000 the arc burns again')
    client.wait(lambda: runs_with_arc(client) and client.frame['fault'] == 0)
    frames = [f for f in client.frames if f['t_us'] > off]
    assert all(f['state'] == RUN for f in frames)
    assert not any(
        f['v_um_s'] == 10_000 and not f['flags'] & ARC for f in frames if f['t_us'] > off + 100_000
    )


def test_stubbing_ends_in_hold_when_the_tries_are_used_up(port):
    controller, cell, client = port
    client.weld()
    cell.voltage = 3.5
    assert client.wait_line('^! HOLD', timeout=20).startswith('! HOLD E208 ')
    assert arc_changes(controller).count('arc on') == 3  # the first and two more
    stood = client.next_frame()
    assert not stood['flags'] & ARC and stood['line_executed'] == 3
    cell.voltage = None
    client.ask('$R')
    client.wait(lambda: runs_with_arc(client))


def test_short_circuits_of_dip_transfer_are_no_fault(port):
    _, cell, client = port
    client.weld()
    cell.dips = True
    after = client.frame['t_us'] + 2_000_000
    client.wait(lambda: client.frame['t_us'] > after)
    assert min(f['voltage_mV'] for f in client.frames[-100:] if f['t_us'] < after) < 5_000
    assert runs_with_arc(client) and not any('E208' in x for x in client.lines)


def test_long_arc_is_cut_before_it_reaches_the_tip(port):
    controller, cell, client = port
    client.weld()
    begin = cell.steps[-1][0]
    cell.voltage = 36.0
    assert client.wait_line('^! HOLD').startswith('! HOLD E209 burn-back')
    assert controller.time_of('arc off') - begin < 200_000


def test_the_regulator_makes_up_for_the_drop_in_the_cables(port):
    """2.5 V are lost on the way: the source is asked for more until the arc has its 22 V."""
    _, cell, client = port
    cell.drop = 2.5
    client.weld()
    client.wait(lambda: abs(client.frame['voltage_mV'] - 22_000) < 60)
    assert cell.steps[-1][1][-1][4] == pytest.approx(24.5, abs=0.1)
    cell.drop = 9.0  # more than the regulator may add
    client.wait(lambda: abs(cell.steps[-1][1][-1][4] - 27.0) < 1e-3)
    assert runs_with_arc(client)


# ---- wire


def test_wire_jam_is_found_by_the_encoder_at_nine_tenths(port):
    _, cell, client = port
    client.weld()
    client.wait(lambda: client.frame['wire_um_s'] == client.frame['wire_cmd_um_s'] > 80_000)
    cell.wire = 0.95 * 5 / 60
    after = client.frame['t_us'] + 1_500_000
    client.wait(lambda: client.frame['t_us'] > after)
    assert runs_with_arc(client)
    cell.wire = 0.88 * 5 / 60
    assert client.wait_line('^! HOLD').startswith('! HOLD E206 ')


def test_the_threshold_of_underfeed_is_a_setting_and_telemetry_says_so_before_the_fault(port):
    _, cell, client = port
    assert client.ask('$C wire_underfeed_ratio 0.49').startswith('$C error E104 ')
    assert client.ask('$C wire_underfeed_ratio 1').startswith('$C error E104 ')
    assert client.ask('$C wire_underfeed_rati 0.8').startswith('$C error E103 ')
    assert client.ask('$C wire_underfeed_ratio 0.8').startswith('$C ok')
    client.weld()
    client.wait(lambda: client.frame['wire_um_s'] == client.frame['wire_cmd_um_s'] > 80_000)
    cell.wire = 0.85 * 5 / 60  # an underfeed of the shipped setting
    after = client.frame['t_us'] + 1_000_000
    client.wait(lambda: client.frame['t_us'] > after)
    assert runs_with_arc(client) and not client.frame['flags'] & UNDERFEED
    cell.wire = 0.78 * 5 / 60
    client.wait_line('^! HOLD E206 ')
    begin = next(f for f in client.frames if f['flags'] & UNDERFEED)
    assert begin['state'] == RUN and begin['flags'] & ARC


def test_wire_frozen_in_the_bead_is_burnt_off_by_a_pulse(port):
    controller, cell, client = port
    client.ready_for_arc()
    cell.freed_by_pulse, cell.flags = True, CONTACT
    client.send('G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X60 F600', 'M5', 'G1 X61')
    client.wait(lambda: client.frame['state'] == IDLE and client.frame['x_um'] == 61_000)
    off = [t for t, what in controller.events() if what == 'arc off']
    assert len(off) == 2  # the bead and one pulse
    pulse = controller.time_of('arc on', off[0])
    assert 30_000 < off[1] - pulse < 50_000  # short, with the wire at rest
    assert not any(f['v_um_s'] for f in client.frames if off[0] < f['t_us'] <= off[1])
    assert not any(f['wire_cmd_um_s'] > 5_000 for f in client.frames if pulse < f['t_us'] <= off[1])


def test_wire_that_stays_frozen_holds_the_machine_until_it_is_cut(port):
    controller, cell, client = port
    cell.flags = CONTACT
    client.lease = True
    wait_until_in_use(cell, client)
    client.identify()
    client.sequence = client.accepted = 0
    client.send('G28')
    assert client.wait_line('^! HOLD').startswith('! HOLD E211 the wire is frozen')
    client.ask('$R')
    client.wait(lambda: sum(x.startswith('! HOLD E211') for x in client.lines) == 2)
    assert not any(f['v_um_s'] for f in client.frames) and 'arc on' not in arc_changes(controller)
    cell.flags = 0
    wait_until_in_use(cell, client)
    client.ask('$R')
    client.wait(lambda: client.frame['flags'] & HOMED and client.frame['state'] == IDLE)


def test_no_move_after_an_alarm_before_the_wire_is_known_to_be_free(port):
    _, cell, client = port
    client.weld()
    cell.flags = ESTOP
    client.wait_line('^! ALARM E300')
    cell.flags = CONTACT
    wait_until_in_use(cell, client)
    client.wait(lambda: not client.frame['flags'] & 64)
    assert client.ask('$X') == '$X ok'
    at = [client.next_frame()[a] for a in ('x_um', 'y_um', 'z_um')]
    client.identify()
    client.sequence = client.accepted = 0
    client.send('G28')
    client.wait_line('^! HOLD E211')
    assert [client.next_frame()[a] for a in ('x_um', 'y_um', 'z_um')] == at


def test_the_fault_of_a_drive_ends_everything_and_is_not_reset_before_it_is_gone(port):
    controller, cell, client = port
    client.weld()
    cell.flags = DRIVE
    assert client.wait_line('^! ALARM') == '! ALARM E308 fault of a drive'
    client.wait(lambda: not client.frame['flags'] & (ARC | HOMED))
    begun = client.frame['t_us']
    assert client.ask('$X').startswith('$X error E308')
    assert client.ask('$A job').startswith('$A error E108')
    cell.flags, gone = 0, client.frame['t_us']
    client.wait(lambda: client.frame['t_us'] > gone + 1_000_000)
    stood = [f for f in client.frames if f['t_us'] >= begun]
    assert {f['state'] for f in stood} == {ALARM}, 'until the reset'
    assert len({(f['x_um'], f['y_um'], f['z_um'], f['v_um_s']) for f in stood}) == 1
    assert client.ask('$X') == '$X ok'
    client.identify()
    client.sequence = client.accepted = 0
    client.send('G1 X60 F600')  # where the axes are nobody knows
    assert 'E304 ' in client.wait_line('^er N1')
    client.home()


# ---- temperature and sensors


def test_over_temperature_ends_the_arc_and_keeps_it_off(port):
    controller, cell, client = port
    client.weld()
    cell.flags = HOT
    assert client.wait_line('^! HOLD') == '! HOLD E210 over-temperature'
    client.wait(lambda: not client.frame['flags'] & ARC)
    count = arc_changes(controller).count('arc on')
    client.ask('$R')
    client.wait(lambda: sum(x.startswith('! HOLD E210') for x in client.lines) == 2)
    assert arc_changes(controller).count('arc on') == count
    cell.flags = 0
    wait_until_in_use(cell, client)
    client.ask('$R')
    client.wait(lambda: runs_with_arc(client))


@pytest.mark.parametrize('value', [float('nan'), float('inf'), 1e5, -500.0])
def test_current_that_cannot_be_is_an_alarm(port, value):
    _, cell, client = port
    client.weld()
    cell.ripple, cell.current = 0.0, value
    cell.stray = True  # the cell's own arc would not burn on nonsense
    assert client.wait_line('^! ALARM').startswith('! ALARM E303 ')
    assert not client.next_frame()['flags'] & (ARC | HOMED | ARMED)


def test_frozen_sensor_is_an_alarm(port):
    controller, cell, client = port
    client.weld()
    cell.ripple = 0.0
    begin = cell.steps[-1][0]
    line = client.wait_line('^! ALARM')
    assert line.startswith('! ALARM E303 arc') and line.endswith('sensor stuck')
    assert 900_000 < controller.time_of('state ALARM') - begin < 1_300_000


def test_current_with_the_source_off_is_an_alarm(port):
    _, cell, client = port
    client.wait(lambda: len(cell.steps) > 3)
    client.home()
    cell.stray = True
    assert 'although the source is off' in client.wait_line('^! ALARM E303')


# ---- starting


def test_starts_faulted_and_only_a_reset_with_the_stop_released_leads_to_idle(start, tmp_path):
    path = tmp_path / 'cell.sock'
    controller = start('--plant', str(path), '--rate', '30', idle=False)
    cell = Cell(path, flags=ESTOP)
    client = controller.connect()
    client.wait(lambda: client.frame and client.frame['flags'] & 64)
    assert client.frame['state'] == ALARM and client.frame['fault'] == 306
    client.identify()
    assert client.ask('$A job').startswith('$A error E108')
    assert client.ask('$J 1 0 0 600').startswith('$J error E108')
    client.sequence = client.accepted = 0
    client.send('G28')
    assert 'E108 ' in client.wait_line('^er N1')
    client.raw(b'\x81\x81\x81\n')
    assert client.ask('$R').startswith('$R error E108')
    assert client.ask('$X').startswith('$X error E300')  # the stop is still pressed
    assert client.next_frame()['state'] == ALARM
    cell.flags = 0
    client.wait(lambda: not client.frame['flags'] & 64)
    assert client.next_frame()['state'] == ALARM  # releasing the stop starts nothing
    assert client.ask('$X') == '$X ok'
    client.wait(lambda: client.frame['state'] == IDLE)
    assert not client.frame['flags'] & (HOMED | ARMED)
    client.home()
    cell.close()


# ---- the core alone


@pytest.mark.parametrize(
    'name',
    [
        'safety_properties',  # other reactions, the fast cut, watchdog and temperature
        'counter_properties',  # counters at the end of their range
        'limit_properties',  # never further into a limit switch
        'shaper_properties',  # random programs with an input shaper: exact steps, nothing early
        'rounding_properties',  # corners and curves stay within shape_corner_mm
        'gantry_properties',  # any envelope, speed and way of homing: never beyond them
        'standoff_properties',  # what may move the torch up and down, and when
        'acceleration_properties',  # the accelerometer: order, losses and faults
    ],
)
def test_properties_of_the_core(controller_path, name):
    beside = controller_path.with_name(name)
    built = Path(__file__).parents[3] / f'build/waam_firmware/{name}'
    program = beside if beside.exists() else built
    assert program.exists(), f'{program} was not built (BUILD_TESTING)'
    done = subprocess.run([program], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0 and 'all properties hold' in done.stdout, done.stderr
