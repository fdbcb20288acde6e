"""row.json: one run as one flat row, written whole or not at all, and the part of it that must repeat.

A row stands in the folder from the first moment, with the status `running`. Where the process that wrote it is gone
without writing another, it is read as `killed`.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from rhs.api.files import replacing
from rhs.base.commands import check_regular
from rhs.base.errors import ConfigError, RhsError
from rhs.config.dictionary import kind_of, rank

from .folders import is_in_use

RUNNING, KILLED = "running", "killed"
LONGEST_TEXT = 4000  # characters of a text in a row
KEYS = ("world", "source", "sensor", "odometry", "loop_closer", "mapper", "planner", "localiser", "seed")
CHOICES = ("task", *KEYS[:-1], "replan", "slam", "degrade")  # all that is chosen by name but the seed; a table may lack some
LAST = 1_000_000  # after every column that somebody described
LARGEST_BYTES = 4 << 20
LARGEST_WHOLE = 2**63 - 1
NOT_REPEATABLE = ("real_time_factor", "peak_memory_mb", "folder", "run", "date", "commit", "version", "versions",
                  "platform", "python", "host", "pid", "started", "picture_failures", "presets")


def machine_dependent(column: str) -> bool:
    """Whether a column may differ between two runs of one config and seed: times, memory, where and when it ran."""
    return column.endswith("_ms") or column in NOT_REPEATABLE or column.startswith("version_")


def begin_row(folder: Path, row: Mapping[str, object]) -> Path:
    """The row of a run that begins now in this process."""
    started = time.strftime("%Y-%m-%dT%H:%M:%S%z")
    return write_row(folder, {**row, "status": RUNNING, "reason": "", "pid": os.getpid(), "started": started})


def sound(columns: Mapping[str, object]) -> dict[str, object]:
    """The columns that a row can hold, long texts cut; what it cannot hold is named in a column of its own."""
    good: dict[str, object] = {}
    bad: list[str] = []
    for name, value in columns.items():
        if isinstance(value, str) and len(value) > LONGEST_TEXT:
            value = f"{value[:LONGEST_TEXT]}... ({len(value)} characters)"
        try:
            good[str(name)] = plain_value(str(name), value)
        except Exception as error:
            bad.append(f"{str(name)[:80]}: {type(error).__name__}: {error}"[:200])
    return good | {"row_failures": "; ".join(bad)[:LONGEST_TEXT]} if bad else good


def encoded(row: Mapping[str, object]) -> str:
    """The row as one line of JSON, unknown as null, infinity as 1e999."""
    return "{" + ", ".join(f"{json.dumps(name)}: {_encode(name, value)}" for name, value in row.items()) + "}"


def write_row(folder: Path, row: Mapping[str, object]) -> Path:
    """Write row.json: fixed order, one value per line, unknown as null, infinity as 1e999 (which JSON allows)."""
    path = Path(folder) / "row.json"
    lines = [f"  {json.dumps(name)}: {_encode(name, row[name])}" for name in sorted(row, key=column_rank)]
    with replacing(path) as file:
        file.write("{\n" + ",\n".join(lines) + "\n}\n")
    return path


def read_row(path: Path) -> dict[str, object]:
    """The row; unknown is None. Raises ConfigError naming the file, and what is wrong with it, when it is not a row.

    A row that says `running` though nobody is at work in its folder is read as `killed`."""
    path = Path(path)
    try:
        check_regular(path)
        if path.stat().st_size > LARGEST_BYTES:
            raise RhsError(f"it is larger than {LARGEST_BYTES >> 20} MB")
        row = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(row, dict):
            raise RhsError(f"it holds a {type(row).__name__}, expected one row as a JSON object")
        if not row.get("status"):
            raise RhsError("it has no status; expected the row of a run")
        row = {name: checked_value(name, value) for name, value in row.items()}
    except (OSError, ValueError, RecursionError, RhsError) as error:
        said = error.strerror if isinstance(error, OSError) else str(error)
        raise ConfigError(f"{path} cannot be read as a row: {said}"[:180]) from error
    if row["status"] == RUNNING and not is_in_use(path.parent):
        row |= {"status": KILLED, "reason": f"its process ended without a word; python -m rhs recover {path.parent}"}
    return row


def plain_value(name: str, value: object) -> object:
    """The value as a row holds it under this name: a number of NumPy as a plain one, true and false as 1 and 0 where a
    number is due. Raises RhsError for one that whoever reads the row would refuse, and with it the row."""
    if not name.isprintable() or name != name.strip() or not name or "," in name:
        raise RhsError(f"{name!r:.80} is no name of a column; write one word, of letters, digits and _")
    if isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0:
        value = value.item()
    if isinstance(value, bool) and kind_of(name) in ("count", "number"):
        value = int(value)
    checked_value(name, value)
    return value


def checked_value(name: str, value: object) -> object:
    """A value that a row may hold under this name, NaN as None. Raises RhsError."""
    if value is not None and not isinstance(value, bool | int | float | str):
        raise RhsError(f"{name} holds a {type(value).__name__}; a row takes numbers, words, true, false or nothing")
    if isinstance(value, str):
        (name + value).encode("utf-8")  # a lone surrogate is no text: a UnicodeEncodeError, which is a ValueError
    if value is None or value != value:
        return None
    kind = kind_of(name)
    if kind == "word" and not isinstance(value, str):
        raise RhsError(f"{name} is {value!r}, expected text")
    if kind in ("count", "number") and isinstance(value, bool | str):
        raise RhsError(f"{name} is {value!r}, expected a number")
    if isinstance(value, int) and abs(value) > LARGEST_WHOLE:
        raise RhsError(f"{name} is a whole number of more than 63 bits")
    if kind == "count" and not float(value).is_integer():  # type: ignore[arg-type]
        raise RhsError(f"{name} is {value!r}, expected a whole number")
    return value


def number_in(row: Mapping[str, object], name: str) -> float:
    """A column as a number; NaN where it is none or unknown."""
    value = row.get(name)
    return float(value) if isinstance(value, int | float) else math.nan


def canonical_hash(row: Mapping[str, object]) -> str:
    """SHA-256 of what must be equal when the same version, config and seed run again."""
    names = sorted(name for name in row if not machine_dependent(name))
    text = "\n".join(f"{json.dumps(name)}: {_encode(name, row[name])}" for name in names)
    return hashlib.sha256(text.encode()).hexdigest()


def column_rank(name: str) -> tuple[int, int, str]:
    """Sort key of a column: the described ones in their order, then others, then machine-dependent ones."""
    place = rank(name)
    if machine_dependent(name):
        return 2, LAST if place is None else place, name
    return (1, 0, name) if place is None else (0, place, name)


def _encode(name: str, value: object) -> str:
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "null"
    if isinstance(value, float) and math.isinf(value):
        return "1e999" if value > 0 else "-1e999"
    if isinstance(value, bool | int | float | str):
        return json.dumps(str(value) if isinstance(value, str) else value)
    raise RhsError(f"column {name} holds a {type(value).__name__}; a row takes numbers, words, true, false or nothing")
