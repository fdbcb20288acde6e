"""Many runs from Python."""

from __future__ import annotations

import multiprocessing
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from rhs.api import settings
from rhs.api.contracts import PLUGIN_KINDS
from rhs.base.errors import ConfigError, check_range
from rhs.config import registry
from rhs.config.loose import check_in_files
from rhs.config.overrides import parse, quoted
from rhs.patrol.face import check_dicts, check_value, check_words, known_as
from rhs.patrol.observers import meter
from rhs.runfolder.folders import claim_sweep

from . import running, sweep
from .jobs import Limits, Outcome, processors, task_of
from .worker import COMPILING

if TYPE_CHECKING:
    import pandas

PLAIN = re.compile(r"[\w./:+*-]*", re.ASCII)  # texts that need no quotes


def sweep_words(words: Sequence[str] | Mapping[str, Any], *, jobs: int = 0, timeout_s: float = 3600.0,
                quiet: bool = False) -> pandas.DataFrame:
    """rhs.sweep."""
    from rhs.reports.table import rows

    check_words(words)
    if multiprocessing.current_process().daemon:
        raise ConfigError("rhs.sweep: a worker of multiprocessing.Pool may start no processes, and a sweep does; call it in "
                          "the parent, or in a concurrent.futures.ProcessPoolExecutor")
    check_range("", "jobs", jobs, low=0, high=1024)
    check_range("", "timeout_s", timeout_s, low=0.0, high=1e7, unit="s")
    mapped = words.items() if isinstance(words, Mapping) else ()
    typed = [word for key, value in mapped for word in _words(key, value)] or list(words)
    plan = sweep.plan(typed)
    if registry.by_hand():
        check_in_files([one for job in plan.first for one in task_of(job).plugins])
    with claim_sweep(plan.output) as claim, meter(len(plan), quiet=quiet, unit="job") as shown:
        def tell(status: str, outcome: Outcome) -> None:
            shown.update(status not in ("", COMPILING))

        sweep.remember(plan, claim.folder)
        running.run_plan(plan, claim.folder, Limits(jobs or processors(), timeout_s), tell=tell)
        return rows([claim.folder])


def _words(key: str, value: Any) -> Iterator[str]:
    """A key and its value or values as words; a part's settings object as its name, and what is not at its default."""
    value = settings.plain(value) if hasattr(value, "tolist") else value
    items = list(value) if isinstance(value, (list, tuple, range)) else [value]
    if not items:
        raise ConfigError(f"{key}: an empty list has no values to combine")
    for item in items:
        if not settings.is_record(item):
            check_value(key, item)
    if key not in PLUGIN_KINDS or not any(map(settings.is_record, items)):
        yield _as_typed(key, value) if isinstance(value, str) else f"{key}={_typed(value)}"
        return
    changed = list(dict.fromkeys(name for item in items if settings.is_record(item) for name in _changed(key, item)))
    flat = [_flat(settings.plain(item)) if settings.is_record(item) else {} for item in items]
    alike = len({type(item) for item in items}) == 1 and all(name in one for one in flat for name in changed)
    if changed and not alike:
        raise ConfigError(f"{key}: objects in a list are of one class with the same settings, or have their defaults; "
                          f"combine settings by {{'{key}.{changed[0]}': [...]}}")
    words = [f"{key}={','.join(known_as(key, type(item)) if settings.is_record(item) else _typed(item) for item in items)}"]
    words += [f"{key}.{name}={','.join(_literal(one[name]) for one in flat)}" for name in changed]
    yield from words if len(items) == 1 or not changed else [f"zip({' '.join(words)})"]


def _changed(kind: str, part: Any) -> dict[str, Any]:
    """The settings of an object that are not at their defaults, by their dotted names."""
    now, base = settings.plain(part), settings.defaults(type(part))
    check_dicts(kind, now, base)
    before = _flat(base)
    return {name: value for name, value in _flat(now).items() if name not in before or value != before[name]}


def _as_typed(key: str, text: str) -> str:
    """A text as on the command line, where it may hold several values; one that cannot be read as such is taken whole."""
    try:
        parse([f"{key}={text}"])
    except ConfigError:
        return f"{key}={quoted(text)}"
    return f"{key}={text}"


def _flat(values: Mapping[str, Any], owner: str = "") -> dict[str, Any]:
    """Settings by their dotted names."""
    out: dict[str, Any] = {}
    for name, value in values.items():
        key = settings.dotted(owner, name)
        out |= _flat(value, key) if isinstance(value, Mapping) else {key: value}
    return out


def _literal(value: Any) -> str:
    """One value as it is typed: texts quoted, lists in brackets."""
    if isinstance(value, list):
        return f"[{','.join(map(_literal, value))}]"
    return quoted(value) if isinstance(value, str) else _typed(value)


def _typed(value: Any) -> str:
    """A value, or a list or range of values to combine, as one would type it."""
    if isinstance(value, (list, tuple, range)):
        return ",".join(_literal(settings.plain(item)) if not isinstance(item, str) or not PLAIN.fullmatch(item) else item
                        for item in value)
    if isinstance(value, PurePath):
        return quoted(str(value))
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return str(value)
