"""Who failed: the plugin, its distribution, the file and the line, in one line; the traceback beside the row."""

from __future__ import annotations

import contextlib
import logging
import os
import traceback
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from rhs.api.files import replacing
from rhs.base.commands import plain
from rhs.base.errors import RhsError, words_of
from rhs.config.compose import RunConfig
from rhs.config.parts import called

log = logging.getLogger("rhs")


def in_one_line(error: BaseException, at: str, config: RunConfig, parts: Mapping[str, object]) -> str:
    """The reason of a failed run. Where the error was raised inside a part: its kind and name, where it comes from, the file
    and line of its own package. parts: kind -> the part as it was built."""
    if isinstance(error.__cause__, StopIteration):  # what Python makes of one that leaves a generator: next() without an end
        error = error.__cause__
    said = words_of(error)
    text = plain(f"{type(error).__name__}{at}: {said}".removesuffix(": "))
    who, line = raised_in(error, config, parts)
    named = tuple(called(kind, one) for kind, one in {"task": config.task, **config.parts}.items())
    whole = isinstance(error, RhsError) and said and (_by_rhs(error) or said.startswith(named))
    return text if not who or whole else f"{who} failed in {line}: {text}"


def raised_in(error: BaseException, config: RunConfig, parts: Mapping[str, object]) -> tuple[str, str]:
    """The part in which an error was raised, as a person chose it, and the file and line of its own package; or nothing."""
    chosen = {"task": config.task, **config.parts}
    who = {id(part): kind for kind, part in parts.items()}
    classes = {type(one.settings): kind for kind, one in chosen.items()}
    homes = {kind: _package(type(one.settings).__module__) for kind, one in config.parts.items()}
    alone = {home: kind for kind, home in homes.items() if list(homes.values()).count(home) == 1}  # its plain functions
    kind, where = "", ("", 0)
    own: set[str] = set()
    for frame, line in traceback.walk_tb(error.__traceback__):
        first = frame.f_code.co_varnames[0] if frame.f_code.co_argcount else ""  # mostly `self`
        module = _package(str(frame.f_globals.get("__name__", "")))
        self = frame.f_locals.get(first)
        found = who.get(id(self)) or classes.get(type(self)) if first in frame.f_locals else None
        packages = {_package(base.__module__) for base in type(self).__mro__} - {"rhs"} if found else {module}
        if found is None and kind in ("", "task"):
            found = alone.get(module)
        if found and module != "rhs":  # a task's frames stand outside those of the part it asks
            kind, own = found, packages
        if kind and module != "rhs" and (found or module in own):
            where = (frame.f_code.co_filename, line)
    path = Path(where[0])
    return (called(kind, chosen[kind]), f"{path.parent.name}/{path.name}:{where[1]}") if kind else ("", "")


def _by_rhs(error: BaseException) -> bool:
    """Whether rhs itself raised it, which then says whose it is."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    return bool(frames) and _package(str(frames[-1].f_globals.get("__name__", ""))) == "rhs"


def _package(module: str) -> str:
    return module.partition(".")[0]


def write_traceback(folder: Path, error: BaseException) -> None:
    """traceback.txt: where the run ended, for whoever mends it."""
    with contextlib.suppress(Exception), replacing(folder / "traceback.txt") as file:
        file.write("".join(traceback.format_exception(error)))


@contextlib.contextmanager
def exit_noticed(tell: Callable[[str], None]) -> Iterator[None]:
    """Inside, a part that ends this process by os._exit looks neither like success nor like a refusal: `tell(reason)` is
    called first and the exit code is 1, whatever it was to be. Forked children, which end that way by right, are let
    alone."""
    process, leave = os.getpid(), os._exit
    told: list[int] = []

    def noticed(code: int) -> None:
        if os.getpid() == process and not told:
            told.append(code)
            reason = f"a part ended the process by os._exit({code})"
            with contextlib.suppress(BaseException):
                tell(reason)
            log.error("rhs: failed: %s", reason)
        leave(1 if os.getpid() == process else code)

    os._exit = noticed  # type: ignore[assignment]
    try:
        yield
    finally:
        os._exit = leave
