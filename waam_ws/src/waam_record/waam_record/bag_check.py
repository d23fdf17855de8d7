"""Whether the bytes of a recording are as they were written.

The checksums of data section, summary and chunks cover every byte of a file recorded here. What others write without
checksums (0 = "not written") is walked through record by record. Counts of messages are compared with the statistics
and with metadata.yaml.
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
from mcap.records import Channel, Chunk, DataEnd, Footer, Statistics

from waam_process.safe_files import FileError, Missing, opened, read_mapping

from .salvage import BROKEN, FOOTER_SIZE, HEAD, MAGIC, MAX_CHUNK_BYTES, decompressed, message_head

_KINDS: dict[int, Any] = {
    Opcode.CHANNEL: Channel, Opcode.CHUNK: Chunk, Opcode.STATISTICS: Statistics, Opcode.DATA_END: DataEnd,
    Opcode.FOOTER: Footer,
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
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)  # messages by channel

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
                size = self.file.stat().st_size
                self._data(f, size)
                self._summary(f, size)
        except (_Wrong, FileError) as e:
            text = str(e)
            self.problems.append(text if str(self.file) in text else f'{self.file}: {text}')
        return self

    def _data(self, f: BinaryIO, size: int) -> None:
        """From the beginning to the end of the data section."""
        if f.read(len(MAGIC)) != MAGIC:
            raise _Wrong('not an MCAP file')
        crc = zlib.crc32(MAGIC)
        for opcode, at, head, content in _records(f, size):
            record = self._parsed(opcode, at, content)
            if opcode == Opcode.DATA_END:
                if record.data_section_crc not in (0, crc):
                    self.wrong('the checksum of its data is wrong')
                return
            crc = zlib.crc32(content, zlib.crc32(head, crc))
            if opcode == Opcode.CHUNK:
                self._chunk(at, record)
            else:
                self._take(opcode, at, content, record)

    def _chunk(self, at: int, chunk: Chunk) -> None:
        try:
            data = _unpacked(chunk)
            for opcode, _, _, content in _records(BytesIO(data), len(data)):
                self._take(opcode, at, content, self._parsed(opcode, at, content))
        except BROKEN as e:
            raise _Wrong(f'damaged at byte {at} ({type(e).__name__}: {e})') from None

    def _take(self, opcode: int, at: int, content: bytes, record: Any) -> None:
        """Counts messages; remembers channels."""
        if opcode == Opcode.CHANNEL:
            self.channels[record.id] = record
        elif opcode == Opcode.MESSAGE:
            try:
                channel, _ = message_head(content)
            except BROKEN:
                raise _Wrong(f'damaged at byte {at} (a message ends within its head)') from None
            if channel not in self.channels:
                self.wrong(f'byte {at}: a message of channel {channel}, which is not there')
            self.counts[channel] += 1

    def _parsed(self, opcode: int, at: int, content: bytes) -> Any:
        """The record, None of a kind that is not looked into."""
        if not 0 < opcode <= Opcode.DATA_END and opcode < PRIVATE:
            self.wrong(f'byte {at}: no record has the code {opcode}')
        kind = _KINDS.get(opcode)
        try:
            return kind.read(_Whole(BytesIO(content))) if kind else None
        except BROKEN as e:
            raise _Wrong(f'damaged at byte {at} ({type(e).__name__}: {e})') from None

    def _summary(self, f: BinaryIO, size: int) -> None:
        """From behind the data section to the end of the file."""
        start, crc, stated = f.tell(), 0, None
        for opcode, at, head, content in _records(f, size):
            record = self._parsed(opcode, at, content)
            crc = zlib.crc32(head, crc)
            if opcode == Opcode.FOOTER:
                crc = zlib.crc32(content[:-4], crc)
                if len(content) != FOOTER_SIZE or record.summary_start not in (0, start):
                    self.wrong('the footer says another place of the summary')
                if record.summary_crc not in (0, crc):
                    self.wrong('the checksum of its summary is wrong')
                break
            crc = zlib.crc32(content, crc)
            stated = record if opcode == Opcode.STATISTICS else stated
        if f.read() != MAGIC:
            self.wrong('does not end with the mark of an MCAP file')
        told = stated and {n: c for n, c in stated.channel_message_counts.items() if c}
        if stated is None or stated.message_count != self.messages:
            says = stated and stated.message_count
            self.wrong(f'{self.messages} messages found, its index says {says}')
        elif told != dict(self.counts):
            self.wrong('its statistics say other counts of messages by channel')


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
