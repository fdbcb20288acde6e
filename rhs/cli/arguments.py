"""The words after a command: options with their bounds, `output=FOLDER`, and all others."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rhs.base.commands import Arguments
from rhs.base.errors import check_range

if TYPE_CHECKING:
    from rhs.sweeps.job import Limits


@dataclass(frozen=True)
class Number:
    """An option that takes a number of its default's type between low and high, both allowed."""

    default: float
    low: float
    high: float
    unit: str = ""


Option = Number | str | bool | tuple[str, ...]
JOBS = Number(0, low=0, high=1024)
TIMEOUT = Number(3600.0, low=0.0, high=1e7, unit="s")
LIMITED = {"timeout": "timeout_s", "fail_fast": "same_failures", "memory_mb": "memory_mb", "retries": "retries"}


def parse(command: str, description: str | None, words: Sequence[str], *, positional: Sequence[str] = (),
          **options: Option) -> argparse.Namespace:
    """The options by name, `typed` (the other words), `output` (its folder, or ""), `words` (those typed but it).
    options: name -> default.

    Raises ConfigError for an unknown option and for a number outside its bounds."""
    parser = Arguments(prog=f"python -m rhs {command}", description=description, allow_abbrev=False,
                       formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in positional:
        parser.add_argument(name)
    parser.add_argument("typed", nargs="*", default=[], metavar="word")
    add(parser, options)
    chosen = parser.parse_intermixed_args(list(words))
    check(chosen, options)
    chosen.output = next((word.partition("=")[2] for word in chosen.typed if word.startswith("output=")), "")
    chosen.words = [word for word in chosen.typed if not word.startswith("output=")]
    return chosen


def add(parser: argparse.ArgumentParser, options: Mapping[str, Option]) -> None:
    """One `--name` for each option; those that are False take no value, those that are () may be given several times."""
    for name, default in options.items():
        flag = f"--{name.replace('_', '-')}"
        if isinstance(default, bool):
            parser.add_argument(flag, action="store_true")
        elif isinstance(default, tuple):
            parser.add_argument(flag, action="append", default=[])
        else:
            value = default.default if isinstance(default, Number) else default
            parser.add_argument(flag, type=type(value), default=value)


def check(chosen: argparse.Namespace, options: Mapping[str, Option]) -> None:
    """Refuse numbers outside their bounds."""
    for name, number in options.items():
        if isinstance(number, Number):
            check_range("", f"--{name.replace('_', '-')}", getattr(chosen, name), low=number.low, high=number.high,
                        unit=number.unit)


@contextmanager
def going_on(output: str) -> Iterator[Path]:
    """The folder of a command's runs, claimed. Who interrupts it hears where it is, and how it goes on there."""
    from rhs.runfolder.folders import claim_sweep

    with claim_sweep(output) as claim:
        try:
            yield claim.folder
        except KeyboardInterrupt:
            sys.stdout.write(f"files: {claim.folder}; the same command with output={claim.folder} goes on\n")
            raise


def limits(chosen: argparse.Namespace) -> Limits:
    """The limits of jobs that the options of the command ask for."""
    from rhs.base.system import processors
    from rhs.sweeps.jobs import Limits

    asked = {field: getattr(chosen, option) for option, field in LIMITED.items() if option in chosen}
    return Limits(chosen.jobs or processors(), **asked)
