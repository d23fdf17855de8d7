"""Whether every byte of a recording is as it was written: all that the MCAP specification lets one compare.

Checksums of chunks, data section, summary and attachments; chunk bounds; MessageIndex records against the messages
(channel, time, offset); chunk, metadata and attachment indexes, statistics and summary offsets against what lies in the
file; ids of schemas and channels; and the counts of metadata.yaml. A checksum of 0 means "not written": then only the
comparisons speak.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from waam_process.safe_files import FileError, Missing, opened, read_mapping

from .salvage import BROKEN, FOOTER_SIZE, HEAD, MAGIC, MAX_CHUNK_BYTES, decompressed, message_head

_KINDS: dict[int, Any] = {
    Opcode.HEADER: Header, Opcode.FOOTER: Footer, Opcode.SCHEMA: Schema, Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk, Opcode.MESSAGE_INDEX: MessageIndex, Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT: Attachment, Opcode.ATTACHMENT_INDEX: AttachmentIndex, Opcode.STATISTICS: Statistics,
    Opcode.METADATA: Metadata, Opcode.METADATA_INDEX: MetadataIndex, Opcode.SUMMARY_OFFSET: SummaryOffset,
    Opcode.DATA_END: DataEnd,
}  # fmt: skip
_SUMMARY = {
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX, Opcode.SUMMARY_OFFSET,
}  # fmt: skip
PRIVATE = 0x80  # opcodes from here on are anybody's


class _Wrong(ValueError):
    """The file cannot be read on; the text says where and why."""


class _Whole(ReadDataStream):
    """Reads what was asked for, or raises."""

    def read(self, length: int) -> bytes:
        """EndOfFile where less is there."""
        data = super().read(length)
        if len(data) != length:
            raise EndOfFile
        return data


@dataclass
class FileCheck:
    """What lies in one file, and what is wrong with it."""

    file: Path
    problems: list[str] = field(default_factory=list)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)  # messages by channel
    times: list[int] = field(default_factory=list)  # least and greatest log time
    chunks: list[ChunkIndex] = field(default_factory=list)
    metadata: list[MetadataIndex] = field(default_factory=list)
    attachments: list[AttachmentIndex] = field(default_factory=list)
    summary: list[tuple[int, int, int, Any]] = field(
        default_factory=list
    )  # opcode, at, end, record
    _waiting: dict[int, list[tuple[int, int]]] = field(default_factory=dict)  # not indexed yet

    @property
    def messages(self) -> int:
        """Messages found."""
        return sum(self.counts.values())

    def wrong(self, text: str) -> None:
        """Notes a problem."""
        self.problems.append(f'{self.file}: {text}')

    def run(self) -> FileCheck:
        """Reads the file once from end to end."""
        try:
            with opened(self.file) as f:
                self._read(f, self.file.stat().st_size)
        except (_Wrong, FileError) as e:
            text = str(e)
            self.problems.append(text if str(self.file) in text else f'{self.file}: {text}')
        return self

    # ---- the file from its beginning to its end ----------------------------------------------

    def _read(self, f: BinaryIO, size: int) -> None:
        if f.read(len(MAGIC)) != MAGIC:
            raise _Wrong('not an MCAP file')
        crc, first = zlib.crc32(MAGIC), True
        for opcode, at, head, content in _records(f, size):
            if first and opcode != Opcode.HEADER:
                self.wrong('does not begin with a header')
            record = self._parsed(opcode, at, content)
            if opcode == Opcode.DATA_END:
                self._indexed(at)
                if record.data_section_crc not in (0, crc):
                    self.wrong('the checksum of its data is wrong')
                break
            crc = zlib.crc32(content, zlib.crc32(head, crc))
            self._data(opcode, at, HEAD.size + len(content), record, content, first)
            first = False
        self._read_summary(f, size)

    def _parsed(self, opcode: int, at: int, content: bytes) -> Any:
        if opcode == Opcode.MESSAGE:
            return None
        kind = _KINDS.get(opcode)
        if kind is None:
            if opcode < PRIVATE:
                self.wrong(f'byte {at}: no record has the code {opcode}')
            return None
        try:
            return kind.read(_Whole(BytesIO(content)))
        except BROKEN as e:
            raise _Wrong(f'damaged at byte {at} ({type(e).__name__}: {e})') from None

    def _data(
        self, opcode: int, at: int, length: int, record: Any, content: bytes, first: bool
    ) -> None:
        """One record of the data section."""
        if opcode == Opcode.MESSAGE_INDEX:
            self._message_index(at, length, record)
            return
        self._indexed(at)
        if opcode == Opcode.CHUNK:
            self._chunk(at, length, record)
        elif opcode == Opcode.MESSAGE:
            self._message(at, content)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._declared(at, record)
        elif opcode == Opcode.METADATA:
            self.metadata.append(MetadataIndex(at, length, record.name))
        elif opcode == Opcode.ATTACHMENT:
            if int.from_bytes(content[-4:], 'little') not in (0, zlib.crc32(content[:-4])):
                self.wrong(f'byte {at}: the checksum of an attachment is wrong')
            a = record
            self.attachments.append(
                AttachmentIndex(
                    at, length, a.log_time, a.create_time, len(a.data), a.name, a.media_type
                )
            )
        elif opcode == Opcode.HEADER and not first:
            self.wrong(f'byte {at}: a second header')
        elif opcode in _SUMMARY or opcode == Opcode.FOOTER:
            self.wrong(f'byte {at}: a record of the summary among the data')

    def _declared(self, at: int, record: Schema | Channel) -> None:
        known: dict[int, Any] = self.schemas if isinstance(record, Schema) else self.channels
        if known.setdefault(record.id, record) != record:
            self.wrong(f'byte {at}: number {record.id} was given to another one before')
        if isinstance(record, Schema) and not record.id:
            self.wrong(f'byte {at}: a schema has the number 0')
        if (
            isinstance(record, Channel)
            and record.schema_id
            and record.schema_id not in self.schemas
        ):
            self.wrong(f'byte {at}: channel {record.topic} has a schema that is not there')

    def _message(self, at: int, content: bytes) -> tuple[int, int]:
        """Channel and log time."""
        try:
            channel, log_time = message_head(content)
        except BROKEN:
            raise _Wrong(f'damaged at byte {at} (a message ends within its head)') from None
        if channel not in self.channels:
            self.wrong(f'byte {at}: a message of channel {channel}, which is not there')
        self.counts[channel] += 1
        self.times = [min([*self.times[:1], log_time]), max([*self.times[1:], log_time])]
        return channel, log_time

    # ---- chunks and their index --------------------------------------------------------------

    def _chunk(self, at: int, length: int, chunk: Chunk) -> None:
        found: dict[int, list[tuple[int, int]]] = {}
        times: list[int] = []
        try:
            for opcode, offset, _, content in _records(
                BytesIO(_unpacked(chunk)), chunk.uncompressed_size
            ):
                if opcode == Opcode.MESSAGE:
                    channel, log_time = self._message(at, content)
                    found.setdefault(channel, []).append((log_time, offset))
                    times.append(log_time)
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._declared(at, self._parsed(opcode, at, content))
                else:
                    self.wrong(f'byte {at}: a record of code {opcode} within a chunk')
        except BROKEN as e:
            raise _Wrong(f'damaged at byte {at} ({type(e).__name__}: {e})') from None
        bounds = (min(times), max(times)) if times else (0, 0)
        if (chunk.message_start_time, chunk.message_end_time) != bounds:
            self.wrong(f'byte {at}: a chunk says other times than its messages')
        self._waiting = found
        self.chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=at,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=0,
                message_index_offsets={},
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def _message_index(self, at: int, length: int, index: MessageIndex) -> None:
        chunk = self.chunks[-1] if self.chunks else None
        if chunk is None or index.channel_id in chunk.message_index_offsets:
            self.wrong(f'byte {at}: a message index that belongs to no chunk')
            return
        chunk.message_index_offsets[index.channel_id] = at
        chunk.message_index_length += length
        if sorted(index.records) != sorted(self._waiting.pop(index.channel_id, [])):
            self.wrong(
                f'byte {at}: the message index of channel {index.channel_id} is not that of its chunk'
            )

    def _indexed(self, at: int) -> None:
        """Before the next record: all messages of the chunk are in its index, if it has one."""
        if self._waiting and self.chunks[-1].message_index_offsets:
            self.wrong(f'byte {at}: messages of channel {min(self._waiting)} are in no index')
        self._waiting = {}

    # ---- the summary -------------------------------------------------------------------------

    def _read_summary(self, f: BinaryIO, size: int) -> None:
        start = f.tell()
        crc = 0
        for opcode, at, head, content in _records(f, size):
            record = self._parsed(opcode, at, content)
            if opcode == Opcode.FOOTER:
                crc = zlib.crc32(content[:-4], zlib.crc32(head, crc))
                self._footer(record, start, crc, len(content))
                break
            crc = zlib.crc32(content, zlib.crc32(head, crc))
            if opcode not in _SUMMARY and opcode < PRIVATE:
                self.wrong(f'byte {at}: a record of code {opcode} in the summary')
            self.summary.append((opcode, at, at + HEAD.size + len(content), record))
        if f.read() != MAGIC:
            self.wrong('does not end with the mark of an MCAP file')
        self._compare()

    def _footer(self, footer: Footer, start: int, crc: int, length: int) -> None:
        offsets = [at for opcode, at, _, _ in self.summary if opcode == Opcode.SUMMARY_OFFSET]
        if length != FOOTER_SIZE or footer.summary_start != (start if self.summary else 0):
            self.wrong('the footer says another place of the summary')
        if footer.summary_offset_start not in ({offsets[0]} if offsets else {0}):
            self.wrong('the footer says another place of the summary offsets')
        if footer.summary_crc not in (0, crc):
            self.wrong('the checksum of its summary is wrong')

    def _of(self, opcode: int) -> list[Any]:
        return [record for code, _, _, record in self.summary if code == opcode]

    def _compare(self) -> None:
        """The summary with what was found."""
        for opcode, found, name in (
            (Opcode.CHUNK_INDEX, self.chunks, 'chunk'),
            (Opcode.METADATA_INDEX, self.metadata, 'metadata'),
            (Opcode.ATTACHMENT_INDEX, self.attachments, 'attachment'),
        ):
            stated = self._of(opcode)
            if stated and sorted(stated, key=repr) != sorted(found, key=repr):
                self.wrong(f'its {name} index is not what lies in it')
        for opcode, known in ((Opcode.SCHEMA, self.schemas), (Opcode.CHANNEL, self.channels)):
            if any(known.get(r.id) != r for r in self._of(opcode)):
                self.wrong('its summary repeats a schema or channel that is not in its data')
        self._statistics()
        groups: dict[int, list[int]] = {}
        for code, at, end, _ in self.summary:
            first = groups.setdefault(code, [at, end])
            first[1] = end
        for r in self._of(Opcode.SUMMARY_OFFSET):
            there = groups.get(r.group_opcode)
            if (there or r.group_length) and there != [
                r.group_start,
                r.group_start + r.group_length,
            ]:
                self.wrong('a summary offset names another place than that of its group')

    def _statistics(self) -> None:
        stated = self._of(Opcode.STATISTICS)
        if len(stated) != 1:
            self.wrong(f'{self.messages} messages found, its index says {None}')
            return
        (s,) = stated
        found = {
            'message_count': self.messages, 'schema_count': len(self.schemas), 'channel_count': len(self.channels),
            'attachment_count': len(self.attachments), 'metadata_count': len(self.metadata),
            'chunk_count': len(self.chunks), 'message_start_time': self.times[0] if self.times else 0,
            'message_end_time': self.times[-1] if self.times else 0,
        }  # fmt: skip
        if s.message_count != self.messages:
            self.wrong(f'{self.messages} messages found, its index says {s.message_count}')
        elif {n: c for n, c in s.channel_message_counts.items() if c} != dict(self.counts):
            self.wrong('its statistics say other counts of messages by channel')
        for name, value in found.items():
            if getattr(s, name) != value:
                self.wrong(f'its statistics say {name} {getattr(s, name)}, found is {value}')


def _records(f: BinaryIO | BytesIO, size: int) -> Iterator[tuple[int, int, bytes, bytes]]:
    """Code, place, head and content of every record. _Wrong at the first one that is not whole."""
    while True:
        at = f.tell()
        if at == size and isinstance(f, BytesIO):
            return
        head = f.read(HEAD.size)
        if len(head) < HEAD.size:
            raise _Wrong(
                f'ends at byte {at} without a footer' if at >= size else f'damaged at byte {at}'
            )
        opcode, length = HEAD.unpack(head)
        if not opcode or at + HEAD.size + length > size:
            raise _Wrong(f'damaged at byte {at} (no whole record begins there)')
        yield opcode, at, head, f.read(length)


def _unpacked(chunk: Chunk) -> bytes:
    if chunk.uncompressed_size > MAX_CHUNK_BYTES:
        raise ValueError(f'a chunk claims {chunk.uncompressed_size} bytes')
    data = decompressed(chunk.compression, chunk.data, chunk.uncompressed_size)
    if len(data) != chunk.uncompressed_size:
        raise ValueError('a chunk says another size than it has')
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError('checksum of a chunk is wrong')
    return data


def check_metadata(folder: Path, files: list[FileCheck]) -> list[str]:
    """What metadata.yaml says wrongly of the files beside it: names and counts of messages."""
    file = folder / 'metadata.yaml'
    try:
        told = read_mapping(file)['rosbag2_bagfile_information']
        stated = {str(f['path']): f['message_count'] for f in told['files']}
        names, total = [str(n) for n in told['relative_file_paths']], told['message_count']
        topics = {
            str(t['topic_metadata']['name']): t['message_count']
            for t in told['topics_with_message_count']
        }
    except Missing:
        return [f'{file}: no such file']
    except FileError as e:
        return [str(e)]
    except (KeyError, TypeError, AttributeError) as e:
        return [f'{file}: damaged ({type(e).__name__}: {e})']
    found = {f.file.name: f.messages for f in files}
    by_topic: Counter[str] = Counter()
    for f in files:
        for channel, count in f.counts.items():
            by_topic[f.channels[channel].topic if channel in f.channels else ''] += count
    wrong = []
    if sorted(names) != sorted(found) or stated != found or total != sum(found.values()):
        wrong.append(f'{file}: names other files, or other counts of messages, than lie there')
    elif {t: n for t, n in topics.items() if n} != {t: n for t, n in by_topic.items() if n}:
        wrong.append(f'{file}: says other counts of messages by topic')
    return wrong
