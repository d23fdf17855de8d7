"""Reads recordings: what is in them, and whether every byte is whole."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema

from waam_process.safe_files import FileError, is_file, parse_yaml, read_mapping

from .bag_check import FileCheck, check_metadata
from .bag_writer import BagError
from .salvage import BROKEN, Damage, messages, records


@dataclass
class TopicSummary:
    """type, messages written, lost before they arrived (`lost`), dropped by the recorder
    (`dropped`)."""

    type: str
    messages: int = 0
    lost: int = 0
    dropped: int = 0


@dataclass
class Info:
    """A recording in numbers; times in ns of log time."""

    files: list[Path]
    topics: dict[str, TopicSummary] = field(default_factory=dict)
    first_ns: int = 0
    last_ns: int = 0
    bytes: int = 0
    custom_data: dict[str, str] = field(default_factory=dict)
    broken: list[str] = field(default_factory=list)

    @property
    def messages(self) -> int:
        """Of all topics together."""
        return sum(t.messages for t in self.topics.values())

    @property
    def duration_s(self) -> float:
        """From the first to the last message."""
        return (self.last_ns - self.first_ns) * 1e-9


@dataclass
class Check:
    """Result of `check`: messages found in chunks whose checksums are right, and what is wrong
    (empty = sound)."""

    messages: int = 0
    problems: list[str] = field(default_factory=list)

    @property
    def sound(self) -> bool:
        """Nothing is wrong."""
        return not self.problems


def bag_files(path: Path) -> list[Path]:
    """The .mcap files of a recording directory, in order, or the file itself. Raises BagError."""
    path = Path(path)
    if path.is_file():
        return [path]
    files = sorted(path.glob('*.mcap'), key=lambda f: (len(f.name), f.name))
    if not files:
        raise BagError(f'{path}: no .mcap file there')
    if strange := [f for f in files if not is_file(f)]:
        raise BagError(f'{strange[0]}: a symbolic link, or no regular file')
    return files


def messages_of(path: Path, name: str) -> list[bytes]:
    """Serialised messages of the topic with that last part of its name, in the order of the file; what is damaged is
    left out. Raises BagError when there is no recording."""
    return [
        message.data
        for file in bag_files(path)
        for channel, _, message in messages(file, [])
        if channel.topic.rpartition('/')[2] == name
    ]


def info(path: Path) -> Info:
    """Counts and times. Uses the index of sound files and reads broken ones through to their
    damage."""
    result = Info(bag_files(path))
    told: list[Metadata] = []
    for file in result.files:
        result.bytes += file.stat().st_size
        if not _indexed_info(file, result, told):
            _streamed_info(file, result, told)
    metadata = (path if path.is_dir() else path.parent) / 'metadata.yaml'
    if os.path.lexists(metadata):
        result.custom_data = _stated(metadata)
    else:  # the last record of a file says most; to read one takes a tenth of a second
        found = (custom_data_of(record) for record in reversed(told))
        result.custom_data = next((data for data in found if data), {})
    for key, value in result.custom_data.items():
        kind, _, name = key.partition('.')
        if kind in ('lost', 'dropped') and name in result.topics:
            with suppress(ValueError, TypeError):  # a stranger's word
                setattr(result.topics[name], kind, int(value))
    return result


def _stated(metadata: Path) -> dict[str, str]:
    """custom_data of a metadata.yaml. BagError for a damaged one."""
    try:
        information = read_mapping(metadata).get('rosbag2_bagfile_information') or {}
        return dict(information.get('custom_data') or {})
    except (FileError, AttributeError, TypeError, ValueError) as e:
        raise BagError(
            str(e) if isinstance(e, FileError) else f'{metadata}: damaged ({e})'
        ) from None


def custom_data_of(record: Metadata) -> dict[str, str]:
    """What a file says of itself; {} when the record is of another kind, or damaged."""
    if record.name != 'rosbag2':
        return {}
    try:
        stated = parse_yaml(record.metadata['serialized_metadata'], record.name) or {}
        return dict(stated.get('custom_data') or {})
    except (KeyError, AttributeError, TypeError, ValueError):
        return {}


def _indexed_info(file: Path, result: Info, told: list[Metadata]) -> bool:
    try:
        with open(file, 'rb') as f:
            reader = make_reader(f)
            summary = reader.get_summary()
            told += reader.iter_metadata()
    except BROKEN:
        return False
    if summary is None or summary.statistics is None:
        return False
    for channel in summary.channels.values():
        count = summary.statistics.channel_message_counts.get(channel.id, 0)
        _count(result, channel.topic, summary.schemas[channel.schema_id].name, count)
    if summary.statistics.message_count:
        _times(result, summary.statistics.message_start_time)
        _times(result, summary.statistics.message_end_time)
    return True


def _streamed_info(file: Path, result: Info, told: list[Metadata]) -> None:
    schemas: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    damage: list[str] = []
    for record in records(file):
        if isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Damage):
            damage.append(f'{file}: {record}')
        elif isinstance(record, Metadata):
            told.append(record)
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            _count(result, channel.topic, schemas.get(channel.schema_id, ''), 1)
            _times(result, record.log_time)
    result.broken += damage or [f'{file.name}: no index']


def _count(result: Info, topic: str, type_name: str, count: int) -> None:
    result.topics.setdefault(topic, TopicSummary(type_name)).messages += count


def _times(result: Info, t: int) -> None:
    result.first_ns = t if not result.first_ns else min(result.first_ns, t)
    result.last_ns = max(result.last_ns, t)


def check(path: Path) -> Check:
    """Reads every file from end to end and compares it with its checksums and indexes (`bag_check`), and a folder with
    its metadata.yaml. Raises BagError when there is no recording."""
    result, found = Check(), [FileCheck(file).run() for file in bag_files(path)]
    for file in found:
        result.messages += file.messages
        result.problems += file.problems
    if Path(path).is_dir() and not result.problems:
        result.problems += check_metadata(Path(path), found)
    return result
