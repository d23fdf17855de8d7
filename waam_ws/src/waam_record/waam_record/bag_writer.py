"""Writes a rosbag2-compatible MCAP recording: a directory with `<name>_0.mcap`, `<name>_1.mcap` ...
and `metadata.yaml`.

What reaches the disk: every call of `flush` closes the chunk and syncs the file, so whoever flushes
once a second loses at most that second to a kill or a power cut. `metadata.yaml` is replaced
atomically and is never half written.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import yaml
from mcap.writer import CompressionType, Writer

from waam_node.files import write_atomically

from . import __name__ as LIBRARY

METADATA_VERSION, DISTRIBUTION = 9, 'jazzy'  # rosbag2 of ROS 2 Jazzy
CHUNK_BYTES = 1 << 20
COMPRESSIONS = {
    'zstd': CompressionType.ZSTD,
    'lz4': CompressionType.LZ4,
    'none': CompressionType.NONE,
}
_Dumper = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


class BagError(ValueError):
    """A recording that cannot be written or read; the text names the path."""


@dataclass(frozen=True)
class Topic:
    """What a reader must know about a topic. `qos`: offered profiles as dictionaries in rosbag2's
    form."""

    name: str
    type: str
    definition: str
    type_hash: str = ''
    qos: tuple[dict, ...] = ()
    latched: bool = False


@dataclass
class _File:
    path: Path
    stream: BinaryIO
    writer: Writer
    channels: dict[int, int] = field(default_factory=dict)
    schemas: dict[str, int] = field(default_factory=dict)
    messages: int = 0
    first_ns: int = 0
    last_ns: int = 0


class BagWriter:
    """One recording. Not thread-safe: one thread writes.

    directory: is created and must not exist; name: stem of the files (default: name of the
    directory); custom_data: strings kept in the metadata, may be extended until `close`; compression: of
    the chunks, one of `COMPRESSIONS`.
    """

    def __init__(
        self,
        directory: Path,
        custom_data: Mapping[str, str] | None = None,
        name: str = '',
        compression: str = 'zstd',
    ) -> None:
        if compression not in COMPRESSIONS:
            known = ', '.join(COMPRESSIONS)
            raise BagError(f"unknown compression '{compression}'; known are {known}")
        self.directory = Path(directory)
        self.name = name or self.directory.resolve().name
        self.custom_data = dict(custom_data or {})
        self._compression = COMPRESSIONS[compression]
        self.topics: list[Topic] = []
        self.counts: list[int] = []
        self._latest: dict[int, tuple[int, int, bytes]] = {}
        self._done: list[_File] = []
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError:
            raise BagError(
                f'{self.directory} exists already: a recording is never overwritten'
            ) from None
        self._file = self._open()
        self.write_metadata()

    @property
    def files(self) -> list[Path]:
        """In the order in which they were written; the last one is still open until `close`."""
        return [f.path for f in (*self._done, self._file)]

    @property
    def messages(self) -> int:
        """Messages in all files, repeats of latched ones included."""
        return sum(f.messages for f in (*self._done, self._file))

    @property
    def file_bytes(self) -> int:
        """Size of the current file so far."""
        return self._file.stream.tell()

    def add_topic(self, topic: Topic) -> int:
        """Registers a topic; the returned number is the argument of `write`."""
        self.topics.append(topic)
        self.counts.append(0)
        return len(self.topics) - 1

    def write(self, topic: int, log_ns: int, publish_ns: int, sequence: int, data: bytes) -> None:
        """One message: CDR bytes with their 4-byte head, as they came from the wire."""
        file = self._file
        channel = file.channels.get(topic) or self._channel(file, topic)
        file.writer.add_message(channel, log_ns, data, publish_ns, sequence & 0xFFFFFFFF)
        file.first_ns = log_ns if not file.messages else min(file.first_ns, log_ns)
        file.last_ns = max(file.last_ns, log_ns)
        file.messages += 1
        self.counts[topic] += 1
        if self.topics[topic].latched:
            self._latest[topic] = (publish_ns, sequence, data)

    def flush(self, sync: bool = True) -> None:
        """Closes the chunk and hands everything to the disk."""
        self._file.writer.flush()
        if sync:
            os.fsync(self._file.stream.fileno())

    def split(self, repeat: bool = True) -> None:
        """Starts the next file. Latched messages are repeated there (own publish_time and
        sequence), so that each file can be understood alone; without `repeat` it begins empty."""
        now = self._file.last_ns
        self._finish(self._file)
        self._done.append(self._file)
        self._file = self._open()
        for topic, (publish_ns, sequence, data) in list(self._latest.items()) if repeat else ():
            self.write(topic, now, publish_ns, sequence, data)
        self.write_metadata()

    def close(self) -> None:
        """Finishes the last file and writes the metadata."""
        self._finish(self._file)
        self.write_metadata()

    def abandon(self) -> None:
        """Closes the last file as it is, after a failure. Raises OSError when the disk takes no more; it is closed."""
        self._file.stream.close()

    def _open(self) -> _File:
        path = self.directory / f'{self.name}_{len(self._done)}.mcap'
        stream = open(path, 'wb', buffering=1 << 20)  # noqa: SIM115  closed in _finish
        writer = Writer(
            stream,
            chunk_size=CHUNK_BYTES,
            compression=self._compression,
            enable_data_crcs=True,
        )
        writer.start(profile='ros2', library=LIBRARY)
        file = _File(path, stream, writer)
        self._file = file
        self._write_metadata_record(file)
        file.writer.flush()
        return file

    def _finish(self, file: _File) -> None:
        file.writer.flush()
        self._write_metadata_record(file)
        file.writer.finish()
        file.stream.flush()
        os.fsync(file.stream.fileno())
        file.stream.close()

    def _channel(self, file: _File, index: int) -> int:
        topic = self.topics[index]
        if topic.type not in file.schemas:
            definition = topic.definition.encode()
            file.schemas[topic.type] = file.writer.register_schema(
                topic.type, 'ros2msg', definition
            )
        metadata = {'offered_qos_profiles': qos_text(topic.qos), 'topic_type_hash': topic.type_hash}
        channel = file.writer.register_channel(
            topic.name, 'cdr', file.schemas[topic.type], metadata
        )
        file.channels[index] = channel
        return channel

    def _write_metadata_record(self, file: _File) -> None:
        text = _dump(self._information([file])['rosbag2_bagfile_information'])
        file.writer.add_metadata('rosbag2', {'serialized_metadata': text})

    def write_metadata(self) -> None:
        """Replaces `metadata.yaml` by one that is true now.

        The hashes of services' types are in the MCAP files only: rosbags 0.11 refuses a whole recording when
        metadata.yaml has one, because it looks the type up by a name that its parser never gives.
        """
        text = _dump(self._information([*self._done, self._file], service_hashes=False))
        write_atomically(self.directory / 'metadata.yaml', text)

    def _information(self, files: list[_File], service_hashes: bool = True) -> dict:
        used = [f for f in files if f.messages]
        first = min((f.first_ns for f in used), default=0)
        last = max((f.last_ns for f in used), default=first)
        info = {
            'version': METADATA_VERSION,
            'storage_identifier': 'mcap',
            'duration': {'nanoseconds': last - first},
            'starting_time': {'nanoseconds_since_epoch': first},
            'message_count': sum(f.messages for f in files),
            'topics_with_message_count': [
                {'topic_metadata': _topic_metadata(t, service_hashes), 'message_count': n}
                for t, n in zip(self.topics, self.counts, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [f.path.name for f in files],
            'files': [_file_information(f) for f in files],
            'custom_data': self.custom_data,
            'ros_distro': DISTRIBUTION,
        }
        return {'rosbag2_bagfile_information': info}


def _file_information(file: _File) -> dict:
    return {
        'path': file.path.name,
        'starting_time': {'nanoseconds_since_epoch': file.first_ns},
        'duration': {'nanoseconds': file.last_ns - file.first_ns},
        'message_count': file.messages,
    }


def _topic_metadata(topic: Topic, service_hashes: bool) -> dict:
    shown = service_hashes or '/srv/' not in topic.type
    return {
        'name': topic.name,
        'type': topic.type,
        'serialization_format': 'cdr',
        'offered_qos_profiles': [dict(q) for q in topic.qos],
        'type_description_hash': topic.type_hash if shown else '',
    }


def qos_text(profiles: tuple[dict, ...]) -> str:
    """Offered profiles as the YAML text that rosbag2 keeps in a channel's metadata."""
    return _dump([dict(q) for q in profiles]) if profiles else ''


def _dump(value: object) -> str:
    return yaml.dump(value, Dumper=_Dumper, sort_keys=False, default_flow_style=False)
