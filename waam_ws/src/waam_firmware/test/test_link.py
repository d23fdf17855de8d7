"""The link: identification, checks, sequence, errors, flow control (docs/link_protocol.md)."""

from __future__ import annotations

import re

import pytest


def test_identification(client):
    answer = client.identify()
    name, *fields = answer.removeprefix('$I ').split()
    values = dict(f.split('=', 1) for f in fields)
    assert name == 'WAAM_CONTROLLER_V1'
    assert values['clk'] == 'free' and values['spmm'] == '320,320,320' and values['rx'] == '2048'
    assert values['lim'] == '0,0,0,400,300,200'
    assert int(values['blocks']) >= 32
    assert 0 <= int(values['boot']) < 2**32


def test_boot_id_changes_and_clock_is_declared(start):
    answers = [start('--epoch-us', '1700000000000000').connect().identify() for _ in range(2)]
    assert answers[0].split(' boot=')[1] != answers[1].split(' boot=')[1]
    assert all(' clk=sync ' in a for a in answers)


def test_epoch_is_the_start_of_the_clock(start):
    client = start('--epoch-us', '1700000000000000').connect()
    assert 0 <= client.next_frame()['t_us'] - 1700000000000000 < 10_000_000


def test_telemetry_is_complete_and_at_100_hz(client):
    client.wait(lambda: len(client.frames) > 300)
    steps = [b['t_us'] - a['t_us'] for a, b in zip(client.frames, client.frames[1:], strict=False)]
    counts = [b['seq'] - a['seq'] for a, b in zip(client.frames, client.frames[1:], strict=False)]
    assert set(steps) == {10_000} and set(counts) == {1}
    assert client.bad_checks == 0


def test_failed_check_asks_for_the_line_once(client):
    client.home()
    client.raw(b'N2 G4 P0*00000\n')
    assert client.wait_line(r'^rs ') == 'rs N2 E100'
    client.run('G4 P0')
    assert client.frame['line_executed'] == 2


def test_lines_without_a_valid_check_are_never_acted_on(client):
    client.home()
    for line in (b'N%d G4 P0\n', b'N%d G4 P0*1234\n', b'*\n', b'N%d*12x\n', b'\x00\xff*1\n'):
        accepted, start = client.accepted, len(client.lines)
        client.raw(line.replace(b'%d', b'%d' % (accepted + 1)))
        assert client.wait_line(r'^rs ', start) == f'rs N{accepted + 1} E100'
        assert client.next_frame()['line_accepted'] == accepted
        client.run('G4 P0')


def test_gap_asks_once_for_all_lines_under_way(client):
    client.home()
    before = len(client.lines)
    client.sequence = 2  # line 2 is lost
    for _ in range(5):
        client.sequence += 1
        client.numbered(client.sequence, 'G4 P0')
    client.ask('$V 1000 1000')
    assert [x for x in client.lines[before:] if x.startswith('rs')] == ['rs N2 E101']
    client.numbered(4, 'G4 P0')  # the host went back, and the line was lost again
    client.wait(lambda: sum(x == 'rs N2 E101' for x in client.lines) == 2)
    client.sequence = 1
    client.run(*['G4 P0'] * 6)


def test_duplicates_are_acknowledged_and_dropped(client):
    client.home()
    client.run('G91', 'G1 X5 F6000')
    before = len(client.lines)
    for _ in range(3):
        client.numbered(3, 'G1 X5 F6000')
    client.wait(lambda: sum(x.startswith('ok N3 ') for x in client.lines[before:]) == 3)
    assert client.next_frame()['x_um'] == 5000


def test_error_stops_acceptance_until_resynchronised(client):
    client.home()
    for number, text in ((2, 'G4 P0'), (3, 'G1 D5'), (4, 'G0 X100'), (5, 'G0 X200')):
        client.numbered(number, text)
    assert client.wait_line('^er') == 'er N3 E103 C7 D is not a word of this controller'
    client.ask('$V 1000 1000')
    frame = client.next_frame()
    assert (frame['line_accepted'], frame['x_um'], frame['state']) == (2, 0, 0)
    assert not any(x.startswith(('ok N4', 'rs')) for x in client.lines)
    assert client.ask('$L 3') == '$L ok'
    client.sequence = 2
    client.run('G0 X10')
    assert client.frame['x_um'] == 10_000


@pytest.mark.parametrize(
    ('gcode', 'code', 'column'),
    [('X5', 107, 4), ('G0 X5 (open', 102, 10), ('M4', 103, 4), ('X12345678901', 104, 4), ('G0 G1 X5', 105, 7)],
)  # fmt: skip
def test_error_names_code_and_column(client, gcode, code, column):
    """Of the line as it was sent, with its number; test_gcode.py has what is refused."""
    client.home()
    client.send(gcode)
    assert client.wait_line('^er').startswith(f'er N2 E{code} C{column} ')


def test_overlong_line_is_refused(client):
    client.home()
    client.numbered(2, '; ' + 'x' * 200)
    assert client.wait_line('^rs') == 'rs N2 E106'


def test_longest_line_is_taken(client):
    client.home()
    line = 'N2 G4 P0 ; ' + 'x' * (160 - 6 - 11)
    assert len(line) == 154
    client.numbered(2, line.removeprefix('N2 '))
    client.wait(lambda: client.accepted == 2)


def test_acknowledgement_waits_for_a_free_block_and_nothing_is_lost(client):
    client.home()
    client.ask('$P')
    client.send(*(f'G1 X{i % 2 * 3 + 1} F2000 ; some text that fills the ring' for i in range(84)))
    client.wait(lambda: client.accepted == 65)
    assert client.wait_line('^ok N65 ') == 'ok N65 P0 B2048'
    start = len(client.lines)
    client.ask('$R')
    client.wait(lambda: client.frame['line_executed'] == 85)
    oks = [x for x in client.lines[start:] if x.startswith('ok')]
    assert [x.split()[1] for x in oks] == [f'N{i}' for i in range(66, 86)]
    assert int(oks[0].split()[3][1:]) < 2048 - 18 * 45 and oks[-1].endswith(' B2048')
    assert not any(x.startswith(('rs', 'er')) for x in client.lines)


def test_refused_immediate_lines(client):
    for line, answer in (
        ('$Q', '$? error E103'), ('$', '$? error E103'), ('$V 50 1000', '$V error E104'),
        ('$V 1000', '$V error E107'), ('$V 1000 1000 1', '$V error E102'), ('$H', '$H error E107'),
        ('$R', '$R error E108'), ('$J 1 1 1 0', '$J error E104'), ('$L 0', '$L error E104'),
        ('$Z 1 2', '$Z error E107'), ('$W 5 1e9', '$W error E102'), ('$Resume', '$? error E103'),
    ):  # fmt: skip
        start = len(client.lines)
        client.text(line)
        client.wait_line('^' + re.escape(answer), start)


def test_heartbeat_answers_with_token_and_time(start):
    client = start('--null-plant').connect(heartbeat=False)
    seen: list[str] = []
    original = client._line

    def spy(line: bytes) -> None:
        if line.startswith(b'$H'):
            seen.append(line.decode())
        original(line)

    client._line = spy
    client.text('$H abc7 0')
    client.wait(lambda: seen)
    _, token, time_us = seen[0].split('*')[0].split()
    assert token == 'abc7' and abs(int(time_us) - client.next_frame()['t_us']) < 1_000_000


def test_reconnecting_host_finds_the_same_boot(controller):
    first = controller.connect()
    answer = first.identify()
    first.raw(b'N1 half a line')
    first.close()
    controller.clients.clear()
    second = controller.connect()
    second.raw(
        b'\n'
    )  # as the bridge does: the half line ends here if the first host was not seen to go
    assert second.identify() == answer
    second.home()
