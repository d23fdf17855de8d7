"""`waam ports` on the command line."""

from __future__ import annotations

import pytest

from waam_bridge import ports
from waam_bridge.ports import Answer, Port
from waam_bringup import cli

LINK = '/dev/serial/by-id/usb-waam'
BOARD = Port('/dev/ttyACM0', (LINK,), 0x16C0, 0x27DD, '0031', 'waam WAAM controller')
HELD = Port('/dev/ttyUSB0', (), 0x1A86, 0x7523, '', 'CH340', ('bridge (4711)',))


@pytest.fixture
def plugged(monkeypatch):
    """Both ports; returns the devices that were asked."""
    asked: list[str] = []

    def ask(device):
        asked.append(device)
        return Answer(115200, 'WAAM_CONTROLLER_V1', '0.5.0')

    monkeypatch.setattr(ports, 'ports', lambda: [BOARD, HELD])
    monkeypatch.setattr(ports, 'ask', ask)
    return asked


def test_every_port_is_told_and_only_free_ones_are_asked(plugged, capsys):
    assert cli.main(['ports']) == 0
    assert capsys.readouterr().out.splitlines() == [
        '/dev/ttyACM0: WAAM_CONTROLLER_V1, firmware 0.5.0, 115200 Bd',
        '  USB 16c0:27dd, serial 0031: waam WAAM controller',
        '  /dev/serial/by-id/usb-waam',
        '/dev/ttyUSB0: held by bridge (4711); not asked',
        '  USB 1a86:7523, serial none: CH340',
    ]
    assert plugged == ['/dev/ttyACM0']


def test_nothing_is_sent_with_list(plugged, capsys):
    assert cli.main(['ports', '--list']) == 0
    assert plugged == [] and 'not asked' in capsys.readouterr().out


def test_a_port_by_its_lasting_name_and_one_that_is_none(plugged, capsys):
    assert cli.main(['ports', '/dev/serial/by-id/usb-waam']) == 0
    assert plugged == ['/dev/ttyACM0']
    assert cli.main(['ports', '/etc/hostname']) == 2
    assert '/etc/hostname is no serial port' in capsys.readouterr().err


def test_without_a_controller_the_status_says_so(monkeypatch, capsys):
    monkeypatch.setattr(ports, 'ports', list)
    assert cli.main(['ports']) == 1
    assert 'no serial port' in capsys.readouterr().out


def test_the_rules_are_printed_alone_so_that_they_can_be_piped(plugged, capsys):
    assert cli.main(['ports', '--udev', '/dev/ttyACM0']) == 0
    out = capsys.readouterr().out
    assert out.startswith('# ') and 'sudo tee /etc/udev/rules.d/70-waam.rules' in out
    assert 'ATTRS{serial}=="0031"' in out and plugged == []
    assert cli.main(['ports', '--udev', '/dev/ttyUSB0']) == 2
    assert 'has no serial number' in capsys.readouterr().err
