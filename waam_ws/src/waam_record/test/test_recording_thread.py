"""The queue and its thread: bounded, counted, never further behind than the sync period."""

import os
import signal
import subprocess
import sys
import time

import pytest

from waam_record.bag_copy import recover
from waam_record.bag_reader import check, info
from waam_record.bag_writer import BagWriter, Topic
from waam_record.recording import Limits, Recording

TOPIC = Topic('/blob', 'std_msgs/msg/String', 'string data\n')
DATA = b'\x00\x01\x00\x00\x04\x00\x00\x00abc\x00'


def test_everything_queued_is_written_and_verified(tmp_path):
    recording = Recording(BagWriter(tmp_path / 'record'))
    topic = recording.add_topic(TOPIC)
    for i in range(5000):
        recording.put(topic, 10**18 + i, 10**18, i, DATA)
    recording.stop({'note': 'x'})
    assert recording.wait(10)
    assert recording.error == '' and recording.checked.sound
    assert recording.checked.messages == 5000
    assert info(tmp_path / 'record').custom_data == {'note': 'x'}


def test_overflow_is_counted_per_topic_and_kept_in_the_metadata(tmp_path):
    recording = Recording(BagWriter(tmp_path / 'record'), Limits(queue_bytes=1000))
    topic = recording.add_topic(TOPIC)
    for i in range(20_000):
        recording.put(topic, 10**18 + i, 10**18, i, bytes(500))
    recording.stop({})
    assert recording.wait(10)
    assert recording.dropped[0] > 0
    assert recording.messages + recording.dropped[0] == 20_000
    assert info(tmp_path / 'record').topics['/blob'].dropped == recording.dropped[0]


def test_messages_before_the_first_clock_get_its_time(tmp_path):
    recording = Recording(BagWriter(tmp_path / 'record'))
    topic = recording.add_topic(TOPIC)
    recording.put(topic, 0, 7, 1, DATA)
    recording.put(topic, 5000, 8, 2, DATA)
    recording.stop({})
    assert recording.wait(5)
    found = info(tmp_path / 'record')
    assert (found.first_ns, found.last_ns, found.messages) == (5000, 5000, 2)


def test_size_limit_starts_the_next_file(tmp_path):
    limits = Limits(sync_s=0.05, file_bytes=20_000)
    recording = Recording(BagWriter(tmp_path / 'record'), limits)
    topic = recording.add_topic(TOPIC)
    end = time.monotonic() + 5
    while len(recording.writer.files) < 3 and time.monotonic() < end:
        recording.put(topic, 10**18, 10**18, 1, DATA[:4] + os.urandom(2000))
        time.sleep(0.002)
    recording.stop({})
    assert recording.wait(5) and len(recording.writer.files) >= 3
    assert check(tmp_path / 'record').messages == recording.messages


def test_full_disk_ends_the_recording_properly(tmp_path):
    recording = Recording(BagWriter(tmp_path / 'record'), Limits(sync_s=0.05, free_bytes=1 << 62))
    topic = recording.add_topic(TOPIC)
    recording.put(topic, 1, 1, 1, DATA)
    assert recording.wait(5)
    assert 'free on the disk' in recording.error
    recording.put(topic, 2, 2, 2, DATA)
    assert recording.dropped == [1]
    assert check(tmp_path / 'record').sound


KILLED = """
import sys, time
from pathlib import Path
from waam_record.bag_writer import BagWriter, Topic
from waam_record.recording import Recording
r = Recording(BagWriter(Path(sys.argv[1])))
t = r.add_topic(Topic('/blob', 'std_msgs/msg/String', 'string data\\n'))
i = 0
while True:
    for _ in range(20):
        r.put(t, time.time_ns(), time.time_ns(), i, b'\\x00\\x01\\x00\\x00\\x04\\x00\\x00\\x00abc\\x00')
        i += 1
    print(time.time_ns(), i, flush=True)
    time.sleep(0.01)
"""


def test_kill_9_loses_at_most_about_a_second(tmp_path):
    command = [sys.executable, '-c', KILLED, str(tmp_path / 'record')]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    times: list[int] = []
    try:
        for line in process.stdout:
            last_ns, sent = map(int, line.split())
            times.append(last_ns)
            if last_ns - times[0] > 2.6e9:
                break
    finally:
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    saved = recover(tmp_path / 'record', tmp_path / 'saved')
    found = info(tmp_path / 'saved')
    assert 0 < saved.messages <= sent + 20
    assert (last_ns - found.last_ns) * 1e-9 < 1.3


@pytest.mark.parametrize('keys', [{}, {'lost': '3', 'lost./blob': '3'}])
def test_losses_of_the_graph_appear_in_info(tmp_path, keys):
    recording = Recording(BagWriter(tmp_path / 'record'))
    topic = recording.add_topic(TOPIC)
    recording.put(topic, 1, 1, 1, DATA)
    recording.stop(keys)
    assert recording.wait(5)
    assert info(tmp_path / 'record').topics['/blob'].lost == int(keys.get('lost', 0))


def test_a_disk_that_needs_longer_than_the_period_of_syncs_gets_everything(tmp_path, monkeypatch):
    """The next sync was due before the last one had ended: nothing was ever written."""
    monkeypatch.setattr('os.fsync', lambda _: time.sleep(0.05))
    recording = Recording(BagWriter(tmp_path / 'record'), Limits(sync_s=0.02))
    topic = recording.add_topic(TOPIC)
    for i in range(200):
        recording.put(topic, 10**18 + i, 10**18, i, DATA)
        time.sleep(0.002)
    recording.stop({})
    assert recording.wait(30)
    assert recording.checked.sound and recording.checked.messages == 200
