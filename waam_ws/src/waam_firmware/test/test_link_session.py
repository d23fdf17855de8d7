"""What keeps two hosts, two connections or a bad cable from confusing anybody: tokens, CRC-32, `$I keep`, bursts."""

from __future__ import annotations

import zlib

import pytest


def strong(text: str) -> bytes:
    return text.encode() + b'*%010d\n' % zlib.crc32(text.encode())


def test_every_line_carries_the_clock(client):
    client.identify()
    first = client.stamped
    assert 0 < first <= client.next_frame()['t_us'] + 10_000
    client.ask('$V 1000 1000')
    assert client.stamped >= first


def test_an_answer_repeats_the_token(client):
    client.identify()
    assert client.ask('$V@7 1200 1000') == '$V@7 ok'
    assert client.ask('$V@4294967295 50 1000').startswith('$V@4294967295 error E104')
    assert client.ask('$V@ 1 1').startswith('$? error E103')
    assert client.ask('$V@4294967296 1 1').startswith('$? error E103')
    assert client.ask('$Q@9').startswith('$?@9 error E103')


def test_a_repeated_line_is_answered_and_not_done_again(client):
    client.home()
    for _ in range(3):
        assert client.ask('$J@5 5 0 0 6000') == '$J@5 ok'
    refused = client.ask('$J@6 1 0 0 0')
    assert refused.startswith('$J@6 error E104')
    assert client.ask('$J@6 1 0 0 0').startswith('$J@6 error E104')
    client.wait(lambda: client.frame['x_um'] == 5_000 and client.frame['state'] == 0)
    assert client.ask('$J@8 1 0 0 6000') == '$J@8 ok'  # another token is another jog
    client.wait(lambda: client.frame['x_um'] == 6_000)


def test_identification_forgets_the_tokens_of_another_host(client):
    client.home()
    assert client.ask('$J@5 5 0 0 6000') == '$J@5 ok'
    client.wait(lambda: client.frame['x_um'] == 5_000 and client.frame['state'] == 0)
    client.identify()
    assert client.ask('$J@5 5 0 0 6000') == '$J@5 ok'
    client.wait(lambda: client.frame['x_um'] == 10_000)


def test_a_host_that_uses_crc32_is_held_to_it(client):
    client.home()
    start = len(client.lines)
    client.raw(strong('$I keep'))
    client.wait_line(r'^\$I WAAM', start)
    assert client.ask('$L 2') == '$L ok'
    client.numbered(2, 'G4 P0')  # CRC-16
    assert client.wait_line('^rs', start) == 'rs N2 E100'
    client.raw(strong('N2 G4 P0'))
    client.wait(lambda: client.accepted == 2)
    # only an idle machine starts counting anew
    client.wait(lambda: client.frame['line_executed'] == 2 and client.frame['state'] == 0)
    client.identify()  # CRC-16 again
    client.sequence = client.accepted = 0
    client.run('G4 P0')
    assert client.bad_checks == 0


def test_identification_that_keeps_freezes_the_numbers(client):
    client.home()
    client.ask('$P')
    client.send(*(f'G1 X{i % 2 + 1} F3000 ; text to fill the ring of the link' for i in range(80)))
    client.wait(lambda: client.accepted == 65)  # 15 more wait for a block
    answer = client.ask('$I keep')
    assert ' acc=65 ' in answer and ' exe=1 ' in answer
    client.ask('$R')
    start = len(client.lines)
    client.wait(lambda: client.frame['line_executed'] == 65)
    assert client.frame['line_accepted'] == 65  # those that waited are forgotten
    client.numbered(66, 'G4 P0')
    assert 'E108' in client.wait_line('^er N66', start)
    assert client.ask('$L 65').startswith('$L error E104')  # accepted once, never again
    assert client.ask('$L 66') == '$L ok'
    client.sequence = client.accepted = 65
    client.run('G1 X3')
    assert client.frame['x_um'] == 3_000


@pytest.mark.parametrize('stop', [b'\x82' * 2, b'\x82' * 4, None])
def test_after_a_stop_nothing_under_way_moves_the_machine(client, stop):
    client.home()
    client.send('G1 X100 F1200')
    client.wait(lambda: client.frame['x_um'] > 2_000)
    if stop:
        client.raw(stop)
    else:
        client.ask('$S')
    start = len(client.lines)
    for number in range(3, 8):
        client.numbered(number, 'G1 X200 F6000')
    assert 'E108' in client.wait_line('^er N3', start)
    client.wait(lambda: client.frame['state'] == 0 and client.frame['v_um_s'] == 0)
    stood = client.next_frame()
    assert client.next_frame()['x_um'] == stood['x_um'] < 100_000
    assert sum(x.startswith('er') for x in client.lines[start:]) == 1
    assert client.ask('$L 3') == '$L ok'
    client.sequence = 2
    client.run('G1 X1 F6000')


def test_a_single_real_time_byte_is_noise(client):
    """It spoils its line, which is asked for again; it neither stops nor holds nor resumes anything."""
    client.home()
    client.send('G1 X40 F1200')
    client.wait(lambda: client.frame['x_um'] > 2_000)
    for byte in (0x80, 0x82):
        start = len(client.lines)
        line = bytearray(client.sealed('N3 G4 P0'))
        line[4] = byte
        client.raw(bytes(line))
        assert client.wait_line('^rs', start) == 'rs N3 E100'
    client.run('G4 P0')
    assert client.frame['x_um'] == 40_000 and {f['fault'] for f in client.frames} == {0}
    client.ask('$P')
    client.raw(b'\x81\n')
    client.ask('$V 1000 1000')
    assert client.next_frame()['fault'] == 200


def test_a_burst_acts_once_and_leaves_the_next_line_alone(client):
    client.home()
    client.send('G1 X40 F1200')
    client.wait(lambda: client.frame['x_um'] > 2_000)
    client.raw(b'\x80\x80\x80' + client.sealed('$V 900 1000'))
    client.wait_line('^! HOLD E200')
    client.wait_line(r'^\$V ok')
    assert sum(x.startswith('! HOLD') for x in client.lines) == 1


def test_telemetry_at_1_khz_and_back(client):
    client.identify()
    assert client.ask('$T 1000') == '$T ok'
    start = len(client.frames) + 50
    client.wait(lambda: len(client.frames) > start + 500)
    steps = {
        b['t_us'] - a['t_us']
        for a, b in zip(client.frames[start:], client.frames[start + 1 :], strict=False)
    }
    counts = {
        b['seq'] - a['seq']
        for a, b in zip(client.frames[start:], client.frames[start + 1 :], strict=False)
    }
    assert steps == {1_000} and counts == {1}
    for bad in ('$T 0', '$T 1001', '$T', '$T x'):
        assert ' error E10' in client.ask(bad)
    client.identify()
    start = len(client.frames) + 50
    client.wait(lambda: len(client.frames) > start + 5)
    assert client.frames[-1]['t_us'] - client.frames[-2]['t_us'] == 10_000
