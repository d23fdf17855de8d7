"""Lost, doubled and changed bytes on the way to the controller: every line is executed once, in order."""

from __future__ import annotations

import random
import time

import pytest


def spoil(line: bytes, dice: random.Random, share: float) -> bytes:
    """The line as a bad cable delivers it: unchanged, gone, twice, or with bytes changed, lost or doubled."""
    if dice.random() > share:
        return line
    kind = dice.choice(['gone', 'twice', 'change', 'lose', 'double', 'cut'])
    at = dice.randrange(len(line))
    return {
        'gone': b'',
        'twice': line + line,
        'change': line[:at] + bytes([line[at] ^ dice.randrange(1, 128)]) + line[at + 1 :],
        'lose': line[:at] + line[at + 1 :],
        'double': line[:at] + line[at : at + 1] + line[at:],
        'cut': line[:at] + b'\n',
    }[kind]


class Sender:
    """Go-back-N: at most 12 lines under way; starts again after `rs`, an error, or 60 ms without progress."""

    def __init__(self, client, lines: list[str], share: float, seed: int) -> None:
        self.client, self.lines, self.share, self.dice = client, lines, share, random.Random(seed)
        self.first, self.seen = client.accepted + 1, len(client.lines)
        self.next = self.first
        self.progress = time.monotonic()
        self.resends = 0

    def run(self) -> None:
        last, before = self.first + len(self.lines) - 1, 0
        while self.client.accepted < last:
            self._answers()
            if self.client.accepted > before:
                before, self.progress = self.client.accepted, time.monotonic()
            elif time.monotonic() > self.progress + 0.06:
                self.client.raw(b'\n')
                self._again()
            if self.next <= min(last, self.client.accepted + 12):
                line = self.client.sealed(f'N{self.next} {self.lines[self.next - self.first]}')
                self.client.raw(spoil(line, self.dice, self.share))
                self.next += 1
            else:
                time.sleep(0.001)

    def _answers(self) -> None:
        new = self.client.lines[self.seen :]
        self.seen += len(new)
        if any(x.startswith('er') for x in new):
            self.client.ask(f'$L {self.client.accepted + 1}')
        if any(x.startswith(('rs', 'er')) for x in new):
            self._again()

    def _again(self) -> None:
        self.next = self.client.accepted + 1
        self.progress = time.monotonic()
        self.resends += 1


@pytest.mark.parametrize('seed', [1, 2])
def test_every_line_is_executed_once_over_a_bad_cable(client, seed):
    """Relative moves: one line too many, too few or misread would end elsewhere."""
    client.home()
    client.run('G91')
    dice = random.Random(seed)
    moves = [(dice.randrange(1, 40) * 0.1, dice.randrange(1, 20) * 0.1) for _ in range(120)]
    sender = Sender(client, [f'G1 X{x:.1f} Y{y:.1f} F6000' for x, y in moves], 0.2, seed)
    sender.run()
    client.wait(lambda: client.frame['line_executed'] == 122)
    assert sender.resends > 10
    x, y = (sum(m[i] for m in moves) * 1000 for i in (0, 1))
    assert (client.frame['x_um'], client.frame['y_um']) == (
        pytest.approx(x, abs=2),
        pytest.approx(y, abs=2),
    )
    assert {f['fault'] for f in client.frames} == {0}
