"""Lines of the link: round trips, corruption, fuzz."""

import pytest
from bridge_fake_controller import crc, sealed
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_bridge import frames, parsing

TELEMETRY = (
    'T 7,1700000000000000,1,31,100000,-2000,150000,10000,83000,82000,180000,22000,'
    '120,100,30,1000,1000,480,0,0'
)
GOOD = [
    'ok N12 P30 B2048',
    'rs N13 E101',
    'er N14 E103 C7 unknown word Q',
    TELEMETRY,
    '! HOLD E202 arc lease expired',
    '! IDLE E0',
    '$H 17 123456789',
    '$A ok',
    '$J error E108 not now',
    '$I WAAM_CONTROLLER_V1 fw=0.1.0 boot=99 clk=sync blocks=64 rx=2048 lim=0,0,0,400,300,200 '
    'spmm=319.873,320,640.5 acc=7 exe=5 cap=A,B',
    'D 1700000000000000,3,1,0,15000,14250,-750',
]
IDENTITY = 'W fw=1 boot=1 clk=sync blocks=1 rx=1 lim=0,0,0,1,1,1 spmm={} acc=1 exe=1 cap='


def line(text):
    return sealed(text)[:-1]


def test_the_check_is_crc_16_ccitt_false():
    assert frames.check(b'123456789') == 0x29B1  # the catalogue's check value
    assert frames.queued(3, b'G1 X1') == sealed('N3 G1 X1')


@given(st.binary(max_size=100))
def test_the_fast_check_agrees_with_the_bitwise_one(data):
    assert frames.check(data) == crc(data)


def test_each_line_is_understood():
    got = [parsing.parse(line(text)) for text in GOOD]
    assert got[0] == frames.Ack(12, 30, 2048)
    assert got[1] == frames.Resend(13, 101)
    assert got[2] == frames.LineRefused(14, 103, 7, 'unknown word Q')
    assert got[3].t_us == 1700000000000000 and got[3].y_um == -2000 and got[3].lease_left_ms == 480
    assert got[4] == frames.StateChange(frames.HOLD, 202, 'arc lease expired')
    assert got[5] == frames.StateChange(frames.IDLE, 0, '')
    assert got[6] == frames.Pong(17, 123456789)
    assert got[7] == frames.Answer('A', 0, 'ok')
    assert got[8] == frames.Answer('J', 108, 'not now')
    assert got[9].boot == 99 and got[9].synchronised and got[9].limits_mm[3:] == (400, 300, 200)
    assert got[9].capabilities == ('A', 'B') and got[9].offset_mm is None
    assert got[10] == frames.Standoff(1700000000000000, 3, 1, 0, 15000, 14250, -750)


def test_a_carriage_return_is_accepted():
    assert parsing.parse(line('$D ok') + b'\r') == frames.Answer('D', 0, 'ok')


@given(st.sampled_from(GOOD), st.integers(0, 300), st.integers(0, 255))
def test_a_changed_byte_is_detected(text, place, byte):
    good = line(text)
    place %= len(good)
    bad = good[:place] + bytes([byte]) + good[place + 1 :]
    if bad == good:
        return
    with pytest.raises(frames.FrameError):
        parsing.parse(bad)


@given(st.sampled_from(GOOD), st.integers(0, 300), st.integers(1, 8))
def test_lost_bytes_are_detected(text, place, count):
    good = line(text)
    place %= len(good) - count
    with pytest.raises(frames.FrameError):
        parsing.parse(good[:place] + good[place + count :])


@pytest.mark.parametrize(
    ('text', 'steps'),
    [('320', (320, 320, 320)), ('319.873,320,640.5', (319.873, 320, 640.5))],
)
def test_steps_per_mm_of_new_and_old_firmware(text, steps):
    assert parsing.parse(line(f'$I {IDENTITY.format(text)}')).steps_per_mm == steps


@pytest.mark.parametrize('text', ['', '0,1,1', '1,2', '1,2,3,4', '-1', 'nan,1,1', '1e7,1,1'])
def test_steps_per_mm_that_make_no_sense_are_no_identity(text):
    with pytest.raises(frames.FrameError):
        parsing.parse(line(f'$I {IDENTITY.format(text)}'))


@settings(max_examples=500)
@given(st.binary(max_size=200))
def test_noise_raises_only_the_typed_error(data):
    with pytest.raises(frames.FrameError):
        parsing.parse(data)


@settings(max_examples=500)
@given(
    st.sampled_from(['T ', 'D ', 'ok ', 'rs ', 'er ', '! ', '$I ', '$H ', '$A ', '$', '']),
    st.one_of(
        st.text(st.characters(max_codepoint=255), max_size=60),
        st.lists(st.integers(-(2**70), 2**70), max_size=21).map(lambda v: ','.join(map(str, v))),
        st.just('X fw=1 boot=1 clk=sync blocks=1 rx=1 lim=nan,inf,0,0,0,0 spmm=1 cap='),
        st.text('0123456789.,-einaf', max_size=20).map(IDENTITY.format),
    ),
)
def test_wrong_content_with_a_right_check_raises_only_the_typed_error(start, rest):
    payload = (start + rest).encode('latin-1').replace(b'*', b'')
    try:
        frame = parsing.parse(payload + b'*%05d' % crc(payload))
    except frames.FrameError:
        return
    if isinstance(frame, frames.Telemetry):
        assert 0 <= frame.state <= 3 and 0 <= frame.free_blocks < 65536
        assert all(-(2**31) <= v < 2**32 for i, v in enumerate(frame) if i != 1)
    if isinstance(frame, frames.Standoff):
        assert frame.known in (0, 1) and all(-(2**31) <= v < 2**31 for v in frame[1:])
    if isinstance(frame, frames.Identity):
        assert len(frame.steps_per_mm) == 3 and all(0 < v < 1e6 for v in frame.steps_per_mm)
        assert all(abs(v) < 1e6 for v in frame.limits_mm)


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**63 - 1))
def test_a_heartbeat_carries_its_numbers(token, lease):
    assert frames.heartbeat(token, lease) == sealed(f'$H {token} {lease}')


@pytest.mark.parametrize('text', ['job*1', 'job\n$S', 'jöb', 'x' * 160])
def test_text_that_cannot_travel_is_refused(text):
    with pytest.raises(frames.FrameError):
        frames.immediate('A', text)
