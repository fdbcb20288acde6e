"""Messages of Protocol Buffers by the schema that an MCAP file holds beside them (a FileDescriptorSet), through Google's
library."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError
from google.protobuf.message_factory import GetMessageClass


def reader_of(schema: bytes, name: str) -> Callable[[bytes], dict[str, Any]]:
    """What makes a message of this full name of its bytes: name -> value, messages likewise; what is left out is zero,
    empty, or None of a message. It raises ValueError for bytes that are none, and this ValueError, KeyError or TypeError
    for bytes that are no such schema."""
    pool, files = DescriptorPool(), {one.name: one for one in _decoded(FileDescriptorSet, schema).file}

    def add(file: FileDescriptorProto) -> None:
        for other in file.dependency:
            if other in files:
                add(files.pop(other))
        pool.AddSerializedFile(file.SerializeToString())

    while files:
        add(files.popitem()[1])
    made = GetMessageClass(pool.FindMessageTypeByName(name))
    return lambda data: _plain(_decoded(made, data))


def _decoded(made: Any, data: bytes) -> Any:
    try:
        return made.FromString(data)
    except DecodeError as error:
        raise ValueError(str(error)) from error


def _plain(message: Any) -> dict[str, Any]:
    return {field.name: _value(message, field) for field in message.DESCRIPTOR.fields}


def _value(message: Any, field: Any) -> Any:
    value = getattr(message, field.name)
    many, nested = hasattr(value, "extend"), field.type == FieldDescriptor.TYPE_MESSAGE
    if many:
        return [_plain(one) for one in value] if nested else list(value)
    return value if not nested else _plain(value) if message.HasField(field.name) else None
