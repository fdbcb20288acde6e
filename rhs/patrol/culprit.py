"""Who failed: the plugin, its distribution, the file and the line, in one line; the traceback beside the row."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from pathlib import Path

from rhs.api.files import replacing
from rhs.base.errors import RhsError
from rhs.config import registry
from rhs.config.compose import RunConfig


def in_one_line(error: BaseException, at: str, config: RunConfig, parts: Mapping[str, object]) -> str:
    """The reason of a failed run. Where the error was raised inside a part: its kind and name, where it comes from, the file
    and line of its own package. parts: kind -> the part as it was built."""
    text = " ".join(f"{type(error).__name__}{at}: {_said(error)}".split())
    chosen = {"task": config.task, **config.parts}
    who = {id(part): kind for kind, part in parts.items()} | {id(one.settings): kind for kind, one in chosen.items()}
    kind, package, where = "", "", ("", 0)
    for frame, line in traceback.walk_tb(error.__traceback__):
        owner = frame.f_locals.get("self")
        module = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if not kind and id(owner) in who and module != "rhs":
            kind, package = who[id(owner)], module
        if kind and module == package:
            where = (frame.f_code.co_filename, line)
    if not kind or (isinstance(error, RhsError) and str(error)):
        return text
    name = chosen[kind].name
    origins = registry.origins(kind, name)
    path = Path(where[0])
    return (f"{kind}={name} ({origins[0].distribution if origins else 'unregistered'}) failed in "
            f"{path.parent.name}/{path.name}:{where[1]}: {text}")


def write_traceback(folder: Path, error: BaseException) -> None:
    """traceback.txt: where the run ended, for whoever mends it."""
    with replacing(folder / "traceback.txt") as file:
        file.write("".join(traceback.format_exception(error)))


def _said(error: BaseException) -> str:
    try:
        return str(error)
    except Exception:
        return "(its text cannot be shown)"
