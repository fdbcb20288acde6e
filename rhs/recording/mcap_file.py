"""ROS 2 messages into an MCAP file: channels as they are needed, one clear line when the disk refuses."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rhs.api.files import free_space
from rhs.base.errors import RecordingError

from . import ros

PACKING = 1  # zstd's level: of pictures and depth as small as its usual 3, in a third of the time


class _Zstd:
    """What mcap's writer calls of zstandard, at our level; it offers no choice."""

    @staticmethod
    def compress(data: bytes) -> bytes:
        import zstandard

        return zstandard.ZstdCompressor(level=PACKING).compress(data)


class _Indices:
    """The list of chunks that mcap's writer puts at the end of the file, as the bytes it ends up as: its own records are
    ten times larger, and there is one for each view or two."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def append(self, index: Any) -> None:
        from mcap.data_stream import RecordBuilder

        builder = RecordBuilder()
        index.write(builder)
        self._bytes += builder.end()

    def __iter__(self) -> Iterator[_Indices]:
        yield self

    def write(self, builder: Any) -> None:
        builder.write(self._bytes)


class McapWriter:
    """An MCAP file being written. Each chunk reaches the file when it is full; a crash costs the last one."""

    def __init__(self, path: Path, chunk_bytes: int = 1 << 20):
        from mcap import writer

        writer.zstandard = _Zstd  # type: ignore[assignment]
        self._path = Path(path)
        self._channels: dict[str, int] = {}
        self._closed = False
        self._file: Any = None
        with self._guarded():
            self._file = self._path.open("wb")
            self._writer = writer.Writer(self._file, chunk_size=chunk_bytes, compression=writer.CompressionType.ZSTD,
                                         enable_data_crcs=True)
            self._writer._Writer__chunk_indices = _Indices()  # type: ignore[attr-defined]
            self._writer.start(profile="ros2", library="rhs")

    @property
    def empty(self) -> bool:
        """Nothing was put yet."""
        return not self._channels

    def put(self, topic: str, message: Any, stamp_ns: int) -> None:
        """Append a ROS 2 message of rhs.ros."""
        kind = message.__msgtype__
        definition = (kind, "ros2msg", ros.definition(kind))
        self.put_raw(topic, ros.serialize(message), stamp_ns, definition=definition)

    def put_raw(self, topic: str, data: bytes, stamp_ns: int, *, definition: tuple[str, str, bytes],
                encoding: str = "cdr", publish_ns: int | None = None, sequence: int = 0) -> None:
        """Append bytes as they are. definition: name, encoding and text of the schema, used at a topic's first message."""
        if self._closed:
            return
        with self._guarded():
            if topic not in self._channels:
                schema = self._writer.register_schema(*definition) if definition[0] else 0
                self._channels[topic] = self._writer.register_channel(topic, encoding, schema,
                                                                      {"offered_qos_profiles": ""})
            self._writer.add_message(self._channels[topic], log_time=stamp_ns, data=data, sequence=sequence,
                                     publish_time=stamp_ns if publish_ns is None else publish_ns)

    def note(self, name: str, values: dict[str, str]) -> None:
        """Append a metadata record."""
        if not self._closed:
            with self._guarded():
                self._writer.add_metadata(name, values)

    def flush(self) -> None:
        """Hand what is written to the operating system: it survives the process."""
        if not self._closed:
            with self._guarded():
                self._file.flush()

    def close(self) -> None:
        """Write the index. Once."""
        if not self._closed:
            with self._guarded():
                self._writer.finish()
                self._file.close()
            self._closed = True

    @contextlib.contextmanager
    def _guarded(self) -> Iterator[None]:
        """Turn a refusing disk into one clear line, and stop writing: what is in the file stays readable."""
        try:
            yield
        except OSError as error:
            self._closed = True
            with contextlib.suppress(OSError, AttributeError):
                self._file.close()
            raise RecordingError(f"cannot write {self._path}: {error.strerror or error} ({free_space(self._path)}); "
                                 f"free some space or use recording=off") from error


def __getattr__(name: str) -> Any:
    """Names of before."""
    if name == "Tape":
        warnings.warn("rhs.recording.mcap_file.Tape is now McapWriter", DeprecationWarning, stacklevel=2)
        return McapWriter
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
