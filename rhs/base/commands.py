"""What every command line tool shares: complaints are one line, whatever went wrong; special files are refused unopened."""

from __future__ import annotations

import argparse
import os
import re
import stat
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from .errors import ConfigError, RhsError

INTERRUPTED = 130
LONGEST = 190  # characters of a complaint
POINTER = b"version https://git-lfs"
_FOLDERS = re.compile(r"^([\w.]*=)?[^:]*/([^/:]+)(?=:)")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]+")


class Arguments(argparse.ArgumentParser):
    """argparse whose complaints are one line and exit code 2."""

    def error(self, message: str):
        raise ConfigError(f"{message}; see {self.prog} --help")


def answered(work: Callable[[], int]) -> int:
    """The exit code of a command; what it raises becomes one line on stderr and an exit code."""
    try:
        return work()
    except RhsError as error:
        return complain(str(error), error.exit_code)
    except KeyboardInterrupt as error:
        return complain("interrupted", getattr(error, "exit_code", INTERRUPTED))
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        return complain(f"{type(error).__name__}: {error}", 1)


def complain(text: str, code: int) -> int:
    """Write one line of text to stderr, as every command begins it; returns the code."""
    sys.stderr.write(f"rhs: {shortened(plain(text))}\n")
    return code


def shortened(text: str, most: int = LONGEST) -> str:
    """Text of at most that many characters. Where it is too long and begins with a file, the file's folders go first: what
    to type stands at the end."""
    if len(text) > most:
        text = _FOLDERS.sub(r"\1.../\2", text)
    return text if len(text) <= most else f"{text[:most - 3]}..."


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """A line for each row of words, in columns as wide as their longest word."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in rows]


def plain(text: str) -> str:
    """Text on one line without control characters, which a terminal would obey."""
    return " ".join(_CONTROL.sub(" ", text).split())


def check_regular(path: Path | str) -> None:
    """Refuse a FIFO, device or socket, whose reading may never end. What is missing is left to who opens it."""
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise ConfigError(f"{path} is a device, pipe or socket; expected a file or a folder")


def check_whole(path: Path) -> None:
    """Refuse the few lines that Git LFS leaves in the place of a large file that was not fetched."""
    with path.open("rb") as file:
        if file.read(len(POINTER)) == POINTER:
            raise ConfigError(f"{path}: a pointer of Git LFS, not the file itself; type `git lfs pull` where it lies")
