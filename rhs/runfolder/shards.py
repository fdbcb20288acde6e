"""Rows of a sweep whose run folders were not kept: append-only files of checked lines, `rows/TIME-HOST-PID.jsonl`.

A line is the crc32 of its text as 8 hex digits, a blank, one JSON object and a newline:
    run      name of the run, as its folder would be called
    words    key of the words that gave it (`words_key`); of several lines with one key the last counts
    set      values of the settings that the sweep varies, for the columns of the table
    row      the row as in row.json, unknown as null
Whoever sweeps begins a new file, so that the torn end of a killed one never meets an append. A line whose checksum is
wrong is passed over and counted.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import socket
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from rhs.base.errors import ConfigError, RhsError

from .row import encoded

Value = TypeVar("Value")
FOLDER = "rows"
PLAIN = (str, int, float, bool)
SYNC_ROWS, SYNC_S = 1000, 1.0  # the disk is told after so many rows, or so long


def words_key(words: Iterable[str]) -> str:
    """12 hex digits by which the words of a job are known again, whatever their order and where its results go."""
    kept = sorted(word for word in words if word.partition("=")[0] not in ("output", "overwrite"))
    return hashlib.sha256("\n".join(kept).encode()).hexdigest()[:12]


@dataclass(frozen=True)
class Line:
    """One row of a shard."""

    run: str
    words: str
    set: Mapping[str, Any]
    row: Mapping[str, Any]

    def text(self) -> str:
        """As it travels and is written, without its checksum."""
        head = json.dumps({"run": self.run, "words": self.words, "set": dict(self.set)})
        return f'{head[:-1]}, "row": {encoded(self.row)}}}'


def key_of(text: str) -> str:
    """The key of the words in the text of a line; it stands near its head."""
    head = text.find('"words": "') + 10
    return text[head:head + 12]


def parsed(text: str) -> Line:
    """A line back from its text. Raises RhsError, or ValueError where it is no JSON."""
    found = json.loads(text)
    if not (isinstance(found, dict) and isinstance(found.get("row"), dict) and found["row"].get("status")):
        raise RhsError("not a row")
    if not all(value is None or isinstance(value, PLAIN) for value in found["row"].values()):
        raise RhsError("a row takes numbers, words, true, false or nothing")
    return Line(str(found["run"]), str(found["words"]), dict(found.get("set", {})), found["row"])


class Shard:
    """The file that one sweeping process appends to; made with its first row."""

    def __init__(self, sweep: Path) -> None:
        now = time.time()
        when = f"{time.strftime('%Y%m%dT%H%M%S', time.gmtime(now))}.{int(1000 * (now % 1)):03d}"
        name = f"{when}-{socket.gethostname()[:40]}-{os.getpid()}.jsonl"
        self.path = sweep / FOLDER / name
        self._file: Any = None
        self._waiting = 0
        self._synced = time.monotonic()

    def add(self, text: str) -> bool:
        """Append a line; True when all lines so far are on the disk. Raises RhsError naming the file."""
        body = text.encode("utf-8")
        try:
            if self._file is None:
                self.path.parent.mkdir(exist_ok=True)
                self._file = self.path.open("xb")
            self._file.write(b"%08x " % zlib.crc32(body) + body + b"\n")
        except OSError as error:
            raise RhsError(f"{self.path}: {error.strerror}") from error
        self._waiting += 1
        return self.sync(self._waiting >= SYNC_ROWS or time.monotonic() - self._synced >= SYNC_S)

    def sync(self, now: bool = True) -> bool:
        """Have the disk keep what was added, if it is time to; whether it was."""
        if not now or self._file is None:
            return False
        try:
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise RhsError(f"{self.path}: {error.strerror}") from error
        self._waiting, self._synced = 0, time.monotonic()
        return True

    def close(self) -> None:
        """What was added is kept, and the file closed."""
        if self._file is not None:
            try:
                self.sync()
            finally:
                with contextlib.suppress(OSError):
                    self._file.close()
                self._file = None


def shards(sweep: Path) -> list[Path]:
    """The shards of a sweep, the oldest first."""
    return sorted((sweep / FOLDER).glob("*.jsonl"))


def lines_of(path: Path, broken: list[str]) -> Iterator[str]:
    """The texts of the lines that are whole; into `broken` how many are not."""
    torn = 0
    try:
        with path.open("rb") as file:
            for line in file:
                body = line[9:-1]
                if line[-1:] == b"\n" and line[8:9] == b" " and line[:8] == b"%08x" % zlib.crc32(body):
                    yield body.decode("utf-8")
                else:
                    torn += 1
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    if torn:
        broken.append(f"{path}: {torn} line{'s are' if torn > 1 else ' is'} torn")


def from_rows(paths: Sequence[Path], broken: list[str], of: Callable[[Line], Value]) -> dict[str, Value]:
    """Key of the words -> what `of` takes from the last whole line of it. One line is in memory at a time; complaints go
    into `broken`."""
    found: dict[str, Value] = {}
    for path in paths:
        for text in lines_of(path, broken):
            try:
                found[key_of(text)] = of(parsed(text))
            except (ValueError, KeyError, RecursionError, RhsError) as error:
                found.pop(key_of(text), None)
                broken.append(f"a row of {path.parent}: {error}"[:180])
    return found


def read_lines(paths: Sequence[Path], broken: list[str]) -> dict[str, Line]:
    """The same as whole rows."""
    return from_rows(paths, broken, lambda line: line)
