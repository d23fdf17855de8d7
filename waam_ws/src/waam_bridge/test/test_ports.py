"""Which serial port is the controller's: pseudo-terminals, the virtual controller, and the rules of udev."""

from __future__ import annotations

import os
import re
import threading
from pathlib import Path

import pytest
import serial
from bridge_harness import VirtualController

from waam_bridge import frames, ports, udev
from waam_bridge.ports import Port, ask, holders
from waam_bridge.transport import RATES

USB = Path(__file__).parents[2] / 'waam_firmware/stm32/usb/src/lib.rs'
IDENTITY = (
    'WAAM_CONTROLLER_V1 fw=9.8.7 boot=1 clk=free blocks=64 rx=4096 lim=0,0,0,400,300,200 spmm=320,320,320 '
    'accel=500,500 off=0,0,0 acc=0 exe=0 cap=A'
)  # fmt: skip


@pytest.fixture
def terminal():
    """Near end and name of a pseudo-terminal."""
    near, far = os.openpty()
    os.set_blocking(near, False)
    name = os.ttyname(far)
    os.close(far)
    yield near, name
    os.close(near)


def test_the_virtual_controller_says_who_it_is(tmp_path):
    controller = VirtualController(tmp_path, '--epoch-us', '1700000000000000')
    try:
        answer = ask(str(controller.path))
        assert (answer.name, answer.rate, answer.problem) == ('WAAM_CONTROLLER_V1', RATES[0], '')
        assert re.fullmatch(r'\d+\.\d+\.\d+', answer.firmware)
        assert ask(str(controller.path)) == answer, 'the question leaves it as it was'
    finally:
        controller.close()


def test_a_controller_that_knows_the_short_check_only(terminal):
    """It does not understand the first question."""
    near, name = terminal
    ended = threading.Event()

    def serve() -> None:
        got = b''
        while not ended.wait(0.01):
            try:
                got += os.read(near, 4096)
            except OSError:
                continue
            if frames.immediate('I', 'keep', 0, frames.CRC16).strip() in got:
                os.write(near, frames.seal(f'$I {IDENTITY}'.encode(), frames.CRC16))
                return

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        answer = ask(name, RATES[:1])
    finally:
        ended.set()
        thread.join()
    assert (answer.firmware, answer.rate) == ('9.8.7', RATES[0])


def test_a_silent_device_and_one_that_babbles_are_no_controllers(terminal):
    near, name = terminal
    os.write(near, b'\xff\x00garbage\n' * 20)
    assert ask(name, RATES[:1]).problem == 'no controller answers'


def test_a_port_that_is_gone_or_held_is_told_and_not_asked(terminal, tmp_path):
    _, name = terminal
    assert 'there is no such port' in ask(str(tmp_path / 'gone')).problem
    process = tmp_path / 'proc/4711'
    (process / 'fd').mkdir(parents=True)
    (process / 'comm').write_text('bridge\n')
    (process / 'fd/7').symlink_to(name)
    (tmp_path / 'proc/12').mkdir()  # one that has ended
    assert holders(name, tmp_path / 'proc') == ('bridge (4711)',)
    assert holders('/dev/ttyNOBODY', tmp_path / 'proc') == ()


def test_a_held_port_is_not_opened_and_its_holder_is_named(terminal, monkeypatch):
    near, name = terminal
    monkeypatch.setattr(ports, 'holders', lambda device: ('bridge (4711)',))
    assert ask(name).problem == 'held by bridge (4711)'
    with pytest.raises(OSError):  # nobody ever had it open, nothing was sent
        os.read(near, 1)


def test_a_port_that_another_program_has_is_told(terminal, monkeypatch):
    monkeypatch.setattr(ports, 'holders', lambda device: ())  # of another user: not to be seen
    with serial.Serial(terminal[1], exclusive=True):
        assert ask(terminal[1]).problem == 'the port is in use by another program'


def test_ports_have_their_lasting_names(tmp_path, monkeypatch):
    class Found:
        device, vid, pid, hwid, description = str(tmp_path / 'ttyACM0'), 0x16C0, 0x27DD, 'USB', 'x'
        serial_number, manufacturer, product = '0031', 'waam', 'WAAM controller'

    (tmp_path / 'ttyACM0').touch()
    (tmp_path / 'by-id').mkdir()
    (tmp_path / 'by-id/usb-waam').symlink_to('../ttyACM0')
    monkeypatch.setattr(ports.list_ports, 'comports', lambda: [Found])
    (tmp_path / 'proc').mkdir()
    (port,) = ports.ports(tmp_path / 'by-id', tmp_path / 'proc')
    assert port.names == (str(tmp_path / 'by-id/usb-waam'),)
    assert (port.vendor, port.serial, port.text) == (0x16C0, '0031', 'waam WAAM controller')


# ---- rules of udev, by udev(7): what may be compared, what may be set

MATCHES = {'ACTION', 'SUBSYSTEM', 'DRIVER', 'ATTR', 'ATTRS', 'ENV', 'TEST', 'KERNEL'}
SETS = {'SYMLINK': {'+='}, 'MODE': {'='}, 'GROUP': {'='}, 'TAG': {'+='}, 'ENV': {'='}, 'ATTR': {'='}}  # fmt: skip
TERM = re.compile(r'([A-Z]+)(?:\{([\w/]+)\})?(==|!=|\+=|:=|=)"((?:[^"\\]|\\.)*)"')


def parsed(text: str) -> list[list[tuple[str, str, str, str]]]:
    """Rules as terms: key, attribute, operator, value. AssertionError for what udev would not take."""
    found = []
    for line in text.splitlines():
        if not line or line.startswith('#'):
            continue
        terms, at = [], 0
        while at < len(line):
            term = TERM.match(line, at)
            assert term, line[at:]
            key, attribute, operator, value = term.groups()
            sets = {k for k, v in SETS.items() if operator in v}
            allowed = MATCHES if operator in ('==', '!=') else sets
            if key == 'TEST':
                assert operator == '=='
            assert key in allowed, term[0]
            assert bool(attribute) == (key in ('ATTR', 'ATTRS', 'ENV')), term[0]
            terms.append((key, attribute or '', operator, value))
            at = term.end()
            assert line[at : at + 2] in ('', ', '), line[at:]
            at += 2
        kinds = [operator in ('==', '!=') for _, _, operator, _ in terms]
        assert any(kinds) and not all(kinds), f'a rule compares and sets: {line}'
        found.append(terms)
    return found


def test_the_parser_of_this_test_refuses_what_udev_would():
    for wrong in ('SUBSYSTEM="tty", MODE="0660"', 'SUBSYSTEM=="tty" MODE="0660"', 'FOO=="x", MODE="1"',
                  'SUBSYSTEM=="tty", MODE=0660', 'ATTRS=="x", MODE="1"', 'MODE="0660"'):  # fmt: skip
        with pytest.raises(AssertionError):
            parsed(wrong)


def test_rules_name_the_port_give_rights_and_keep_others_away():
    port = Port('/dev/ttyUSB0', vendor=0x0403, product=0x6001, serial='A9XY', text='FTDI\nUART')
    rules = parsed(udev.rules(port))
    ttys = [r for r in rules if ('SUBSYSTEM', '', '==', 'tty') in r]
    assert len(ttys) == 3
    for rule in ttys:
        assert ('MODE', '', '=', '0660') in rule and ('GROUP', '', '=', 'dialout') in rule
        assert ('ENV', 'ID_MM_DEVICE_IGNORE', '=', '1') in rule
        assert any(key == 'SYMLINK' for key, *_ in rule)
    mine = ttys[-1]
    assert ('ATTRS', 'serial', '==', 'A9XY') in mine and ('ATTRS', 'idVendor', '==', '0403') in mine
    assert ('SYMLINK', '', '+=', 'waam serial/by-id/waam') in mine
    assert any(('ATTR', 'latency_timer', '=', '1') in r for r in rules)
    assert len(parsed(udev.rules())) == len(rules) - 2


def test_the_rules_are_for_the_usb_id_of_our_board():
    vendor, product, maker = udev.BOARD
    source = USB.read_text()
    assert f'UsbVidPid(0x{vendor}, 0x{product})' in source and f'.manufacturer("{maker}")' in source


@pytest.mark.parametrize(
    ('port', 'said'),
    [
        (Port('/dev/ttyS0'), 'is no USB device'),
        (Port('/dev/ttyUSB0', vendor=0x1A86, product=0x7523, text='CH340'), 'has no serial number'),
        (Port('/dev/ttyUSB0', vendor=1, product=1, serial='a", RUN+="x'), 'cannot stand in a rule'),
    ],
)  # fmt: skip
def test_a_port_that_cannot_be_told_from_others_gets_no_rule(port, said):
    with pytest.raises(ValueError, match=said):
        udev.rules(port)
