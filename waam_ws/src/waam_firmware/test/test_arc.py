"""Arc sequence, lease, watchdogs, wire: what keeps an arc from burning where it must not."""

from __future__ import annotations

import time

import pytest

IDLE, RUN, HOLD = 0, 1, 2
LEASE_US = 500_000


def test_sequence_of_a_bead(client, controller):
    client.ready_for_arc()
    client.run('G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X60 F600', 'M5', 'G0 X70')
    client.wait(lambda: not client.frame['flags'] & 4)
    events = {what: t for t, what in controller.events()}
    assert events['arc on'] - events['gas on'] == pytest.approx(300_000, abs=2_000)
    assert events['established on'] - events['arc on'] == pytest.approx(70_000, abs=3_000)
    assert events['arc off'] - events['established on'] == pytest.approx(
        1_020_000 + 210_000, abs=10_000
    )
    assert events['gas off'] - events['arc off'] == pytest.approx(1_000_000, abs=2_000)
    arc = [f for f in client.frames if f['flags'] & 2]
    assert {f['current_mA'] for f in arc} == {180_000} and {f['voltage_mV'] for f in arc} == {
        22_000
    }
    full = round(5000 / 60 * 1000)
    moving = [f for f in arc if f['v_um_s'] == 10_000]
    assert {f['wire_cmd_um_s'] for f in moving[10:]} == {full}
    assert not any(
        f['v_um_s'] and not f['flags'] & 2 for f in client.frames if 50_000 < f['x_um'] < 60_000
    )


def test_arc_end_does_not_hold_up_what_follows(client, controller):
    """Post-flow runs while the next moves do; M5 without an arc costs nothing."""
    client.ready_for_arc()
    client.run('G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X51 F600', 'M5', 'M9', 'G0 X100')
    assert (
        controller.time_of('state IDLE', controller.time_of('arc off'))
        < controller.time_of('gas off') + 1_000_000
    )
    after = client.next_frame()['t_us']
    client.run('G1 X110 F600', 'M5', 'G1 X120', 'M5', 'G1 X130')
    assert controller.run_time(after) == pytest.approx(3.02, abs=0.004)


def test_gas_words_beside_other_words(client, controller):
    """M7 and M9 act when the line's block starts and do not stop the path; beside M5 the gas goes after the arc."""
    client.ready_for_arc()
    client.run('G0 X50 Y50 Z100')
    before = client.next_frame()['t_us']
    client.run('G1 X60 F600', 'X70 M7', 'X80 M9', 'G4 P0.5 M7', 'M9')
    started = controller.time_of('state RUN', before)
    on, off = (controller.time_of(f'gas {what}', before) for what in ('on', 'off'))
    again = controller.time_of('gas on', off)
    assert on - started == pytest.approx(1_010_000, abs=4_000)
    assert off - on == pytest.approx(1_000_000, abs=4_000)
    assert again - off == pytest.approx(1_010_000, abs=4_000)
    assert controller.time_of('gas off', again) - again == pytest.approx(500_000, abs=4_000)
    before = client.next_frame()['t_us']
    client.run('M7', 'M3 W5000 S22', 'G1 X85 F600', 'M5 M9')
    client.wait(lambda: not client.frame['flags'] & 4)
    arc_off = controller.time_of('arc off', before)
    assert controller.time_of('gas off', before) - arc_off == pytest.approx(1_000_000, abs=4_000)


def test_gas_of_a_line_without_a_block_is_not_lost(client, controller):
    """A mode, a move below a step, an arc end without arc: the gas word of such a line acts too."""
    client.ready_for_arc()
    client.run('G0 X50 Y50 Z100')
    for line in (
        'G21 M7',
        'G54 M9',
        'G91 G0 X0.0001 M7',
        'M5 M9',
        'G17 M7',
        'M30 M9',
    ):
        before = client.next_frame()['t_us']
        client.run(line)
        what = 'off' if 'M9' in line else 'on'
        client.wait(lambda what=what: bool(client.frame['flags'] & 4) == (what == 'on'))
        assert controller.time_of(f'gas {what}', before)


def test_wire_follows_blocks_and_its_own_override_but_not_travel(client):
    client.weld(200)
    full = round(5000 / 60 * 1000)
    client.wait(lambda: client.frame['wire_cmd_um_s'] == full and client.frame['v_um_s'] == 10_000)
    client.ask('$V 500 1000')
    client.wait(lambda: client.frame['v_um_s'] == 5_000)
    assert client.frame['wire_cmd_um_s'] == full
    client.ask('$V 500 1200')
    client.wait(lambda: client.frame['wire_cmd_um_s'] == round(1.2 * full))
    assert client.frame['v_um_s'] == 5_000
    client.ask('$V 2000 1000')
    client.wait(lambda: client.frame['line_executed'] == 4, timeout=30)


def test_per_block_wire_and_voltage_take_effect_when_the_block_starts(client):
    client.ready_for_arc()
    client.run(
        'G0 X50 Y50 Z100', 'M3 W5000 S22', 'G1 X60 F600', 'G1 X70 W6000 S24', 'G4 P0.3', 'M5'
    )
    by_line = {
        n: {f['wire_cmd_um_s'] for f in client.frames if f['line_executed'] == n and f['flags'] & 2}
        for n in (3, 4, 5)
    }
    assert round(6000 / 60 * 1000) not in by_line[3]
    assert round(6000 / 60 * 1000) in by_line[4]
    assert by_line[5] == {
        round(6000 / 60 * 1000)
    }  # the wire runs while the machine stands in a dwell


def test_lease_expiry_switches_the_arc_off_in_time(client, controller):
    client.weld(300)
    lease = client.frozen_lease = client.frame['t_us']
    client.lease = 'frozen'
    assert client.wait_line('^! HOLD') == '! HOLD E202 the arc lease expired'
    client.wait(lambda: not client.frame['flags'] & 1)
    client.wait(lambda: client.frame['v_um_s'] == 0)
    off = controller.time_of('arc off')
    assert lease + 400_000 < off <= lease + LEASE_US


def test_dead_host_switches_the_arc_off_in_time(client, controller):
    client.weld(300)
    client.heartbeat = False
    last = client.frame['t_us']
    client.wait_line('^! HOLD E202')
    client.wait(lambda: not client.frame['flags'] & 1)
    # a heartbeat may have been under way
    assert controller.time_of('arc off') <= last + LEASE_US + 20_000


def test_late_host_slows_time_and_keeps_the_arc(client):
    """Half a second of wall time without a sign of life, at 30 times real time, is lateness and not death."""
    client.weld(300)
    before = client.frame['t_us']
    client.paused = True
    time.sleep(0.5)
    client.paused = False
    client.wait(lambda: client.frame['t_us'] > before + 1_000_000)
    assert {f['state'] for f in client.frames if f['t_us'] > before} == {RUN}
    assert client.frame['flags'] & 2


def test_no_lease_no_arc(client, controller):
    client.ready_for_arc()
    client.lease = False
    client.next_frame()
    client.send('G0 X50', 'M3 W5000 S22', 'G1 X60 F600')
    client.wait_line('^! HOLD E202')
    assert not any(what == 'arc on' for _, what in controller.events())
    assert client.next_frame()['x_um'] == 50_000


def test_lease_from_the_future_counts_as_now(client, controller):
    client.weld(300)
    client.frozen_lease = 2**63
    client.lease = 'frozen'
    client.next_frame()
    assert 0 < client.next_frame()['lease_left_ms'] <= 500
    client.frozen_lease = 1
    client.wait_line('^! HOLD E202')


def test_running_dry_ends_the_arc(client, controller):
    client.weld(5)
    assert client.wait_line('^! HOLD').startswith('! HOLD E203 ')
    client.wait(lambda: not client.frame['flags'] & 1)
    assert client.frame['underruns'] == 1 and client.frame['x_um'] == 55_000
    stopped = max(f['t_us'] for f in client.frames if f['v_um_s'])
    assert controller.time_of('arc off') - stopped < 300_000


def test_hold_ends_the_arc_and_resume_strikes_it_again(client, controller):
    client.weld(60)
    client.ask('$P')
    client.ask('$R')  # at once: it waits until motion and arc have ended
    client.wait(lambda: client.frame['line_executed'] == 4, timeout=20)
    states = [what for _, what in controller.events() if what.startswith(('arc', 'state'))]
    first = states.index('arc on')
    assert states[first : first + 5] == [
        'arc on',
        'state HOLD E200',
        'arc off',
        'state RUN E000',
        'arc on',
    ]
    stood = {f['x_um'] for f in client.frames if f['fault'] == 200 and not f['v_um_s']}
    assert len(stood) == 1
    off, on = (
        controller.time_of('arc off'),
        controller.time_of('established on', controller.time_of('arc off')),
    )
    assert not any(f['v_um_s'] for f in client.frames if off < f['t_us'] < on)


def test_stop_ends_the_arc_at_once(client, controller):
    client.weld(200)
    client.ask('$S')
    client.wait(lambda: client.frame['state'] == IDLE)
    burning = controller.time_of('state IDLE', controller.time_of('arc off')) - controller.time_of(
        'arc off'
    )
    assert burning < 50_000
    client.wait(lambda: client.frame['wire_cmd_um_s'] == 0)
    assert not any(what.startswith('state HOLD') for _, what in controller.events())


def test_disarming_with_the_arc_on_ends_it(client):
    client.weld(200)
    client.ask('$D')
    client.wait_line('^! HOLD E305')
    client.wait(lambda: not client.frame['flags'] & 1)


@pytest.mark.parametrize(('prepare', 'code'), [((), 304), (('home',), 305)])
def test_arc_needs_homing_and_arming(client, prepare, code):
    client.identify()
    for step in prepare:
        getattr(client, step)()
    client.send('M3 W5000 S22')
    assert f'E{code} ' in client.wait_line('^er')


def test_arc_needs_measurements(start):
    client = start('--rate', '40').connect()
    client.ready_for_arc()
    client.send('M3 W5000 S22')
    assert 'E303 ' in client.wait_line('^er')
