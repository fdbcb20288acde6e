"""Messages of Protocol Buffers, read by the schema that an MCAP file holds beside them (a FileDescriptorSet).

The wire format: protobuf.dev, "Encoding"; the numbers of a schema's own fields: google/protobuf/descriptor.proto.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

VARINT, EIGHT, BYTES, FOUR = 0, 1, 2, 5  # wire types
FIXED = {1: "<f8", 2: "<f4", 6: "<u8", 7: "<u4", 15: "<i4", 16: "<i8"}  # types of fields: as they lie there
TEXT, MESSAGE, RAW = 9, 11, 12
SIGNED, ZIGZAG = (3, 5), (17, 18)
REPEATED = 3
MOST_BITS = 70  # of a varint of ten bytes


@dataclass
class Field:
    """A field of a message: its name, its type, the name of the message where it is one, whether it may come many times."""

    name: str = ""
    kind: int = 0
    of: str = ""
    many: bool = False


Fields = dict[int, Field]


@dataclass
class Schema:
    """The messages of a FileDescriptorSet by their full names. Raises ValueError for bytes that are none."""

    messages: dict[str, Fields] = field(default_factory=dict)

    @classmethod
    def of(cls, data: bytes) -> Schema:
        out = cls()
        for number, file in _wired(data):
            if number == 1:
                parts = list(_wired(file))
                package = next((bytes(value).decode() for at, value in parts if at == 2), "")
                for at, value in parts:
                    if at == 4:
                        out._add(value, package)
        return out

    def _add(self, data: Any, within: str) -> None:
        parts = list(_wired(data))
        name = ".".join(filter(None, (within, next(bytes(value).decode() for at, value in parts if at == 1))))
        self.messages[name] = dict(_field(value) for at, value in parts if at == 2)
        for at, value in parts:
            if at == 3:
                self._add(value, name)

    def read(self, data: Any, kind: str) -> dict[str, Any]:
        """Name -> value of a message: numbers, text, bytes, arrays and lists, and messages likewise; what is left out is
        zero, empty, or None of a message. Raises ValueError, KeyError."""
        fields = self.messages[kind]
        out: dict[str, Any] = {one.name: [] if one.many else None if one.kind == MESSAGE else b"" if one.kind == RAW else
                               "" if one.kind == TEXT else 0 for one in fields.values()}
        for number, value in _wired(data):
            if (one := fields.get(number)) is None:
                continue
            values = self._values(one, value)
            if not one.many:
                out[one.name] = values[-1] if len(values) else 0
            elif isinstance(values, np.ndarray) and not len(out[one.name]):
                out[one.name] = values
            else:
                out[one.name] = [*out[one.name], *values]
        return out

    def _values(self, one: Field, value: Any) -> Any:
        """One value, or several that were packed."""
        if one.kind == MESSAGE:
            return [self.read(value, one.of)]
        if one.kind in (TEXT, RAW):
            return [bytes(value).decode() if one.kind == TEXT else bytes(value)]
        if one.kind in FIXED:
            return np.frombuffer(bytes(value), FIXED[one.kind])
        packed = [value] if isinstance(value, int) else list(_varints(value))
        return [_number(number, one.kind) for number in packed]


def _field(data: Any) -> tuple[int, Field]:
    said = dict(_wired(data))
    return said[3], Field(bytes(said[1]).decode(), said.get(5, 0), bytes(said.get(6, b"")).decode().lstrip("."),
                          said.get(4) == REPEATED)


def _number(value: int, kind: int) -> int:
    if kind in ZIGZAG:
        return (value >> 1) ^ -(value & 1)
    return value - (1 << 64) if kind in SIGNED and value >> 63 else value


def _wired(data: Any) -> Iterator[tuple[int, Any]]:
    """(number, value) of each field: a whole number of a varint, bytes of all others."""
    view, at = memoryview(data), 0
    while at < len(view):
        key, at = _varint(view, at)
        if key & 7 == VARINT:
            value, at = _varint(view, at)
            yield key >> 3, value
            continue
        size, at = (8, at) if key & 7 == EIGHT else (4, at) if key & 7 == FOUR else _varint(view, at)
        if key & 7 not in (EIGHT, BYTES, FOUR) or size > len(view) - at:
            raise ValueError(f"byte {at} of {len(view)}: no field of a message")
        yield key >> 3, view[at : at + size]
        at += size


def _varints(data: Any) -> Iterator[int]:
    view, at = memoryview(data), 0
    while at < len(view):
        value, at = _varint(view, at)
        yield value


def _varint(view: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while at < len(view) and shift < MOST_BITS:
        byte = struct.unpack_from("B", view, at)[0]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at
    raise ValueError(f"byte {at} of {len(view)}: a number that does not end")
