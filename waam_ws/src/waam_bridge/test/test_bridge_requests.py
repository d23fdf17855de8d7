"""Immediate lines, tokens, overrides, silent nodes, and what happens when the two ends disagree."""

import math

import pytest
from bridge_cell import Cell, line_of
from bridge_fake_controller import HOLD, RUN, sealed

from waam_bridge import commands, frames, outbox, overrides, parsing, program, requests
from waam_bridge.requests import Requests


class Host:
    """Requests and what became of them."""

    def __init__(self):
        self.requests = Requests()
        self.got = []

    def ask(self, letter, args='', now=0.0):
        return self.requests.ask(letter, args, lambda *r: self.got.append((letter, *r)), now)

    def hear(self, text):
        return self.requests.answer(parsing.parse(sealed(text)[:-1]))


def token_of(line):
    return int(line.split(b'@')[1].split(b' ')[0].split(b'*')[0])


def test_a_late_answer_is_not_taken_for_a_new_one():
    """The first override timed out; its answer comes when the second one waits."""
    host = Host()
    first = token_of(host.ask('J', '1 0 0 600', 0.0))
    host.requests.poll(requests.LIMIT + 0.1)
    assert host.got == [('J', requests.TIMEOUT, 'the controller did not answer $J within 1 s')]
    second = token_of(host.ask('J', '2 0 0 600', 2.0))
    assert second != first
    assert not host.hear(f'$J@{first} ok') and not host.hear('$J ok') and len(host.got) == 1
    assert host.hear(f'$J@{second} error E108 not now @77') and host.got[-1][1] == requests.REFUSED
    assert not host.hear(f'$J@{second} ok')


def test_an_unknown_command_is_told_to_who_asked():
    host = Host()
    token = token_of(host.ask('Z', '1 2 3'))
    assert host.hear(f'$?@{token} error E103 not a command')
    assert host.got == [('Z', requests.REFUSED, 'controller: E103 not a command')]


def test_repetitions_carry_the_same_token():
    host = Host()
    line = host.ask('P')
    assert host.requests.poll(0.01) == b''
    assert host.requests.poll(0.04) == line == host.requests.poll(0.08)
    slow = host.ask('A', 'job', 0.08)
    assert slow not in host.requests.poll(0.15) and slow in host.requests.poll(0.2)


def test_a_jog_whose_answer_is_lost_is_done_once():
    cell = Cell().ready()
    say, lost = cell.fake.say, []

    def lose_two(text):
        if text.startswith('$J') and len(lost) < 2:
            lost.append(text)
        else:
            say(text)

    cell.fake.say = lose_two
    assert cell.command(commands.JOG, vector=(0.01, 0.0, 0.0), value=0.02)[0] == requests.OK
    assert len(lost) == 2 and lost[0].split()[0] == lost[1].split()[0]
    assert cell.fake.position[0] == 10_000


def test_the_newest_override_holds_whatever_is_lost():
    """The first one is lost and must not be repeated after the second one."""
    cell = Cell().ready()
    cell.fake.mute.add('V')
    overrides.operator(cell.bridge, 1.5, math.nan, 'panel', cell.now)
    cell.step()
    cell.fake.mute.clear()
    overrides.operator(cell.bridge, 0.8, math.nan, 'panel', cell.now)
    cell.step(40)
    assert cell.fake.speed == 800
    assert [s for s in cell.fake.seen if s.startswith('$V')][-1] == '$V 800 1000'
    assert cell.notices == []


@pytest.mark.parametrize('digits', [frames.CRC16, frames.CRC32])
def test_lines_are_sealed_as_the_controller_understands(digits):
    cell = Cell()
    feed = cell.fake.feed
    if digits == frames.CRC16:  # one that does not know the CRC-32
        cell.fake._line = lambda line, known=cell.fake._line: (
            cell.fake.resend(100) if len(line.rpartition(b'*')[2]) == 10 else known(line)
        )
    cell.fake.feed = feed
    cell.ready()
    cell.fake.checks.clear()
    cell.enqueue(line_of(5))
    cell.until(lambda: len(cell.done) == 5)
    assert cell.fake.checks == {digits}


def test_the_telemetry_rate_is_asked_for_on_every_connection():
    assert not any(s.startswith('$T') for s in Cell().ready().fake.seen)
    cell = Cell(telemetry_rate=1000.0).ready()
    cell.step(2)
    assert cell.fake.rate == 1000
    cell.unplug()
    cell.fake.rate = 100  # `$I` sets it back
    cell.plug()
    cell.until(lambda: cell.fake.rate == 1000)


def test_arming_a_job_does_not_call_nodes_silent_that_have_had_no_time():
    """Before ARM simulated time may run ahead of the nodes; the lease is withheld at once, the warning waits."""
    cell = Cell().ready()
    cell.nodes = ['a']
    cell.step(30)
    cell.nodes = []
    cell.step(60)  # 'a' is 0.6 s behind
    assert cell.command(commands.ARM, 'j', ('a',))[0] == 0
    cell.step(10)
    assert cell.bridge.silent == [] and cell.notices == []
    assert cell.fake.beats[-1][1] < cell.fake.t_us - 500_000
    cell.nodes = ['a']
    cell.step(60)
    assert cell.bridge.silent == [] and cell.notices == []
    cell.nodes = []
    cell.step(60)
    assert cell.bridge.silent == ['a'] and len(cell.notices) == 1


def test_when_the_lease_expires_whoever_is_behind_is_named_at_once():
    cell = Cell().ready()
    cell.nodes = ['a']
    cell.step(20)
    assert cell.command(commands.ARM, 'j', ('a', 'b'))[0] == 0
    cell.fake.go(HOLD, 202, 'the arc lease expired')
    cell.step()
    assert cell.bridge.silent == ['b']
    assert '(silent: b)' in cell.notices[-1].text


def test_lines_that_were_acknowledged_and_are_missing_stop_the_machine():
    """A damaged `ok` that passed its check would skip metal: nothing more is sent, and an operator hears why."""
    cell = Cell().ready()
    cell.fake.stuck = True
    cell.enqueue(line_of(40))
    cell.step(5)
    cell.fake.state = RUN
    sender = cell.bridge.link.sender
    for _ in range(3):
        sender.put(b'G1 X99')
    sender.resync(sender.acked + 1, 16, 2048, cell.now)
    sender.poll(cell.now)  # written, but never fed
    sender.ack(sender.written, 10, 2048, cell.now)
    cell.step(5)
    assert cell.fake.state == HOLD
    assert 'were acknowledged' in cell.bridge.message
    assert [n.severity for n in cell.notices if 'acknowledged' in n.text] == [outbox.FAULT]
    assert cell.refused(line_of(1, first=40, x0=0.04))[0] == program.WRONG_STATE
    cell.fake.stuck = False
    assert cell.command(commands.STOP)[0] == 0
    cell.step(5)
    cell.until(lambda: cell.bridge.queued == 0)
    assert cell.bridge.broken == ''
    assert cell.enqueue(line_of(40)[len(cell.done) :]).accepted
