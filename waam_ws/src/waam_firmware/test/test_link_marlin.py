"""3-D printing senders: Marlin's form of the link, and Printrun's printcore as the third-party judge of it.

They may move the machine; nothing that they send strikes an arc.
"""

from __future__ import annotations

import os
import random
import re
import time
from functools import reduce

import pytest
from plain_terminal import Plain, until


def xored(text: str) -> bytes:
    return f'{text}*{reduce(lambda a, b: a ^ b, text.encode())}\n'.encode()


@pytest.fixture
def marlin(start):
    """A controller beside its home switches, and a Marlin sender that has said hello and homed."""
    controller = start('--null-plant', '--start', '0.5,0.5,199.5')
    plain = Plain(controller.link)
    assert plain.ask(b'M105\n').startswith('ok T:')
    assert 'start' in plain.lines
    plain.ask(xored('N-1 M110 N-1'))
    plain.ask(xored('N0 G28'))
    plain.wait('^echo:! IDLE')
    yield controller, plain
    plain.close()


def test_lines_are_taken_in_marlins_form(marlin):
    controller, plain = marlin
    assert plain.ask(xored('N1 G91')).startswith('ok N1 P')
    assert plain.ask(xored('N2 G1 X1 F6000')).startswith('ok N2 P')
    assert plain.ask(xored('N2 G1 X1 F6000')).startswith('ok N2 P')  # a duplicate is dropped
    assert 'FIRMWARE_NAME' in plain.ask(xored('N3 M115'))
    assert plain.ask(b'N4 G1 X1*0\n', '^Resend').endswith('Resend: 4')
    assert plain.ask(xored('N4 G1 X2'), '^ok N4')
    assert plain.ask(xored('N6 G1 X1'), '^Resend') == 'Resend: 5'
    assert plain.ask(b'M110 N99\n').startswith('ok N99 ')
    assert plain.ask(xored('N100 G1 Y1')).startswith('ok N100 ')
    end = time.monotonic() + 20
    while plain.ask(b'M114\n') != 'ok X:3 Y:1 Z:200 E:0':
        assert time.monotonic() < end, plain.lines[-3:]
    assert not any(x.startswith(('T ', '$', 'er ', 'rs ')) for x in plain.lines)


def test_steps_per_mm_are_told_and_set(marlin):
    """Numbered lines wait for the motion before them; without a number they are refused while it lasts."""
    _, plain = marlin
    assert plain.ask(b'M503\n', '^echo: M92') == 'echo: M92 X320.000 Y320.000 Z320.000'
    plain.ask(xored('N1 G1 X10 F1200'))
    assert plain.ask(b'M92 X310\n', '^echo:E') == 'echo:E108 settings only in IDLE or ALARM'
    said = plain.ask(xored('N2 M92 X319.8734 Z640.5'), '^echo:homing')
    assert said == 'echo:homing is lost, send G28; M92 X319.873 Y320.000 Z640.500'
    assert plain.ask(b'M92\n', '^echo:M92') == 'echo:M92 X319.873 Y320.000 Z640.500'
    assert plain.ask(b'M92 Y321\n', '^echo:M92') == 'echo:M92 X319.873 Y321.000 Z640.500'
    place = plain.ask(b'M114\n', '^ok X')  # to half a step
    assert re.match(r'ok X:(10|10\.00[12]|9\.99[89]) Y:', place), place
    assert plain.ask(xored('N3 G1 X5'), '^Error').startswith('Error:E304 ')
    plain.ask(b'M110 N3\n')
    assert plain.ask(xored('N4 M92 X5'), '^Error:').startswith('Error:E104 line 4 column ')
    plain.ask(b'M110 N4\n')
    assert plain.ask(xored('N5 M92 E93'), '^Error:').endswith('M92 takes X, Y and Z')


def test_what_has_no_number_and_check_never_moves(marlin):
    _, plain = marlin
    before = plain.ask(b'M114\n')
    for text in (b'G1 X50 F6000\n', b'G0 X50\n', b'hello\n', b'M104 S200\n'):
        assert plain.ask(text, '^echo').startswith('echo:E108')
    assert plain.ask(b'M114\n', '^ok X') == before


@pytest.mark.parametrize('line', ['M3 W5000 S22', 'M7'])
def test_it_never_strikes_the_arc(marlin, line):
    controller, plain = marlin
    for text in ('$A job', '$H 1 999999999'):
        assert 'error E108' in plain.ask(xored(text), r'^\$')
    start = len(plain.lines)
    plain.send(xored(f'N1 {line}'))
    if line.startswith('M3'):
        assert plain.wait('^Error', start).startswith('Error:E305 line 1 ')
        assert plain.wait('^!!', start)
        plain.send(xored('N2 G4 P0'))  # nothing is taken any more
        plain.ask(b'M110 N0\n', '^ok N0')
        assert not any(x.startswith('ok N2') for x in plain.lines)
    assert not any(what == 'arc on' for _, what in controller.events())


def test_it_is_entered_only_by_the_first_line_of_an_idle_machine(controller):
    native = controller.connect()
    native.home()
    start = len(native.lines)
    native.raw(b'M105\n')
    assert native.wait_line('^rs', start) == 'rs N2 E100'
    native.send('G1 X100 F600')
    native.wait(lambda: native.frame['x_um'] > 500)
    native.close()
    controller.clients.clear()
    plain = Plain(controller.link)
    plain.send(b'M105\n')  # the machine is not handed over while it works for another host
    plain.wait('^T ')
    assert 'start' not in plain.lines
    plain.close()


def idle_events(controller) -> int:
    return sum(what.startswith('state IDLE') for _, what in controller.events())


@pytest.fixture
def plain(start):
    """A terminal that has said nothing yet, and its controller beside the home switches."""
    controller = start('--null-plant', '--start', '0.5,0.5,199.5', idle=False)
    plain = Plain(controller.link)
    yield controller, plain
    plain.close()


def beat_until_idle(controller, plain) -> None:
    """Heartbeats from now until the machine has run and is IDLE again."""
    idle, end = idle_events(controller), time.monotonic() + 30
    while idle_events(controller) == idle:
        assert time.monotonic() < end, plain.lines[-5:]
        plain.send(xored('$H 1 0'))
        time.sleep(0.05)


@pytest.mark.parametrize('hello', [b'M105\n', b'M110 N0\n', xored('N0 M110 N0')])
def test_a_host_that_has_sent_a_checked_line_keeps_its_watchdog(plain, hello):
    """Without `$I`, too: what a Marlin sender says does not free the host from its heartbeat."""
    controller, terminal = plain
    for text in ('$X', '$L 1', '$H 1 0'):
        assert 'error' not in terminal.ask(xored(text), rf'^\{text[:2]}')
    terminal.send(hello)
    terminal.send(xored('N1 G28'))
    beat_until_idle(controller, terminal)
    terminal.send(xored('N2 G1 X300 F3000'))
    until(lambda: any('HOLD E201' in what for _, what in controller.events()), 20)
    assert 'start' not in terminal.lines


def test_what_it_says_is_no_sign_of_life_of_a_native_host(plain):
    """A job runs, its host hangs up; somebody who asks for the temperature does not stand in for it."""
    controller, terminal = plain
    for text in ('$X', '$L 1'):
        terminal.ask(xored(text), rf'^\{text[:2]}')
    terminal.send(xored('N1 G28'))
    beat_until_idle(controller, terminal)
    terminal.send(xored('N2 G1 X300 F3000'))
    until(lambda: controller.events()[-1][1].startswith('state RUN'), 20)
    os.close(terminal.fd)
    terminal.fd = os.open(controller.link, os.O_RDWR | os.O_NOCTTY)
    end = time.monotonic() + 20
    while not any('HOLD E201' in what for _, what in controller.events()):
        assert time.monotonic() < end, controller.events()[-3:]
        terminal.send(b'M105\n')
        time.sleep(0.02)


def test_when_its_terminal_closes_the_machine_stops(marlin):
    controller, plain = marlin
    plain.ask(xored('N1 G1 X300 F3000'))
    end = time.monotonic() + 20
    while not re.match(r'ok X:(?!0)\d+\.?\d* Y:0 Z:200 ', plain.ask(b'M114\n', '^ok X')):
        assert time.monotonic() < end
    idle = idle_events(controller)
    os.close(plain.fd)
    until(lambda: idle_events(controller) > idle, 20)
    client = controller.connect()
    plain.fd = os.dup(client.fd)
    client.wait(lambda: client.frame and client.frame['state'] == 0)
    assert client.frame['x_um'] < 299_000
    client.identify()
    assert client.frame['flags'] & 8  # still homed; the native host takes over
    client.sequence = client.accepted = 0
    client.run('G1 X1 F6000')


printcore = pytest.importorskip('printrun.printcore', reason='Printrun is not installed')
JOB_LINES = 500


def test_printcore_streams_a_job_without_loss(start):
    """Relative moves: a line lost, doubled or misread would end elsewhere."""
    from printrun import gcoder

    controller = start('--null-plant', '--start', '0.5,0.5,199.5')
    dice = random.Random(5)
    moves = [(dice.randrange(1, 8) * 0.05, dice.randrange(1, 6) * 0.05) for _ in range(JOB_LINES)]
    job = ['G28', 'G21', 'G91', *(f'G1 X{x:.2f} Y{y:.2f} F6000' for x, y in moves), 'G4 P0.05']
    received: list[str] = []
    core = printcore.printcore()
    core.recvcb = received.append
    core.connect(str(controller.link), 115200)
    try:
        until(lambda: core.online, 60)
        assert core.startprint(gcoder.LightGCode(job))
        until(lambda: not core.printing, 240)
        x, y = (sum(m[i] for m in moves) for i in (0, 1))

        def arrived() -> bool:
            core.send_now('M114')
            time.sleep(0.1)
            return any(place(line, x, y) for line in received[-5:])

        until(arrived, 120)
    finally:
        core.disconnect()
    resends = sum(line.startswith('Resend') for line in received)
    assert resends == 0
    assert not any(line.startswith('!!') for line in received)


def place(line: str, x: float, y: float) -> bool:
    """Is this the answer to M114 of a machine that stands at x, y (mm)?"""
    match = re.match(r'ok X:([\d.]+) Y:([\d.]+) Z:200 ', line)
    return bool(match) and abs(float(match[1]) - x) < 0.003 and abs(float(match[2]) - y) < 0.003
