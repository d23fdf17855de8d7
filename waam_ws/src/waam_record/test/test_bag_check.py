"""`check` finds every changed byte of a recording; `recover` says what it saved."""

from __future__ import annotations

import random
import shutil
import struct
import zlib
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mcap.writer import IndexType, Writer

from waam_record.bag_check import FileCheck
from waam_record.bag_reader import check
from waam_record.bag_writer import BagError, BagWriter, Topic
from waam_record.cli import register
from waam_record.salvage import HEAD, MAGIC

TOPIC = Topic('/a', 'std_msgs/msg/String', 'string data\n')
OTHER = Topic('/b', 'std_msgs/msg/String', 'string data\n')


def write(folder: Path, compression: str = 'none') -> Path:
    rng = random.Random(3)
    writer = BagWriter(folder, {'wire': 'x'}, compression=compression)
    topics = [writer.add_topic(TOPIC), writer.add_topic(OTHER)]
    for i in range(10):
        writer.write(topics[i % 3 == 0], 1000 + i, 900 + i, i, b'\0\1\0\0' + rng.randbytes(8))
        if i % 5 == 4:
            writer.flush(sync=False)
    writer.close()
    return next(folder.glob('*.mcap'))


def test_every_changed_byte_of_a_record_is_found(tmp_path):
    """Without exception: the checksums of chunks, data section and summary cover the whole file but three marks."""
    file = write(tmp_path / 'record', 'zstd')
    assert check(tmp_path / 'record').sound
    whole = file.read_bytes()
    missed = []
    for at in range(len(whole)):
        changed = bytearray(whole)
        changed[at] ^= 1 << at % 8
        file.write_bytes(changed)
        if not FileCheck(file).run().problems:
            missed.append(at)
    assert not missed


@pytest.mark.parametrize('share', [0.0, 0.1, 0.5, 0.9, 0.99])
def test_a_cut_file_and_one_with_more_behind_it_are_found(share, tmp_path):
    file = write(tmp_path / 'record')
    whole = file.read_bytes()
    file.write_bytes(whole[: int(share * len(whole))])
    assert not check(file).sound
    file.write_bytes(whole + b'\0')
    assert not check(file).sound


def rewritten(file: Path, opcode: int, change) -> bool:
    """Changes the content of the first record of a kind, and puts all checksums right again: only comparisons are left.
    False when there is none."""
    whole = bytearray(file.read_bytes())
    at = len(MAGIC)
    data_end = footer = hit = None
    while at < len(whole) - len(MAGIC):
        code, length = HEAD.unpack_from(whole, at)
        body = at + HEAD.size
        if code == opcode and hit is None:
            content = change(bytes(whole[body : body + length]))
            assert len(content) == length
            whole[body : body + length], hit = content, at
        data_end = at if code == 15 else data_end
        footer = at if code == 2 else footer
        at = body + length
    body = data_end + HEAD.size
    whole[body : body + 4] = struct.pack('<I', zlib.crc32(whole[:data_end]))
    end = footer + HEAD.size + 16
    whole[end : end + 4] = struct.pack('<I', zlib.crc32(whole[body + 4 : end]))
    file.write_bytes(whole)
    return hit is not None


def number(at: int, kind: str, to):
    def change(content: bytes) -> bytes:
        (value,) = struct.unpack_from(kind, content, at % len(content))
        changed = bytearray(content)
        struct.pack_into(kind, changed, at % len(content), to(value))
        return bytes(changed)

    return change


PLUS = {
    'chunk: size': (6, number(16, '<Q', lambda v: v + 1)),
    'chunk: bomb': (6, number(16, '<Q', lambda v: 1 << 60)),
    'statistics: messages': (11, number(0, '<Q', lambda v: v + 1)),
    'statistics: messages of a channel': (11, number(-8, '<Q', lambda v: v + 1)),
    'footer: summary': (2, number(0, '<Q', lambda v: v + 1)),
}  # fmt: skip


@pytest.mark.parametrize('case', PLUS)
def test_what_does_not_fit_is_found_without_checksums(case, tmp_path):
    file = write(tmp_path / 'record')
    assert rewritten(file, 1, lambda content: content) and check(file).sound
    opcode, change = PLUS[case]
    assert rewritten(file, opcode, change)
    assert not check(file).sound


def test_files_of_others_are_sound(tmp_path):
    """Attachments, no checksums, no index, unknown records from 0x80 on."""
    for name, options in {
        'plain': {}, 'no crc': {'enable_crcs': False}, 'no chunks': {'use_chunking': False},
        'no offsets': {'use_summary_offsets': False}, 'no index': {'index_types': IndexType.NONE},
        'no repeats': {'repeat_channels': False, 'repeat_schemas': False},
    }.items():  # fmt: skip
        file = tmp_path / f'{name}.mcap'
        with open(file, 'wb') as f:
            writer = Writer(f, **options)
            writer.start('ros2', 'x')
            schema = writer.register_schema('a', 'ros2msg', b'string data')
            channels = [writer.register_channel(t, 'cdr', schema) for t in ['/a', '/b']]
            writer.add_attachment(1, 2, 'photo', 'image/png', b'123')
            for i in range(20):
                writer.add_message(channels[i % 2], 100 - i, b'1234', 5, i)
            writer.finish()
        found = check(file)
        assert found.sound and found.messages == 20, (name, found.problems)
    with open(tmp_path / 'plain.mcap', 'rb') as f:
        assert make_reader(f).get_summary().statistics.message_count == 20


@pytest.mark.parametrize(
    'change',
    [
        lambda t: t.replace('message_count: 10', 'message_count: 11', 1),
        lambda t: t.replace('record_0.mcap', 'record_1.mcap', 1),
        lambda t: t[: len(t) // 2],
        lambda t: t.replace('message_count: 4', 'message_count: 5'),
        lambda t: '[' * 100_000,
    ],
)
def test_metadata_that_says_something_else_is_found(change, tmp_path):
    write(tmp_path / 'record')
    file = tmp_path / 'record' / 'metadata.yaml'
    text = file.read_text()
    assert change(text) != text
    file.write_text(change(text))
    assert 'metadata.yaml' in check(tmp_path / 'record').problems[0]


# ---- recover


def waam(*arguments) -> int:
    import argparse

    parser = argparse.ArgumentParser()
    register(parser.add_subparsers())
    args = parser.parse_args(['record', *map(str, arguments)])
    return args.run_command(args)


@pytest.mark.parametrize('content', [b'', bytes(5000), b'no recording\n' * 50, MAGIC, b'\xff' * 99])
def test_where_nothing_can_be_saved_recover_says_so_and_fails(content, tmp_path, capsys):
    file = tmp_path / 'a.mcap'
    file.write_bytes(content)
    assert waam('recover', file, '-o', tmp_path / 'saved') == 1
    out = capsys.readouterr()
    assert 'nothing can be recovered' in out.err and 'a.mcap' in out.err and not out.out
    assert not (tmp_path / 'saved').exists()
    assert waam('check', file) == 1


def test_what_was_saved_of_a_cut_file_is_counted(tmp_path, capsys):
    file = write(tmp_path / 'record')
    file.write_bytes(file.read_bytes()[: int(0.5 * file.stat().st_size)])
    assert waam('recover', file, '-o', tmp_path / 'saved') == 0
    out = capsys.readouterr()
    assert out.out.split()[0].isdigit() and 'messages saved' in out.out and 'note:' in out.err
    assert check(tmp_path / 'saved').sound


def test_a_link_in_the_place_of_a_recording_is_refused(tmp_path):
    file = write(tmp_path / 'record')
    shutil.move(file, tmp_path / 'elsewhere.mcap')
    file.symlink_to(tmp_path / 'elsewhere.mcap')
    with pytest.raises(BagError, match='symbolic link'):
        check(tmp_path / 'record')
