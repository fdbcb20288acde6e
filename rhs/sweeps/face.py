"""Many runs from Python."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rhs.api import settings
from rhs.api.contracts import PLUGIN_KINDS
from rhs.base.errors import ConfigError
from rhs.patrol.face import known_as
from rhs.runfolder.folders import claim_sweep

from . import running, sweep
from .jobs import Limits, processors

if TYPE_CHECKING:
    import pandas


def sweep_words(words: Sequence[str] | Mapping[str, Any], *, jobs: int = 0, timeout_s: float = 3600.0) -> pandas.DataFrame:
    """rhs.sweep."""
    from rhs.reports.table import rows

    if isinstance(words, str):
        raise ConfigError(f"'{words}' is one text; give a list of words, [\"key=value\", ...]")
    mapped = words.items() if isinstance(words, Mapping) else ()
    typed = [word for key, value in mapped for word in _words(key, value)] or list(words)
    plan = sweep.plan(typed)
    with claim_sweep(plan.output) as claim:
        sweep.remember(plan, claim.folder)
        running.run_plan(plan, claim.folder, Limits(jobs or processors(), timeout_s), tell=lambda status, outcome: None)
        return rows([claim.folder])


def _words(key: str, value: Any) -> Iterator[str]:
    """A key and its value or values as words; a part's settings object as its name, and what is not at its default."""
    items = list(value) if isinstance(value, (list, tuple, range)) else [value]
    if key not in PLUGIN_KINDS or not any(map(settings.is_record, items)):
        yield f"{key}={_typed(value)}"
        return
    changed = {name: now for item in items if settings.is_record(item) for name, now in _flat(settings.plain(item)).items()
               if now != _flat(settings.defaults(type(item)))[name]}
    if changed and len(items) > 1:
        one = next(iter(changed))
        raise ConfigError(f"{key}: objects in a list have their defaults; combine settings by {{'{key}.{one}': [...]}}")
    yield f"{key}={','.join(known_as(key, type(item)) if settings.is_record(item) else _typed(item) for item in items)}"
    yield from (f"{key}.{name}={_literal(now)}" for name, now in changed.items())


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
    return repr(value) if isinstance(value, str) else _typed(value)


def _typed(value: Any) -> str:
    """A value, or a list or range of values to combine, as one would type it."""
    if isinstance(value, (list, tuple, range)):
        return ",".join(_typed(item) if not isinstance(item, (list, tuple)) else str(list(item)).replace(" ", "")
                        for item in value)
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return str(value)
