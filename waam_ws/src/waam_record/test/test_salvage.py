"""Broken files: everything before a cut comes out, exactly; a damaged chunk costs itself only; nothing crashes."""

import os
import random

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from waam_record.bag_copy import recover
from waam_record.bag_reader import check, info
from waam_record.bag_writer import BagWriter, Topic
from waam_record.salvage import Damage, records

TOPIC = Topic('/blob', 'std_msgs/msg/String', 'string data\n')
LATCHED = Topic('/held', 'std_msgs/msg/String', 'string data\n', latched=True)


def write(folder, messages=400, compression='zstd', flush_every=20):
    rng = random.Random(1)
    writer = BagWriter(folder, {'wire': 'G3Si1'}, compression=compression)
    topics = [writer.add_topic(TOPIC), writer.add_topic(LATCHED)]
    for i in range(messages):
        data = b'\0\1\0\0' + rng.randbytes(rng.randrange(40, 400))
        writer.write(topics[i % 7 == 0], 10**18 + i * 10**6, 10**18 + i, i, data)
        if i % flush_every == flush_every - 1:
            writer.flush(sync=False)
    writer.close()
    return next(folder.glob('*.mcap'))


def facts(message: Message, channels: dict[int, str]) -> tuple:
    topic = channels[message.channel_id]
    return topic, message.log_time, message.publish_time, message.sequence, bytes(message.data)


def read(path) -> tuple[list[tuple], list[Damage]]:
    channels, found, damage = {}, [], []
    for item in records(path):
        if isinstance(item, Channel):
            channels[item.id] = item.topic
        elif isinstance(item, Message):
            found.append(facts(item, channels))
        elif isinstance(item, Damage):
            damage.append(item)
    return found, damage


def chunk_ends(path) -> list[tuple[int, int]]:
    """(position behind a chunk, messages up to there): what the index of the file says."""
    with open(path, 'rb') as f:
        summary = make_reader(f).get_summary()
    ends = []
    for number, index in enumerate(
        sorted(summary.chunk_indexes, key=lambda c: c.chunk_start_offset)
    ):
        ends.append((index.chunk_start_offset + index.chunk_length, 20 * (number + 1)))
    assert ends[-1][1] == summary.statistics.message_count
    return ends


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_a_whole_file_is_read_as_the_library_reads_it(tmp_path, compression):
    path = write(tmp_path / 'record', compression=compression)
    found, damage = read(path)
    assert not damage
    channels, wanted = {}, []
    with open(path, 'rb') as f:
        for item in StreamReader(f, validate_crcs=True).records:
            if isinstance(item, Channel):
                channels[item.id] = item.topic
            elif isinstance(item, Message):
                wanted.append(facts(item, channels))
    assert found == wanted and len(found) == 400


@pytest.mark.parametrize('compression', ['zstd', 'lz4', 'none'])
def test_cut_at_200_random_bytes(tmp_path, compression):
    """What comes out is a beginning of the original, and all chunks before the cut are in it."""
    path = write(tmp_path / 'record', compression=compression)
    whole = path.read_bytes()
    original, _ = read(path)
    ends = chunk_ends(path)
    cut_file = tmp_path / 'cut_0.mcap'
    rng = random.Random(7)
    for cut in [0, 1, 8, len(whole) - 1, *(rng.randrange(len(whole)) for _ in range(196))]:
        cut_file.write_bytes(whole[:cut])
        found, damage = read(cut_file)
        assert damage, cut
        assert found == original[: len(found)], cut
        complete = max((n for end, n in ends if end <= cut), default=0)
        assert len(found) >= complete, cut


@pytest.mark.parametrize('share', [0.03, 0.3, 0.62, 0.9, 0.999])
def test_recover_writes_exactly_what_is_whole(tmp_path, share):
    path = write(tmp_path / 'record')
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    wanted, _ = read(path)
    assert not check(path).sound and info(path).broken and info(path).messages == len(wanted)
    saved = recover(tmp_path / 'record', tmp_path / 'saved')
    found, damage = read(tmp_path / 'saved/saved_0.mcap')
    assert not damage and found == wanted and saved.messages == len(wanted)
    assert check(tmp_path / 'saved').sound
    assert info(tmp_path / 'saved').custom_data['wire'] == 'G3Si1'


def test_a_damaged_chunk_costs_itself_only(tmp_path):
    path = write(tmp_path / 'record')
    original, _ = read(path)
    data = bytearray(path.read_bytes())
    data[chunk_ends(path)[4][0] - 300] ^= 0xFF  # inside the fifth chunk
    path.write_bytes(data)
    found, damage = read(path)
    assert len(damage) == 1
    assert found == original[:80] + original[100:]
    saved = recover(tmp_path / 'record', tmp_path / 'saved')
    assert saved.messages == 380 and 'record_0.mcap' in saved.damage[0]


def test_several_files_are_saved_one_by_one_without_doubles(tmp_path):
    writer = BagWriter(tmp_path / 'record')
    held, blob = writer.add_topic(LATCHED), writer.add_topic(TOPIC)
    writer.write(held, 1, 1, 1, b'\0\1\0\0held')
    for part in range(3):
        for i in range(5):
            writer.write(blob, 10 * part + i + 1, 1, 5 * part + i, b'\0\1\0\0' + os.urandom(30))
        if part < 2:
            writer.split()
    writer.close()
    saved = recover(tmp_path / 'record', tmp_path / 'saved')
    assert saved.messages == 15 + 3 and not saved.damage
    for n in range(3):
        one, other = (tmp_path / f'{name}/{name}_{n}.mcap' for name in ('record', 'saved'))
        assert read(one) == read(other)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.binary(max_size=400), keep=st.floats(0, 1), at=st.floats(0, 1))
def test_no_bytes_make_it_crash(tmp_path, data, keep, at):
    """Rubbish in the middle or at the end of a file."""
    source = tmp_path / 'fuzz'
    if not source.exists():
        write(source, messages=60, flush_every=10)
    whole = next(source.glob('*.mcap')).read_bytes()
    head, tail = int(len(whole) * keep), int(len(whole) * at)
    broken = tmp_path / 'broken_0.mcap'
    broken.write_bytes(whole[:head] + data + whole[tail:])
    found, _ = read_loosely(broken)
    assert found <= 120
    assert info(broken).messages >= 0
    check(broken)


def read_loosely(path) -> tuple[int, int]:
    kinds = [isinstance(item, Message) for item in records(path)]
    return sum(kinds), len(kinds)
