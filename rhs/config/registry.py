"""The plugins there are, by entry point. Names cost no import; a plugin is imported when somebody chooses it.

An entry point in the group `rhs.<kind>` names a settings dataclass (rhs.contracts). A plugin that cannot be imported
stays listed and says why when it is chosen; two of one name are refused, both origins named.
"""

from __future__ import annotations

import dataclasses
import importlib.util
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from rhs.api.contracts import KINDS
from rhs.base.errors import PluginError

from .settings import RESERVED, defaults, nearest

API_VERSION = 1  # a plugin may declare `api: ClassVar[int]`; a newer one than this is refused


@dataclass(frozen=True)
class Origin:
    """Where a plugin comes from."""

    kind: str
    name: str
    value: str
    distribution: str

    def __str__(self) -> str:
        return f"{self.value} from {self.distribution}"


@cache
def _entry_points(kind: str) -> dict[str, list[EntryPoint]]:
    found: dict[str, list[EntryPoint]] = {}
    for point in entry_points(group=f"rhs.{kind}"):
        same = found.setdefault(point.name, [])
        if all((p.value, _distribution(p)) != (point.value, _distribution(point)) for p in same):
            same.append(point)
    return found


def names(kind: str) -> list[str]:
    """Sorted names of all plugins of a kind, usable or not; nothing is imported."""
    return sorted(_entry_points(kind))


def origins(kind: str, name: str) -> list[Origin]:
    """Who registers this name: one, or several that are in each other's way."""
    return [Origin(kind, name, p.value, _distribution(p)) for p in _entry_points(kind).get(name, [])]


def forget() -> None:
    """Look at the installed distributions afresh at the next call."""
    _entry_points.cache_clear()
    load.cache_clear()


@cache
def load(kind: str, name: str) -> type:
    """The settings dataclass of a plugin. Raises PluginError: unknown, registered twice, or not importable."""
    where = origins(kind, name)
    if not where:
        known = names(kind)
        raise PluginError(f"{kind}={name}: there is no such {kind}{nearest(name, known)}"
                          + (f" (available: {', '.join(known)})" if len(known) > 1 else ""))
    if len(where) > 1:
        raise PluginError(f"{kind}={name} is registered twice: {' and '.join(map(str, where))}; uninstall one of them")
    cls = _import(_entry_points(kind)[name][0], where[0])
    _check_plugin(cls, where[0])
    return cls


def failure(kind: str, name: str) -> str | None:
    """Why this plugin cannot be used, or None."""
    try:
        check_requirements(kind, name, load(kind, name))
    except PluginError as error:
        return str(error)
    return None


def check_requirements(kind: str, name: str, cls: type) -> None:
    """Refuse a plugin whose `requires: ClassVar[tuple[str, ...]]` (import names) are not all installed."""
    for module in getattr(cls, "requires", ()):
        if importlib.util.find_spec(module.partition(":")[0]) is None:
            package = module.partition(":")[2] or module.replace("_", "-")
            raise PluginError(f"{kind}={name} needs a package that is not installed; type: pip install {package}")


def _import(point: EntryPoint, origin: Origin) -> Any:
    try:
        return point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin may even call sys.exit() while it is imported
        raise PluginError(f"{origin.kind}={origin.name} ({origin}) cannot be imported: "
                          f"{type(error).__name__}: {_first_line(error)}") from error


def _check_plugin(cls: Any, origin: Origin) -> None:
    who = f"{origin.kind}={origin.name} ({origin})"
    if not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise PluginError(f"{who} is not a dataclass; name the settings dataclass in the entry point")
    if not callable(getattr(cls, "build", None)):
        raise PluginError(f"{who} has no build(context)")
    api = getattr(cls, "api", API_VERSION)
    if api > API_VERSION:
        raise PluginError(f"{who} was written for plugin API {api}; this rhs has {API_VERSION}: upgrade rhs")
    for word in ("needs", "provides"):
        value = getattr(cls, word, None)
        if not isinstance(value, (frozenset, set)) or not all(isinstance(v, str) for v in value):
            raise PluginError(f"{who} declares no {word}; write `{word}: ClassVar[frozenset[str]] = frozenset()`")
    for item in dataclasses.fields(cls):
        if item.name in RESERVED:
            raise PluginError(f"{who} has a setting called {item.name}, which rhs uses itself; rename it")
    defaults(cls)


def _distribution(point: EntryPoint) -> str:
    return f"{point.dist.name} {point.dist.version}" if point.dist is not None else "an unknown distribution"


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [""])[0][:120]


def kinds() -> tuple[str, ...]:
    return KINDS
