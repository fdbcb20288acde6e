"""Who failed: the plugin, its distribution, the file and the line, in one line; the traceback beside the row."""

from __future__ import annotations

import contextlib
import logging
import os
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType

from rhs.api.files import replacing
from rhs.base.errors import RhsError, printable
from rhs.config import registry
from rhs.config.compose import RunConfig

log = logging.getLogger("rhs")


def in_one_line(error: BaseException, at: str, config: RunConfig) -> str:
    """The reason of a failed run. Where the error was raised in a plugin's own package: its kind and name, where it comes
    from, file and line."""
    said = _said(error)
    text = printable(" ".join(f"{type(error).__name__}{at}: {said}".split()))
    where = _deepest(error.__traceback__, _packages(config))
    if where is None or (isinstance(error, RhsError) and said):
        return text
    who, path, line = where
    return f"{who} failed in {Path(path).parent.name}/{Path(path).name}:{line}: {text}"


def write_traceback(folder: Path, error: BaseException) -> None:
    """traceback.txt: where the run ended, for whoever mends it."""
    with contextlib.suppress(Exception), replacing(folder / "traceback.txt") as file:
        file.write("".join(traceback.format_exception(error)))


@contextlib.contextmanager
def exit_noticed(tell: Callable[[str], None]) -> Iterator[None]:
    """Inside, a part that ends this process by os._exit(0) does not look like success: `tell(reason)` is called first and
    the exit code is 1. Forked children, which end that way by right, are let alone."""
    process, leave = os.getpid(), os._exit
    told: list[int] = []

    def noticed(code: int) -> None:
        if os.getpid() == process and not told:
            told.append(code)
            reason = f"a part ended the process by os._exit({code})"
            with contextlib.suppress(BaseException):
                tell(reason)
            log.error("rhs: failed: %s", reason)
        leave(code or (os.getpid() == process))

    os._exit = noticed  # type: ignore[assignment]
    try:
        yield
    finally:
        os._exit = leave


def _said(error: BaseException) -> str:
    try:
        return str(error)
    except BaseException:
        return "(its text cannot be shown)"


def _packages(config: RunConfig) -> dict[str, str]:
    """Top-level package or module file of each chosen plugin -> `kind=name (origin)`."""
    chosen = {"task": config.task, **config.parts}
    found = {}
    for kind, part in chosen.items():
        origins = registry.origins(kind, part.name)
        from_whom = origins[0].distribution if origins else "unregistered"
        found[type(part.settings).__module__.partition(".")[0] + f"|{kind}"] = f"{kind}={part.name} ({from_whom})"
    return {key: who for key, who in found.items() if not key.startswith("rhs|")}


def _deepest(trace: TracebackType | None, packages: dict[str, str]) -> tuple[str, str, int] | None:
    """The innermost frame that belongs to a chosen plugin's package."""
    found = None
    for frame, line in traceback.walk_tb(trace):
        module = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        who = [text for key, text in packages.items() if key.partition("|")[0] == module]
        if who:
            found = (" or ".join(who), frame.f_code.co_filename, line)
    return found
