"""Reads MCAP files record by record, also broken ones: returns what is intact, names and skips what is not.

A cut file gives everything before the cut, the readable beginning of its last chunk included; a damaged chunk costs
that chunk only, because the records around it say how long they are.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Footer, McapRecord, Message, Metadata, Schema

MAGIC = b'\x89MCAP0\r\n'
BROKEN = (
    McapError, struct.error, zstandard.ZstdError, EOFError, UnicodeDecodeError, ValueError, KeyError, MemoryError,
    OverflowError, RuntimeError,
)  # fmt: skip
HEAD = struct.Struct('<BQ')  # opcode and length of every record
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, METADATA, DATA_END = 2, 3, 4, 5, 6, 12, 15
_KINDS: dict[int, Any] = {
    SCHEMA: Schema, CHANNEL: Channel, MESSAGE: Message, METADATA: Metadata, FOOTER: Footer,
}  # fmt: skip
FOOTER_SIZE = 8 + 8 + 4
MAX_CHUNK_BYTES = 1 << 30  # bytes of a chunk, unpacked
_CHUNK_TIMES = 8 + 8 + 8 + 4  # bytes of a chunk before the name of its compression


@dataclass(frozen=True)
class Damage:
    """Something that could not be read: `offset` in bytes from the beginning of the file."""

    offset: int
    text: str

    def __str__(self) -> str:
        return f'damaged at byte {self.offset}: {self.text}'


def records(path: Path) -> Iterator[McapRecord | Damage]:
    """Schemas, channels, messages, metadata and the footer of a file in order, chunks opened and their checksums
    verified; a `Damage` for what is missing in between. Never raises for the content of the file."""
    with open(path, 'rb') as f:
        if f.read(len(MAGIC)) != MAGIC:
            yield Damage(0, 'not an MCAP file')
            return
        yield from _walk(f, path.stat().st_size)


def messages(path: Path, damage: list[str]) -> Iterator[tuple[Channel, Schema, Message]]:
    """Messages of a file with their channel and schema, as of `records`; what is missing goes into damage, in words."""
    schemas: dict[int, Schema] = {}
    channels: dict[int, tuple[Channel, Schema]] = {}
    for item in records(path):
        if isinstance(item, Message):
            if known := channels.get(item.channel_id):
                yield *known, item
        elif isinstance(item, Schema):
            schemas[item.id] = item
        elif isinstance(item, Channel):
            nothing = Schema(id=0, data=b'', encoding='', name='')
            channels[item.id] = item, schemas.get(item.schema_id, nothing)
        elif isinstance(item, Damage):
            damage.append(f'{path}: {item}')


def _walk(f: BinaryIO, size: int) -> Iterator[McapRecord | Damage]:
    while True:
        at = f.tell()
        head = f.read(HEAD.size)
        if len(head) < HEAD.size:
            yield Damage(at, 'the file ends without a footer')
            return
        opcode, length = HEAD.unpack(head)
        whole = at + HEAD.size + length <= size
        if not whole and opcode != CHUNK:
            yield Damage(at, 'the file ends within a record')
            return
        if opcode == 0:
            yield Damage(at, 'no record begins here')
            return
        if opcode == DATA_END:
            yield from _end(f, min(length, size - f.tell()), size)
            return
        yield from _one(opcode, f.read(min(length, size - at)), at, whole)
        if not whole:
            return


def _end(f: BinaryIO, length: int, size: int) -> Iterator[McapRecord | Damage]:
    """Behind the data only the footer matters; everything between repeats what was read."""
    f.seek(length, 1)
    at = f.tell()
    while len(head := f.read(HEAD.size)) == HEAD.size:
        opcode, length = HEAD.unpack(head)
        if f.tell() + length > size:
            break
        content = f.read(length)
        if opcode == FOOTER and length == FOOTER_SIZE and f.read() == MAGIC:
            yield _parse(FOOTER, content)
            return
    yield Damage(at, 'the index is not whole')


def _one(opcode: int, content: bytes, at: int, whole: bool) -> Iterator[McapRecord | Damage]:
    try:
        if opcode == CHUNK:
            yield from _opened(content, at, whole)
        elif opcode in _KINDS:
            yield _parse(opcode, content)
    except BROKEN as e:
        yield Damage(at, f'{type(e).__name__}: {e}')


def _parse(opcode: int, content: bytes) -> McapRecord:
    return _KINDS[opcode].read(ReadDataStream(BytesIO(content)))


def _opened(content: bytes, at: int, whole: bool) -> Iterator[McapRecord | Damage]:
    if whole:
        chunk = Chunk.read(ReadDataStream(BytesIO(content)))
        data = decompressed(chunk.compression, chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError('checksum of the chunk is wrong')
        yield from _inside(data)
        return
    compression, rest = _chunk_head(content)
    yield from _inside(_beginning(compression, rest))
    yield Damage(at, 'the file ends within a chunk; its beginning was taken without checksum')


def _chunk_head(content: bytes) -> tuple[str, bytes]:
    """Compression and what is there of the data of a chunk that was cut off."""
    (n,) = struct.unpack_from('<I', content, _CHUNK_TIMES)
    data_at = _CHUNK_TIMES + 4 + n + 8
    return content[_CHUNK_TIMES + 4 : _CHUNK_TIMES + 4 + n].decode(), content[data_at:]


def decompressed(compression: str, data: bytes, size: int) -> bytes:
    """The data of a whole chunk; size: what it becomes. Raises one of `BROKEN`."""
    if compression == 'zstd':
        if size > MAX_CHUNK_BYTES:
            raise ValueError(f'a chunk claims {size} bytes')
        return zstandard.decompress(data, max_output_size=size)
    if compression == 'lz4':
        return lz4.frame.decompress(data)
    if compression:
        raise ValueError(f"unknown compression '{compression}'")
    return data


def _beginning(compression: str, data: bytes) -> bytes:
    """What can be decompressed of data that was cut off."""
    if compression == 'zstd':
        return zstandard.ZstdDecompressor().decompressobj().decompress(data)
    if compression == 'lz4':
        return lz4.frame.LZ4FrameDecompressor().decompress(data)
    return data


def _inside(data: bytes) -> Iterator[McapRecord]:
    """Whole records of a chunk's data."""
    position, end = 0, len(data)
    while position + HEAD.size <= end:
        opcode, length = HEAD.unpack_from(data, position)
        position += HEAD.size
        if position + length > end:
            return
        if opcode == MESSAGE:
            yield _message(data, position, length)
        elif opcode in _KINDS:
            yield _parse(opcode, data[position : position + length])
        position += length


_MESSAGE_HEAD = struct.Struct('<HIQQ')


def message_head(content: bytes) -> tuple[int, int]:
    """Channel and log time (ns) of a message record. Raises struct.error."""
    channel, _, log_time, _ = _MESSAGE_HEAD.unpack_from(content)
    return channel, log_time


def _message(data: bytes, at: int, length: int) -> Message:
    channel, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, at)
    return Message(
        channel_id=channel,
        sequence=sequence,
        log_time=log_time,
        publish_time=publish_time,
        data=data[at + _MESSAGE_HEAD.size : at + length],
    )
