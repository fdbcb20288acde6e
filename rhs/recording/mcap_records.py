"""The bytes of MCAP records: parsing that never believes a length. Container format: https://mcap.dev/spec."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

MAGIC = b"\x89MCAP0\r\n"
LIMIT_BYTES = 256 << 20  # of one record, and of one chunk unpacked
# All chunks of a file together unpack to no more than so many bytes, or so many times its size: blank images pack 300 to 1.
LIMIT_UNPACKED_BYTES, LIMIT_RATIO = 1 << 30, 1000
LOOKED_AT = 200_000  # records, before the first is read
LIMIT_RECORDS = 1_000_000  # in one chunk
BLOCK_BYTES = 1 << 20
(HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, ATTACHMENT, ATTACHMENT_INDEX, STATISTICS,
 METADATA, METADATA_INDEX, SUMMARY_OFFSET, DATA_END) = range(1, 16)
CHUNK_HEAD = struct.Struct("<QQQI")
PACKINGS = re.compile(rb"\x04\0\0\0zstd|\x03\0\0\0lz4")  # as they stand behind that
FOOTER_BYTES = 8 + 8 + 4
DATA_END_BYTES = 4
IN_DATA = (HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA, DATA_END)


@dataclass(frozen=True)
class Schema:
    """A message definition: its name, its encoding (ros2msg), its text."""

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True)
class Channel:
    """A topic, the encoding of its messages and their schema."""

    topic: str
    encoding: str
    schema: Schema


@dataclass(frozen=True)
class Message:
    """One message as recorded; log_ns, publish_ns in nanoseconds."""

    channel: Channel
    log_ns: int
    publish_ns: int
    sequence: int
    data: bytes


@dataclass(frozen=True)
class Note:
    """A metadata record."""

    name: str
    values: dict[str, str]


class Damage(Exception):
    """A record that cannot be what it says. framed: its length is believable, so the next record can be found."""

    def __init__(self, message: str, *, framed: bool = False):
        super().__init__(message)
        self.framed = framed


def chunk_content(body: bytes) -> bytes:
    """The unpacked, checked records of a chunk."""
    _, _, unpacked, crc = CHUNK_HEAD.unpack_from(body)
    compression, at = text_at(body, CHUNK_HEAD.size)
    (packed,) = struct.unpack_from("<Q", body, at)
    if at + 8 + packed != len(body):
        raise Damage("a chunk's length does not fit its record")
    if unpacked > LIMIT_BYTES:
        raise Damage(f"a chunk claims to unpack to {unpacked} bytes; at most {LIMIT_BYTES} are read", framed=True)
    data = unpack(memoryview(body)[at + 8 :], compression, unpacked)
    if crc and zlib.crc32(data) != crc:
        raise Damage("a chunk's checksum is wrong", framed=True)
    return data


def schema_of(body: bytes) -> tuple[int, Schema]:
    """(number, Schema) from the body of a record. Raises struct.error or ValueError when it is cut."""
    (number,) = struct.unpack_from("<H", body)
    name, at = text_at(body, 2)
    encoding, at = text_at(body, at)
    (size,) = struct.unpack_from("<I", body, at)
    if at + 4 + size > len(body):
        raise Damage("a schema is longer than its record")
    return number, Schema(name, encoding, body[at + 4 : at + 4 + size])


def channel_of(body: bytes) -> tuple[int, int, str, str]:
    """Number, number of the schema, topic, encoding."""
    number, schema = struct.unpack_from("<HH", body)
    topic, at = text_at(body, 4)
    encoding, at = text_at(body, at)
    return number, schema, topic, encoding


def records_in(data: bytes | memoryview) -> Iterator[tuple[int, memoryview]]:
    """(code, body) of the records that follow one another in `data`."""
    view, at = memoryview(data), 0
    while at < len(view):
        if len(view) - at < 9:
            raise Damage("a record's head is cut", framed=True)
        opcode, length = struct.unpack_from("<BQ", view, at)
        if length > len(view) - at - 9:
            raise Damage("a record is longer than what holds it", framed=True)
        yield opcode, view[at + 9 : at + 9 + length]
        at += 9 + length


def chunk_records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """The records of an unpacked chunk: descriptions and messages, not too many."""
    for number, (opcode, body) in enumerate(records_in(data)):
        if opcode not in (SCHEMA, CHANNEL, MESSAGE) and opcode < 0x80:
            raise Damage(f"a chunk holds a record of code {opcode}", framed=True)
        if number >= LIMIT_RECORDS:
            raise Damage(f"a chunk holds more than {LIMIT_RECORDS} records", framed=True)
        yield opcode, body


def unpacked_bytes(file: BinaryIO, size: int) -> int:
    """What the chunks of a file claim to unpack to, up to the first record that is no record; nothing is unpacked."""
    total, at = 0, len(MAGIC)
    for _ in range(LOOKED_AT):
        if at + 9 > size:
            break
        file.seek(at)
        head = file.read(9 + CHUNK_HEAD.size)
        opcode, length = struct.unpack_from("<BQ", head)
        if not 0 < opcode <= DATA_END or length > size - at - 9:
            break
        if opcode == CHUNK and len(head) == 9 + CHUNK_HEAD.size:
            claimed = CHUNK_HEAD.unpack_from(head, 9)[2]
            total += claimed if claimed <= LIMIT_BYTES else 0  # one that claims more is passed over, the others are read
        at += 9 + length
    return total


def unpack(data: memoryview, compression: str, size: int) -> bytes:
    """Exactly `size` bytes of a compressed chunk; never more memory than that, whatever the data claim."""
    import lz4.frame
    import zstandard

    try:
        if compression == "":
            plain = bytes(data)
        elif compression == "zstd":
            plain = zstandard.ZstdDecompressor().stream_reader(bytes(data)).read(size + 1)
        elif compression == "lz4":
            plain = lz4.frame.LZ4FrameDecompressor().decompress(bytes(data), max_length=size + 1)
        else:
            raise Damage(f"a chunk is packed with {compression[:20]!r}; zstd, lz4 or nothing can be read", framed=True)
    except (zstandard.ZstdError, RuntimeError, MemoryError) as error:
        raise Damage("a chunk does not unpack", framed=True) from error
    if len(plain) != size:
        raise Damage(f"a chunk unpacks to another length than the {size} bytes it claims", framed=True)
    return plain


def find_chunk(file: BinaryIO, start: int, size: int) -> int | None:
    """Offset of the next plausible compressed chunk at or after `start`: a chunk's head whose lengths agree."""
    before, at = 9 + CHUNK_HEAD.size, start
    while at < size:
        file.seek(at)
        block = file.read(BLOCK_BYTES + 64)
        for word in PACKINGS.finditer(block, before):
            head, end = word.start() - before, word.end()
            if block[head] == CHUNK and end + 8 <= len(block):
                (length,), (packed,) = (struct.unpack_from("<Q", block, where) for where in (head + 1, end))
                if length == CHUNK_HEAD.size + len(word[0]) + 8 + packed and head + 9 + length <= size - at:
                    return at + head
        at += BLOCK_BYTES + 64 - before - 16 if len(block) == BLOCK_BYTES + 64 else len(block)
    return None


def text_at(body: bytes | memoryview, at: int) -> tuple[str, int]:
    """A text and where it ends."""
    (size,) = struct.unpack_from("<I", body, at)
    if at + 4 + size > len(body):
        raise Damage("a text is longer than its record")
    return str(bytes(body[at + 4 : at + 4 + size]), "utf-8"), at + 4 + size


def pairs_at(body: bytes, at: int) -> dict[str, str]:
    """A table of texts."""
    (size,) = struct.unpack_from("<I", body, at)
    at += 4
    end, out = at + size, {}
    if end > len(body):
        raise Damage("a table of texts is longer than its record")
    while at < end:
        key, at = text_at(body, at)
        out[key], at = text_at(body, at)
    return out
