"""MCAP files record by record, also cut and damaged ones: what is whole is handed out, what is lost is said.

The mcap package's readers look for an index first and give nothing of a file whose writer was killed; this one goes
from the front, checks every chunk's checksum, never believes a length that the file cannot hold, and after damage goes
on at the next chunk it finds. Memory is bounded by LIMIT_BYTES.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from rhs.base.commands import check_regular
from rhs.base.errors import RecordingError

from .mcap_records import (
    ATTACHMENT,
    BLOCK_BYTES,
    CHANNEL,
    CHUNK,
    DATA_END,
    DATA_END_BYTES,
    FOOTER,
    FOOTER_BYTES,
    IN_DATA,
    LIMIT_BYTES,
    LIMIT_RATIO,
    LIMIT_UNPACKED_BYTES,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    SCHEMA,
    STATISTICS,
    Channel,
    Damage,
    Message,
    Note,
    Schema,
    channel_of,
    chunk_content,
    chunk_records,
    find_chunk,
    pairs_at,
    records_in,
    schema_of,
    text_at,
    unpacked_bytes,
)

TAIL_BYTES = 9 + FOOTER_BYTES + len(MAGIC)


@dataclass
class Report:
    """What a scan found. damage: one line each, with byte offsets; unknown: what was passed over unread."""

    path: Path
    size: int
    messages: int = 0
    chunks: int = 0
    promised: int | None = None
    finished: bool = False
    cut_at: int | None = None
    damage: list[str] = field(default_factory=list)
    unknown: list[str] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Nothing was lost."""
        return self.finished and not self.damage and self.promised in (None, self.messages)

    @property
    def line(self) -> str:
        """One line for the user: which file, what was read and what was lost."""
        return f"{self.path}: {self.words}"

    @property
    def words(self) -> str:
        """What was read and what was lost."""
        text = f"{self.messages} messages in {self.chunks} whole chunks"
        if self.whole:
            return text
        if not self.finished:
            text += (f"; the file stops at byte {self.size} without an index, as a killed writer leaves it" if
                     self.cut_at is None else f"; the file is cut: what begins at byte {self.cut_at} of {self.size} is lost")
        if self.promised is not None and self.promised != self.messages:
            text += f"; its index promises {self.promised}: {self.promised - self.messages} lost"
        if self.damage:
            more = f" and {len(self.damage) - 1} more" if len(self.damage) > 1 else ""
            text += f"; damaged: {self.damage[0]}{more}"
        return text


def open_scan(path: Path) -> tuple[BinaryIO, Report]:
    """The file behind its first bytes. Raises RecordingError for anything that is not MCAP at all."""
    path = Path(path)
    if path.is_dir():
        raise RecordingError(f"{path} is a folder, not an MCAP file; give the .mcap file itself")
    try:
        check_regular(path)
        size = path.stat().st_size
        file = path.open("rb")
    except OSError as error:
        raise RecordingError(f"cannot open {path}: {error.strerror or error}") from error
    start = file.read(len(MAGIC))
    if start != MAGIC or size < len(MAGIC) + 9:
        file.close()
        found = "is empty" if not size else f"has {size} bytes and begins with {start!r}"
        raise RecordingError(f"{path} is not an MCAP file: it {found}; expected {MAGIC!r} and records")
    unpacked = unpacked_bytes(file, size)
    if unpacked > max(LIMIT_UNPACKED_BYTES, LIMIT_RATIO * size):
        file.close()
        raise RecordingError(f"{path}: {size} bytes claim to unpack to {unpacked}; at most {LIMIT_RATIO} to 1 is read")
    return file, Report(path, size)


def scan(path: Path, report: Report | None = None) -> Iterator[Message | Note]:
    """Messages and notes in the order of the file; afterwards `report` says what was lost."""
    file, fresh = open_scan(path)
    report = fresh if report is None else report
    with file:
        yield from _Scan(file, report).items()


class _Scan:
    """One pass over a file. The checksum of the data section runs along; a jump over damage makes it meaningless."""

    def __init__(self, file: BinaryIO, report: Report):
        self._file, self._report = file, report
        self._schemas: dict[int, Schema] = {}
        self._described: dict[int, tuple[int, int, str, str]] = {}
        self._channels: dict[int, Channel] = {}
        self._crc = zlib.crc32(MAGIC)
        self._in_data, self._jumped, self._ended = True, False, False

    def items(self) -> Iterator[Message | Note]:
        self._read_summary()
        offset: int | None = len(MAGIC)
        while offset is not None and offset < self._report.size:
            length = 0
            try:
                opcode, length = self._head(offset)
                for item in self._record(opcode, length, offset):
                    self._report.messages += isinstance(item, Message)
                    yield item
                offset += 9 + length
                if opcode == FOOTER:
                    self._file.seek(offset)
                    self._report.finished = self._file.read(len(MAGIC)) == MAGIC
                    self._report.cut_at = None if self._report.finished else offset
                    return
            except Damage as damage:
                offset = self._after(damage, offset, length)

    def _head(self, offset: int) -> tuple[int, int]:
        self._file.seek(offset)
        head = self._file.read(9)
        if len(head) < 9:
            raise Damage("a record's head is cut")
        opcode, length = struct.unpack("<BQ", head)
        left = self._report.size - offset - 9
        if length > left:
            raise Damage(f"a record claims {length} bytes, {left} are left")
        expected = {DATA_END: DATA_END_BYTES, FOOTER: FOOTER_BYTES}.get(opcode, length)
        if length != expected or (self._in_data and opcode not in IN_DATA and opcode < 0x80):
            raise Damage(f"a record of code {opcode} and {length} bytes does not belong there")
        self._count(head, opcode)
        return opcode, length

    def _record(self, opcode: int, length: int, offset: int) -> Iterator[Message | Note]:
        if opcode == ATTACHMENT or opcode >= 0x80:
            if opcode >= 0x80:
                self._report.unknown.append(f"a private record (code {opcode}) at byte {offset}")
            while length > 0:
                self._count(self._file.read(min(length, BLOCK_BYTES)), opcode)
                length -= BLOCK_BYTES
            return
        if length > LIMIT_BYTES:
            raise Damage(f"a record of {length} bytes; at most {LIMIT_BYTES} are read")
        body = self._file.read(length)
        self._count(body, opcode)
        try:
            yield from self._parsed(opcode, body, offset)
        except (struct.error, UnicodeDecodeError) as error:
            raise Damage(f"a record of code {opcode} does not parse") from error

    def _count(self, data: bytes, opcode: int) -> None:
        if self._in_data and opcode != DATA_END:
            self._crc = zlib.crc32(data, self._crc)

    def _parsed(self, opcode: int, body: bytes, offset: int) -> Iterator[Message | Note]:
        if opcode == CHUNK:
            for code, inner in chunk_records(chunk_content(body)):
                yield from self._message_or_description(code, inner)
            self._report.chunks += 1
        elif opcode in (MESSAGE, SCHEMA, CHANNEL):
            yield from self._message_or_description(opcode, memoryview(body))
        elif opcode == METADATA:
            name, at = text_at(body, 0)
            yield Note(name, pairs_at(body, at))
        elif opcode == MESSAGE_INDEX and len(body) != 6 + struct.unpack_from("<I", body, 2)[0]:
            raise Damage("a message index has the wrong length")
        elif opcode == DATA_END:
            self._in_data = False
            (crc,) = struct.unpack("<I", body)
            if crc and crc != self._crc and not self._jumped:
                self._report.damage.append(f"the checksum of bytes 0..{offset} is wrong, though every chunk is whole")

    def _message_or_description(self, opcode: int, body: memoryview) -> Iterator[Message]:
        if opcode == MESSAGE:
            number, sequence, log_ns, publish_ns = struct.unpack_from("<HIQQ", body)
            channel = self._channel(number)
            if channel is not None:
                yield Message(channel, log_ns, publish_ns, sequence, bytes(body[22:]))
        elif opcode == SCHEMA:
            self._schemas.setdefault(*schema_of(bytes(body)))
        elif opcode == CHANNEL:
            described = channel_of(bytes(body))
            self._described.setdefault(described[0], described)

    def _channel(self, number: int) -> Channel | None:
        """The channel, or None, said once, when its description is lost."""
        if number in self._channels:
            return self._channels[number]
        described = self._described.get(number)
        if described is None or (described[1] and described[1] not in self._schemas):
            text = f"messages of channel {number}, whose description is lost"
            if text not in self._report.damage:
                self._report.damage.append(text)
            return None
        _, schema, topic, encoding = described
        self._channels[number] = Channel(topic, encoding, self._schemas.get(schema, Schema("", "", b"")))
        return self._channels[number]

    # --- ends and damage ---------------------------------------------------------------------------------------------

    def _after(self, damage: Damage, offset: int, length: int) -> int | None:
        """Where to go on after a damaged record: behind it when its length is believable, else at the next chunk; None:
        nothing more to read."""
        self._jumped = True
        if damage.framed:
            self._report.damage.append(f"{damage} at byte {offset}")
            return offset + 9 + length
        following = find_chunk(self._file, offset + 1, self._report.size)
        if following is None and not self._ended:
            self._report.cut_at = offset  # the plain end of a file whose writer was killed
        else:
            self._report.damage.append(f"{damage} at byte {offset}")
            self._report.finished = self._ended
        return following

    def _read_summary(self) -> None:
        """Descriptions of channels and the promised number of messages, where the file has a sound index at its end."""
        size = self._report.size
        self._file.seek(max(0, size - TAIL_BYTES))
        footer = self._file.read(TAIL_BYTES)
        if len(footer) < TAIL_BYTES or footer[-len(MAGIC) :] != MAGIC or footer[0] != FOOTER:
            return
        self._ended = True
        start, _, crc = struct.unpack_from("<QQI", footer, 9)
        if start == 0:
            return
        if not len(MAGIC) <= start <= size - TAIL_BYTES or size - TAIL_BYTES - start > LIMIT_BYTES:
            self._report.damage.append("the index is not where the end of the file says; read without it")
            return
        self._file.seek(start)
        summary = self._file.read(size - TAIL_BYTES - start)
        if crc and zlib.crc32(footer[: 9 + 16], zlib.crc32(summary)) != crc:
            self._report.damage.append("the index's checksum is wrong; read without it")
            return
        try:
            for opcode, body in records_in(summary):
                if opcode in (SCHEMA, CHANNEL):
                    list(self._message_or_description(opcode, body))
                elif opcode == STATISTICS:
                    (self._report.promised,) = struct.unpack_from("<Q", body)
        except (struct.error, UnicodeDecodeError, Damage):
            self._report.damage.append("the index does not parse; read without it")
