"""What every command line tool shares: complaints are one line, whatever went wrong; special files are refused unopened."""

from __future__ import annotations

import argparse
import errno
import os
import re
import stat
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path

from .errors import ConfigError, RhsError, nearest, told

INTERRUPTED = 130
LONGEST = 250  # characters of a complaint
POINTER = b"version https://git-lfs"
_FOLDERS = re.compile(r"^([\w.]*=)?[^:]*/([^/:]+)(?=:)")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\ud800-\udfff]+")


class Arguments(argparse.ArgumentParser):
    """argparse whose complaints are one line and exit code 2. An option nobody knows is named before anything that is
    missing: it may be what was meant for it."""

    def parse_known_args(self, args=None, namespace=None):
        args = sys.argv[1:] if args is None else list(args)
        for word in args[: args.index("--")] if "--" in args else args:
            name = word.partition("=")[0]
            known = self._option_string_actions
            begun = self.allow_abbrev and any(one.startswith(name) for one in known)
            if name.startswith("--") and not begun and name not in known:
                raise ConfigError(f"unknown option {name}{nearest(name, known) or f'; see {self.prog} --help'}")
        return super().parse_known_args(args, namespace)

    def error(self, message: str):
        raise ConfigError(f"{message}; see {self.prog} --help")


def answered(work: Callable[[], int], *, debug: bool | None = None) -> int:
    """The exit code of a command; what it raises becomes one line on stderr and an exit code. debug: with the traceback,
    and the line whole; None: as the command line says."""
    try:
        return work()
    except RhsError as error:
        return complain(str(error), error.exit_code, error, debug=debug)
    except KeyboardInterrupt as error:
        return complain("interrupted; what was finished is kept", signal_code(error), error, debug=debug)
    except SystemExit as error:
        frames = [(frame.f_globals.get("__name__", ""), frame.f_code.co_filename, line)
                  for frame, line in traceback.walk_tb(error.__traceback__)]
        name, file, line = [one for one in frames if one[0] != "argparse"][-1]  # which ends a command after its --help
        if name.partition(".")[0] == "rhs":
            raise
        return complain(f"SystemExit: {error.code} ({file}:{line}); a part ended the command", 1, error, debug=debug)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except BaseException as error:  # what a part raises may be no Exception
        said = not_written(error) if isinstance(error, OSError) else ""
        return complain(said or f"{told(error)} (--debug shows where)", 1, error, debug=debug)


def complain(text: str, code: int, error: BaseException | None = None, *, debug: bool | None = None) -> int:
    """Write one line of text to stderr, as every command begins it; returns the code. error: whose traceback is shown by
    --debug."""
    debug = "--debug" in sys.argv if debug is None else debug
    if debug and error is not None:
        traceback.print_exception(error)
    text = plain(text)
    if len(text) > LONGEST and not debug:
        text = f"{shortened(text, LONGEST - 20)} (--debug: all of it)"
    sys.stderr.write(f"rhs: {text}\n")
    return code


def signal_code(error: BaseException) -> int:
    """Exit code of what was interrupted: by SIGTERM or by Ctrl-C."""
    return int(getattr(error, "exit_code", INTERRUPTED))


def not_written(error: OSError) -> str:
    """What to do about a disk that is full or cannot be written to; empty for another error."""
    if error.errno not in (errno.EROFS, errno.ENOSPC, errno.EDQUOT):
        return ""
    where = f" {error.filename}" if error.filename else ""
    return f"cannot write{where}: {error.strerror}; free some space, or go to another folder or name one by output=FOLDER"


def shortened(text: str, most: int = LONGEST) -> str:
    """Text of at most that many characters. Where it is too long and begins with a file, the file's folders go first; then
    what stands before the last `; `, behind which it says what to type."""
    if len(text) > most:
        text = _FOLDERS.sub(r"\1.../\2", text)
    if len(text) <= most:
        return text
    said, _, advice = text.rpartition("; ")
    room = most - len(advice) - 5
    if said and room >= most // 3:
        return f"{_words(said, room)}...; {advice}"
    return f"{_words(text, most - 3)}..."


def _words(text: str, most: int) -> str:
    """The first whole words of a text."""
    begun, cut = text[:most], text[:most].rpartition(" ")[0]
    return begun if text[most:most + 1] in ("", " ") or len(begun) - len(cut) > most // 3 else cut


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
