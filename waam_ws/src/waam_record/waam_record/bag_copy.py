"""Recordings read in order of time, and made anew from damaged ones."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema

from waam_process.safe_files import FileError, parse_yaml

from .bag_reader import bag_files, custom_data_of
from .bag_writer import BagError, BagWriter, Topic
from .salvage import BROKEN, Damage, records


@dataclass
class Recovered:
    """What `recover` saved: messages, and every damage that it met."""

    messages: int
    output: Path
    damage: list[str]


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


def messages(files: list[Path]) -> Iterator[tuple[Topic, Message]]:
    """Messages of undamaged files by log time, earlier files first. BagError names a damaged file."""
    yield from heapq.merge(*map(_file_messages, files), key=lambda pair: pair[1].log_time)


def _file_messages(file: Path) -> Iterator[tuple[Topic, Message]]:
    topics: dict[int, Topic] = {}
    with open(file, 'rb') as f:
        try:
            reader = make_reader(f, validate_crcs=True)
            if reader.get_summary() is None:
                raise ValueError('no index')
            for schema, channel, message in reader.iter_messages():
                if schema is None:
                    raise ValueError(f'{channel.topic} has no type')
                if channel.id not in topics:
                    topics[channel.id] = topic_of(channel, schema)
                yield topics[channel.id], message
        except BROKEN as e:
            raise BagError(
                f'{file} is not whole ({type(e).__name__}: {e}); save it first: waam record recover'
            ) from None
