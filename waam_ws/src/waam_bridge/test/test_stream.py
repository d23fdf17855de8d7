"""The sender against a controller that loses, repeats and corrupts: everything once and in order."""

import random

from bridge_fake_controller import RUN, FakeCore
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_bridge import frames, parsing
from waam_bridge.stream import Sender


class Channel:
    """Damages whole lines (lost, repeated) and single bytes; never reorders. Real-time bytes do not occur."""

    def __init__(self, seed, loss, repeat, damage):
        self.random = random.Random(seed)
        self.rates = loss, repeat, damage

    def __call__(self, data):
        loss, repeat, damage = self.rates
        out = b''
        for line in data.splitlines(keepends=True):
            r = self.random.random()
            if r < loss:
                continue
            if self.random.random() < damage:
                place = self.random.randrange(len(line))
                line = line[:place] + bytes([self.random.randrange(128)]) + line[place + 1 :]
            out += line * (2 if self.random.random() < repeat else 1)
        return out


def hear(sender, line, now, done):
    try:
        frame = parsing.parse(line)
    except frames.FrameError:
        return
    if isinstance(frame, frames.Ack):
        sender.ack(frame.seq, frame.blocks, frame.room, now)
    elif isinstance(frame, frames.Resend):
        sender.resend(frame.expected, now)
    elif isinstance(frame, frames.Telemetry):
        sender.ack(frame.line_accepted, frame.free_blocks, None, now)
        done += sender.executed(frame.line_executed)


def run(sender, core, up, down, lines, steps):
    """Simulates 10 ms steps until all is executed; returns the marks in order and the steps used."""
    for n in range(lines):
        sender.put(b'G1 X%d' % n, n)
    sender.resync(1, core.blocks, core.rx, 0.0)
    done = []
    for step in range(steps):
        now = step * 0.01
        core.feed(up(sender.poll(now)))
        for line in down(core.take()).split(b'\n'):
            hear(sender, line, now, done)
        core.step()
        if len(done) == lines:
            return done, step
    return done, steps


def test_a_clean_channel_sends_each_line_once():
    core, sender = FakeCore(), Sender()
    core.lines_per_step = 4
    done, _ = run(sender, core, bytes, bytes, 200, 300)
    assert done == list(range(200))
    assert sender.resends == 0 and sender.lines_sent == 200 == sender.acknowledged


@settings(max_examples=40, deadline=None)
@given(
    st.integers(0, 2**32),
    st.floats(0, 0.25),
    st.floats(0, 0.2),
    st.floats(0, 0.15),
    st.integers(2, 40),
)
def test_everything_is_executed_once_and_in_order(seed, loss, repeat, damage, blocks):
    core, sender = FakeCore(blocks=blocks), Sender()
    core.lines_per_step = 3
    up, down = Channel(seed, loss, repeat, damage), Channel(seed + 1, loss, repeat, damage)
    done, _ = run(sender, core, up, down, 120, 40000)
    assert core.gcode == [f'G1 X{n}' for n in range(120)]
    assert done == list(range(120))


def test_a_lost_answer_does_not_stall_the_stream():
    core, sender = FakeCore(), Sender()

    def no_answers(data):
        return b''.join(x for x in data.splitlines(keepends=True) if x.startswith(b'T'))

    done, steps = run(sender, core, bytes, no_answers, 60, 2000)
    assert done == list(range(60)) and steps < 300


def test_the_window_respects_blocks_and_bytes():
    sender = Sender()
    for n in range(50):
        sender.put(b'G1 X%d.123 Y4.567' % n)
    sender.resync(1, 20, 500, 0.0)
    first = sender.poll(0.0)
    assert len(first) <= 500 and 0 < first.count(b'\n') <= 20
    assert sender.poll(0.0) == b''
    sender.ack(3, 2, 4000, 0.01)
    assert sender.in_flight <= max(2, first.count(b'\n') - 3)
    sender.ack(first.count(b'\n'), 2, 4000, 0.02)
    assert sender.poll(0.02).count(b'\n') == 2


def test_silence_repeats_the_oldest_line_ever_more_slowly():
    sender = Sender(timeout=0.2)
    sender.put(b'M5')
    sender.resync(1, 8, 2048, 0.0)
    sender.poll(0.0)
    times = [t / 100 for t in range(1, 300) if sender.poll(t / 100)]
    assert 3 <= len(times) <= 5
    assert times[0] > 0.2 and times[2] - times[1] > times[1] - times[0]


def test_a_flood_of_requests_for_one_gap_is_answered_once():
    sender = Sender()
    for n in range(10):
        sender.put(b'G1 X%d' % n)
    sender.resync(1, 10, 2048, 0.0)
    sender.poll(0.0)
    for _ in range(8):
        sender.resend(3, 0.001)
        sender.poll(0.001)
    assert sender.resends == 8  # lines 3 to 10, once each


def test_drop_forgets_lines_and_never_uses_a_number_again():
    core, sender = FakeCore(), Sender()
    core.stuck = True
    for n in range(40):
        sender.put(b'G1 X%d' % n, n)
    sender.resync(1, core.blocks, core.rx, 0.0)
    core.feed(sender.poll(0.0))
    written = sender.written
    assert sender.drop() == 40
    assert sender.next == written + 1 and sender.poll(0.1) == b'' and sender.marks == 0
    sender.ack(5, 3, 2048, 0.1)  # a late answer
    assert sender.put(b'G1 X99', 99) == written + 1
    sender.resync(written + 1, 16, 2048, 0.2)
    assert sender.poll(0.2) == frames.queued(written + 1, b'G1 X99')


def test_after_a_broken_link_accepted_lines_are_not_repeated():
    core, sender = FakeCore(blocks=8), Sender()
    core.stuck, core.state = True, RUN
    for n in range(20):
        sender.put(b'G1 X%d' % n, n)
    sender.resync(1, 8, 2048, 0.0)
    core.feed(sender.poll(0.0))  # eight lines arrive, their answers are lost
    core.take()
    sender.blocked = True
    core.feed(b'')
    sender.resync(core.received + 1, core.free, core.rx, 1.0)
    core.stuck, core.lines_per_step = False, 8
    core.step()
    done = []
    for step in range(100):
        for line in core.take().split(b'\n'):
            hear(sender, line, 1 + step / 100, done)
        core.feed(sender.poll(1 + step / 100))
        core.step()
    assert core.gcode == [f'G1 X{n}' for n in range(20)] and done == list(range(20))
