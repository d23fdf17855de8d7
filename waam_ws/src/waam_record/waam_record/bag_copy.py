"""Recordings read in order of time, and made anew from damaged ones."""

from __future__ import annotations

import heapq
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema

from waam_process.safe_files import FileError, parse_yaml

from .bag_reader import bag_files, custom_data_of, info
from .bag_writer import BagError, BagWriter, Topic
from .salvage import BROKEN, Damage, records


@dataclass
class Recovered:
    """What `recover` saved: messages, and every damage that it met."""

    messages: int
    output: Path
    damage: list[str]


@dataclass(frozen=True)
class Selection:
    """Which messages are taken."""

    topics: tuple[str, ...] = ()  # names; empty = all
    include: str = ''  # regular expression that is looked for in topic names; '' = all
    exclude: str = ''  # regular expression; '' = none
    start: float = 0.0  # s after the beginning of the recording
    end: float = float('inf')  # s after the beginning

    def wants(self, topic: str) -> bool:
        """Whether messages of this topic are taken; the times are not looked at."""
        if self.topics and topic not in self.topics:
            return False
        if self.include and not re.search(self.include, topic):
            return False
        return not (self.exclude and re.search(self.exclude, topic))


def recover(path: Path, output: Path) -> Recovered:
    """Writes everything that is whole in a recording (directory or file) as a new, indexed recording, file by file.
    The source stays as it is."""
    files = bag_files(path)
    writer = BagWriter(output, name=Path(output).resolve().name)
    damage: list[str] = []
    seen: dict[tuple[str, str], int] = {}
    for number, file in enumerate(files):
        if number:
            writer.split(repeat=False)
        damage += _salvage(file, writer, seen)
    writer.custom_data['recovered_from'] = Path(path).name
    writer.close()
    return Recovered(writer.messages, Path(output), damage)


def _salvage(file: Path, writer: BagWriter, seen: dict[tuple[str, str], int]) -> list[str]:
    schemas: dict[int, Schema] = {}
    local: dict[int, int] = {}
    damage: list[str] = []
    for record in records(file):
        if isinstance(record, Message):
            topic = local.get(record.channel_id)
            if topic is None:
                damage.append(
                    f'{file}: a message of channel {record.channel_id}, whose name is lost'
                )
                continue
            writer.write(topic, record.log_time, record.publish_time, record.sequence, record.data)
        elif isinstance(record, Damage):
            damage.append(f'{file}: {record}')
        elif isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel) and record.schema_id in schemas:
            key = record.topic, schemas[record.schema_id].name
            if key not in seen:
                seen[key] = writer.add_topic(topic_of(record, schemas[record.schema_id]))
            local[record.id] = seen[key]
        elif isinstance(record, Metadata):
            writer.custom_data.update(custom_data_of(record))
    return damage


def topic_of(channel: Channel, schema: Schema) -> Topic:
    """A topic as another recording keeps it."""
    profiles = _profiles(channel.metadata.get('offered_qos_profiles') or '[]')
    type_hash = channel.metadata.get('topic_type_hash', '')
    latched = bool(profiles) and all(
        p.get('durability') in ('transient_local', 1) for p in profiles
    )
    return Topic(channel.topic, schema.name, schema.data.decode(), type_hash, profiles, latched)


def _profiles(text: str) -> tuple[dict, ...]:
    """Of the publishers; none where the text is damaged."""
    try:
        found = parse_yaml(text, 'offered_qos_profiles')
    except FileError:
        return ()
    return tuple(p for p in found if isinstance(p, dict)) if isinstance(found, list) else ()


def messages(
    files: list[Path], selection: Selection = Selection()
) -> Iterator[tuple[Topic, Message]]:
    """Messages of undamaged files by log time, earlier files first. BagError names a damaged file."""
    start = min((info(f).first_ns for f in files), default=0)
    first = start + round(selection.start * 1e9)
    last = 2**63 - 1 if selection.end == float('inf') else start + round(selection.end * 1e9)
    streams = [_file_messages(f, selection, first, last) for f in files]
    yield from heapq.merge(*streams, key=lambda pair: pair[1].log_time)


def _file_messages(
    file: Path, selection: Selection, first: int, last: int
) -> Iterator[tuple[Topic, Message]]:
    topics: dict[int, Topic] = {}
    with open(file, 'rb') as f:
        try:
            reader = make_reader(f, validate_crcs=True)
            summary = reader.get_summary()
            if summary is None:
                raise ValueError('no index')
            names = [c.topic for c in summary.channels.values() if selection.wants(c.topic)]
            if not names:
                return
            for schema, channel, message in reader.iter_messages(names, first, last + 1):
                if schema is None:
                    raise ValueError(f'{channel.topic} has no type')
                if channel.id not in topics:
                    topics[channel.id] = topic_of(channel, schema)
                yield topics[channel.id], message
        except BROKEN as e:
            raise BagError(
                f'{file} is not whole ({type(e).__name__}: {e}); save it first: waam record recover'
            ) from None


def topics_of(file: Path) -> list[Topic]:
    """Topics of a whole file; empty for a broken one (reading its messages then says so)."""
    try:
        with open(file, 'rb') as f:
            summary = make_reader(f).get_summary()
    except BROKEN:
        return []
    if summary is None:
        return []
    return [topic_of(c, summary.schemas[c.schema_id]) for c in summary.channels.values()]
