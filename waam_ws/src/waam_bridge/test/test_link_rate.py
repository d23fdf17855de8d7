"""The rate of a UART: that of the firmware by default, the one that answers when it is to be found."""

from __future__ import annotations

import os
import re
import termios
import threading
from pathlib import Path

import pytest

from waam_bridge.params import BridgeParams
from waam_bridge.transport import RATES, SerialTransport

FIRMWARE = Path(__file__).parents[2] / 'waam_firmware/stm32/port_serial.c'


class Owner:
    """Gives up every opening but that at `answers` Bd."""

    def __init__(self, port: int, answers: int) -> None:
        self.port, self.answers = port, getattr(termios, f'B{answers}')
        self.tried: list[int] = []
        self.found = threading.Event()
        self.transport: SerialTransport | None = None

    def on_open(self) -> None:
        self.tried.append(termios.tcgetattr(self.port)[5])

    def on_idle(self) -> None:
        if self.tried[-1] == self.answers:
            self.found.set()
        else:
            self.transport.reopen('no valid answer')

    def on_lines(self, lines, read_at) -> None: ...
    def on_close(self, reason) -> None: ...
    def on_crash(self, error) -> None: ...


def tried(baud: int, answers: int) -> list[int]:
    near, far = os.openpty()
    owner = Owner(far, answers)
    transport = SerialTransport(os.ttyname(far), baud, owner, retry=0.01, idle=0.01)
    owner.transport = transport
    transport.start()
    try:
        assert owner.found.wait(10.0)
    finally:
        transport.close()
        os.close(near)
        os.close(far)
    return owner.tried


def test_the_default_is_that_of_the_firmware():
    told = int(re.search(r'#define BAUD (\d+)u', FIRMWARE.read_text())[1])
    assert BridgeParams().baud == told == RATES[0]


@pytest.mark.parametrize('answers', RATES)
def test_the_rate_that_answers_is_found(answers):
    rates = [getattr(termios, f'B{r}') for r in RATES[: RATES.index(answers) + 1]]
    assert tried(0, answers) == rates


def test_a_rate_that_is_given_is_kept():
    assert tried(230400, 230400) == [termios.B230400]
