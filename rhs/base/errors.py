"""The errors a user can meet. Each message says what was found, what was expected and what to type."""

from __future__ import annotations

import difflib
import os
import traceback
from collections.abc import Collection
from enum import EnumMeta
from pathlib import Path


class RhsError(Exception):
    """Any failure that rhs foresaw; shown as one line."""

    exit_code = 1


class ConfigError(RhsError):
    """Refused before anything ran: a setting, a file or a combination of parts is not usable."""

    exit_code = 2


class PluginError(ConfigError):
    """A plugin is unknown, cannot be imported, or shares its name with another."""


class ContractError(RhsError):
    """A part returned something its contract forbids (wrong shape, NaN pose, no status)."""


class EngineError(RhsError):
    """What runs the jobs of a sweep does not work; no job is to blame."""


class RecordingError(RhsError):
    """A recording cannot be read or written."""


def words_of(error: BaseException) -> str:
    """What an error says; of a name that an enumeration lacks, of which Python says the name alone, those that it has.
    Somebody's own may fail as it is asked for its text."""
    kind = getattr(error, "obj", None)
    if isinstance(error, AttributeError) and isinstance(kind, EnumMeta):
        return f"{kind.__name__} has no {error.name}; it has {', '.join(kind.__members__)}"
    try:
        return str(error)
    except BaseException:
        return "(its text cannot be shown)"


def told(error: BaseException) -> str:
    """Type and words of an error, in one line."""
    return " ".join(f"{type(error).__name__}: {words_of(error)}".split()).removesuffix(":")


def where(error: BaseException) -> str:
    """The line of a stranger's file that was called, in brackets; nothing where there is none."""
    frames = [(Path(frame.f_code.co_filename).name, line) for frame, line in traceback.walk_tb(error.__traceback__)
              if not str(frame.f_globals.get("__name__")).startswith("rhs.") and frame.f_code.co_filename[0] != "<"]
    return f" ({frames[0][0]}:{frames[0][1]})" if frames else ""


def nearest(word: str, known: Collection[str], owner: str = "") -> str:
    """`; did you mean x?`, or nothing when no known word is like it. owner: of the known words, put before x."""
    close = difflib.get_close_matches(str(word), known, n=1, cutoff=0.6)
    return f"; did you mean {owner}{'.' * bool(owner)}{close[0]}?" if close else ""


def path_of(value: object, what: str) -> Path:
    """A folder or file that a person named. Raises ConfigError for what names none, such as None."""
    if not isinstance(value, str | os.PathLike) or isinstance(os.fspath(value), bytes):
        raise ConfigError(f"found {value!r:.60} of type {type(value).__name__}; expected {what}, as a text or a Path")
    return Path(value)


# The last word of a name -> the unit that is said of its range.
UNITS = {"m": "m", "m3": "m^3", "s": "s", "ms": "ms", "mps": "m/s", "rad": "rad", "radps": "rad/s", "deg": "degrees",
         "px": "px", "hz": "Hz", "percent": "%", "mb": "MB"}


def unit_of(name: str) -> str:
    """The unit that the end of a setting's name tells, "" of one that tells none."""
    return "" if "_per_" in name else UNITS.get(name.rpartition("_")[2], "")


def check_range(owner: str, name: str, value: float, *, low: float, high: float, unit: str = "") -> None:
    """Refuse a number outside the closed range [low, high]; NaN and infinities are always outside.

    Raises ConfigError naming the key, the value and the allowed range.
    """
    unit_text, key = f" {unit}" if unit else "", f"{owner}.{name}" if owner else name
    try:
        inside = low <= value <= high
    except TypeError:
        raise ConfigError(f"{key}={value!r}: expected a number{unit_text}, found {type(value).__name__}") from None
    if not inside:
        raise ConfigError(f"{key}={value} is outside the allowed range [{low:.10g}, {high:.10g}]{unit_text}")


def check_ranges(owner: str, settings: object, **ranges: tuple[float, float]) -> None:
    """`check_range` of several numbers of one settings object: name=(low, high), the unit read off the end of the name. A
    group nested in other settings passes the owner "", the key it stands under is put before the name when the configuration
    is read."""
    for name, (low, high) in ranges.items():
        check_range(owner, name, getattr(settings, name), low=low, high=high, unit=unit_of(name))


def check_choice(owner: str, name: str, value: str, choices: tuple[str, ...]) -> None:
    """Refuse a word that is not one of `choices`."""
    if value not in choices:
        key = f"{owner}.{name}" if owner else name
        raise ConfigError(f"{key}={value} is not one of {', '.join(choice or repr(choice) for choice in choices)}")
