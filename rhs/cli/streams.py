"""What a part does to the terminal: streams that it closes are opened again, what it warns of and what fails beside the run
is told in a line each."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any

from rhs.base.commands import LONGEST, plain, shortened
from rhs.base.errors import words_of
from rhs.base.processes import send_again


@contextlib.contextmanager
def streams_kept() -> Iterator[None]:
    """Inside, parts may make of stdout and stderr what they like; afterwards both are open and lead where they led."""
    before = [(number, name, getattr(sys, name), _copy(number)) for number, name in ((1, "stdout"), (2, "stderr"))]
    try:
        yield
    finally:
        for number, name, stream, copy in before:
            with contextlib.suppress(AttributeError, OSError, ValueError):
                stream.flush()
            if copy is not None:
                os.dup2(copy, number)
                os.close(copy)
            lost = copy is not None and getattr(stream, "closed", False)
            setattr(sys, name, open(number, "w", encoding="utf-8", errors="replace") if lost else stream)


def _copy(number: int) -> int | None:
    try:
        return os.dup(number)
    except OSError:  # there is none, or no descriptor is left
        return None


def warnings_in_lines() -> Callable[..., None]:
    """For warnings.showwarning: a line for each place that warns, whatever numbers its text holds."""
    told: set[tuple[object, ...]] = set()

    def show(message: Warning | str, category: type[Warning], file: str, line: int, *_: Any) -> None:
        place = (category, file, line)
        if place not in told or issubclass(category, FutureWarning):  # of old words, all told in one place
            print(warning_in_words(message, category, file, line), file=sys.stderr)
        told.add(place)

    return show


def warning_in_words(message: Warning | str, category: type[Warning], file: str, line: int) -> str:
    """One line: an old word of ours as it is, what a part or a library warns of with where that was."""
    if issubclass(category, FutureWarning):
        return f"rhs: {message}"
    return f"rhs: warning in {_short(file)}:{line}: {category.__name__}: {message}"


def tell_errors_beside() -> None:
    """From now on what is raised in a thread, as an object is let go of or at the end of the process is one line, once for
    each place; Python's own words are a traceback each time."""
    told: set[str] = set()

    def tell(where: str, error: BaseException | None, raised: TracebackType | None) -> None:
        if isinstance(error, KeyboardInterrupt):  # Ctrl-C as a library called back, where nothing can be raised
            send_again(signal.SIGINT if type(error) is KeyboardInterrupt else signal.SIGTERM)
            return
        frames = list(traceback.walk_tb(raised))
        place = f", {_short(frames[-1][0].f_code.co_filename)}:{frames[-1][1]}" if frames else ""
        said = f"rhs: error in {where}{place}: {type(error).__name__}"
        if said not in told:
            told.add(said)
            with contextlib.suppress(Exception):
                print(shortened(plain(f"{said}: {words_of(error)}" if error else said), LONGEST), file=sys.stderr)

    threading.excepthook = lambda one: tell("a thread", one.exc_value, one.exc_traceback)
    sys.unraisablehook = lambda one: tell(getattr(one.object, "__qualname__", "Python"), one.exc_value, one.exc_traceback)


def _short(file: str) -> str:
    return "/".join(Path(file).parts[-2:])

