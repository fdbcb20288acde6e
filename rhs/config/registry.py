"""The plugins there are, by entry point. Names cost no import; a plugin is imported when somebody chooses it.

An entry point in the group `rhs.<kind>` names a settings dataclass (rhs.api.contracts), in `rhs.metric` a tuple of
Metric. A plugin that cannot be imported stays listed and says why when it is chosen; two of one name are refused, both
origins named. A plugin may also be registered by the person at the keyboard (`rhs.register`, `--plugin FILE`); a run
then records the file and its hash.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib.util
import inspect
import re
import signal
import sys
import threading
import traceback
import typing
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from rhs.api.contracts import API_VERSION, DEGRADE, PLUGIN_KINDS
from rhs.api.metric import Metric
from rhs.api.settings import RESERVED, nearest, unknown_key, unusable
from rhs.base.errors import ConfigError, PluginError, words_of
from rhs.base.provenance import code_hash

OF_SWEEP = ("engine", "keep", "share", "cache")  # words that say where the jobs of a sweep run and what stays of them
AT_TOP = {*PLUGIN_KINDS, *OF_SWEEP, "experiment", "stack", "hydra"}  # words beside which the settings of a task stand
JOINED = "+"  # between degradations: `degrade=blur+low_light` is one part whose settings stand side by side
REQUIRED = re.compile(r"[A-Za-z_]\w*(\.\w+)*(:.+)?")  # a module, and what pip calls its package where that differs
IMPORT_S = 10.0  # for a plugin that is only listed
OURS = "rhs"  # the distribution


@dataclass(frozen=True)
class Origin:
    """Where a plugin comes from."""

    kind: str
    name: str
    value: str
    distribution: str
    file: str = ""  # of a plugin that was registered by hand

    def __str__(self) -> str:
        return f"{self.value} from {self.distribution}"


_by_hand: dict[tuple[str, str], tuple[type, Origin]] = {}


def register(kind: str, name: str, cls: Any) -> None:
    """A plugin of this process without packaging: from now on `kind=name` chooses it, before any installed one.

    Raises PluginError when the kind is unknown or the class is no plugin."""
    if kind not in PLUGIN_KINDS:
        raise PluginError(f"{kind}: there is no such kind of plugin{nearest(kind, list(PLUGIN_KINDS))}")
    if kind != "metric" and not isinstance(cls, type):
        raise PluginError(f"{kind}={name}: found an object of {type(cls).__name__}; give the class itself")
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
        raise PluginError(f"{kind}={name}: a plugin's name is letters, digits and _")
    cls = (cls,) if isinstance(cls, Metric) else cls
    module, called = _where_it_stands(cls)
    file = getattr(sys.modules.get(module), "__file__", None) or module
    try:
        digest = hashlib.sha256(Path(file).read_bytes()).hexdigest()[:12]
    except OSError:  # typed into a notebook
        digest = "no file"
    origin = Origin(kind, name, f"{module}:{called}", f"{Path(file).name} ({digest})", file)
    _check_plugin(cls, origin)
    _by_hand[kind, name] = cls, origin
    load.cache_clear()
    failure.cache_clear()
    changes.append(name)


def _where_it_stands(plugin: Any) -> tuple[str, str]:
    """The module of a class by name, and its name there; of a tuple of metrics the module of the first one's function."""
    if isinstance(plugin, type):
        return plugin.__module__, plugin.__qualname__
    first = plugin[0] if isinstance(plugin, tuple) and plugin else plugin
    module = getattr(getattr(first, "function", first), "__module__", None) or "__main__"
    there = vars(sys.modules[module]) if module in sys.modules else {}
    return module, next((name for name, value in there.items() if value is plugin), "?")


def sources(task: str, names: Mapping[str, str]) -> list[str]:
    """`kind=name from ...` of the chosen plugins that are not ours: a file, or a distribution, and the hash of its code."""
    chosen = [(kind, one) for kind, name in {"task": task, **names}.items() for one in names_in(kind, name)]
    known = [(kind, one, origins(kind, one)[0]) for kind, one in chosen if origins(kind, one)]
    return [f"{kind}={one} from {origin.distribution}" if origin.file else
            f"{kind}={one} from {origin.distribution} ({code_hash(origin.value.partition(':')[0])})"
            for kind, one, origin in known if origin.file or origin.distribution.partition(" ")[0] != OURS]


def by_hand() -> list[Origin]:
    """The plugins registered by hand in this process."""
    return [origin for _, origin in _by_hand.values()]


def _entry_points(kind: str) -> dict[str, list[EntryPoint]]:
    return _on_path(tuple(sys.path)).get(f"rhs.{kind}", {})


@cache
def _on_path(path: tuple[str, ...]) -> dict[str, dict[str, list[EntryPoint]]]:
    """Group -> name -> the entry points of the distributions on the path, which a process may change; read once for all
    kinds, for every file of every distribution is opened."""
    found: dict[str, dict[str, list[EntryPoint]]] = {}
    installed = entry_points()
    for group in (group for group in installed.groups if group.startswith("rhs.")):
        for point in installed.select(group=group):
            same = found.setdefault(group, {}).setdefault(point.name, [])
            if all((p.value, _distribution(p)) != (point.value, _distribution(point)) for p in same):
                same.append(point)
    if "rhs.task" not in found:  # run from a checkout beside whose libraries nobody installed it
        raise PluginError("rhs is not installed for this Python, so it has no parts; "
                          f"type: {Path(sys.executable).name} -m pip install -e {Path(__file__).parents[2]}")
    return found


def names(kind: str) -> list[str]:
    """Sorted names of all plugins of a kind, usable or not; nothing is imported."""
    return sorted({*_entry_points(kind), *(name for k, name in _by_hand if k == kind)})


def origins(kind: str, name: str) -> list[Origin]:
    """Who registers this name: one, or several that are in each other's way."""
    if (kind, name) in _by_hand:
        return [_by_hand[kind, name][1]]
    if len(names_in(kind, name)) > 1:
        return [origin for one in names_in(kind, name) for origin in origins(kind, one)]
    return [Origin(kind, name, p.value, _distribution(p)) for p in _entry_points(kind).get(name, [])]


def forget() -> None:
    """Look at the installed distributions afresh at the next call, and at no file of --plugin any more."""
    registered_from.clear()
    _on_path.cache_clear()
    load.cache_clear()
    failure.cache_clear()
    changes.append("")


changes: list[str] = []  # what was registered or forgotten; who keeps what follows from it looks at their number
registered_from: list[Callable[[str, str], None]] = []  # what registers kind=name, if a file of --plugin holds it


def in_files(kind: str, name: str) -> bool:
    """Whether a file given by --plugin holds this plugin; from now on it is registered."""
    for find in registered_from:
        find(kind, name)
    return (kind, name) in _by_hand


def elsewhere(name: str) -> str:
    """`; it is ...`, where a plugin of this name is of another kind, or of a group that is none; or nothing."""
    groups = [(group, points[name][0]) for group, points in _on_path(tuple(sys.path)).items() if name in points]
    return f"; {_distribution(groups[0][1])} has it in the entry point group {groups[0][0]}" if groups else ""


@cache
def load(kind: str, name: str) -> type:
    """The settings dataclass of a plugin. Raises PluginError: unknown, registered twice, or not importable."""
    if (kind, name) in _by_hand:
        return _by_hand[kind, name][0]
    if len(several := names_in(kind, name)) > 1:
        if twice := next((one for one in several if several.count(one) > 1), ""):
            raise PluginError(f"{kind}={name}: {twice} stands there twice; name it once")
        return joined(kind, {one: load(kind, one) for one in several})
    where = origins(kind, name)
    if not where and in_files(kind, name):
        return _by_hand[kind, name][0]
    if not where:
        known = names(kind)
        raise PluginError(f"{kind}={name}: there is no such {kind}{elsewhere(name) or nearest(name, known)}"
                          f"{'' if registered_from else '; if it is in a file, add --plugin FILE.py'}"
                          + (f" (available: {', '.join(known)})" if len(known) > 1 else ""))
    if len(where) > 1:
        others = sorted({origin.distribution for origin in where if origin.distribution.partition(" ")[0] != OURS})
        raise PluginError(f"{kind}={name} is registered twice: {' and '.join(map(str, where))}; rename one of them, or "
                          f"uninstall {' or '.join(others)}")
    found: Any = _import(_entry_points(kind)[name][0], where[0])
    found = (found,) if isinstance(found, Metric) else found
    _check_plugin(found, where[0])
    return found  # type: ignore[no-any-return]


@cache
def failure(kind: str, name: str) -> str | None:
    """Why this plugin cannot be used, or None. For lists of plugins that nobody chose: one that takes longer than IMPORT_S
    to import is not waited for."""
    try:
        with _at_most(IMPORT_S):
            check_requirements(kind, name, load(kind, name))
    except PluginError as error:
        return str(error)
    return None


class _TooLong(BaseException):
    """Not an Exception: a module that catches those while it is imported does not catch this."""

    def __str__(self) -> str:
        return f"import took longer than {IMPORT_S:g} s"


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise _TooLong in the block after so many seconds, and every second from then on. In the main thread only: signals
    are not delivered to others."""
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGALRM"):  # not on Windows
        yield
        return

    def ring(number: int, frame: object) -> None:
        raise _TooLong()

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    except _TooLong as error:
        raise PluginError(str(error)) from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def check_requirements(kind: str, name: str, cls: type) -> None:
    """Refuse a plugin whose `requires: ClassVar[tuple[str, ...]]` (import names) are not all installed."""
    wanted = getattr(cls, "requires", ())
    if not isinstance(wanted, tuple | list) or not all(isinstance(one, str) and REQUIRED.fullmatch(one) for one in wanted):
        raise PluginError(f"{kind}={name}: requires is {wanted!r}; expected a tuple of modules to import, as "
                          "(\"scipy\",), or \"module:package\" where pip has another name for it")
    for module in wanted:
        top = module.partition(":")[0].partition(".")[0]
        if importlib.util.find_spec(top) is None:
            package = module.partition(":")[2] or top.replace("_", "-")
            raise PluginError(f"{kind}={name} needs a package that is not installed; type: pip install {package}")


def no_setting(key: str, task: str, known: list[str]) -> ConfigError:
    """A top-level setting that this task does not have: another has it, or nobody."""
    owners = [name for name in names("task") if name != task and failure("task", name) is None
              and key in {item.name for item in dataclasses.fields(load("task", name))}]
    if owners:
        return ConfigError(f"{key}: task={task} has no such setting; task={' and task='.join(owners)} "
                           f"{'have' if len(owners) > 1 else 'has'}")
    return unknown_key("", key, known, also=OF_SWEEP)


def _import(point: EntryPoint, origin: Origin) -> Any:
    try:
        return point.load()
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a plugin may even call sys.exit() while it is imported
        raise PluginError(f"{origin.kind}={origin.name} ({origin}) cannot be imported: "
                          f"{why_not_imported(error, own=origin.value)}") from error


def why_not_imported(error: BaseException, own: str = "") -> str:
    """What went wrong while a module was imported, in which line of which file, and what to install, in one line. own: what
    an entry point names, `module:class`."""
    if isinstance(error, _TooLong):
        return str(error)
    said = f"{type(error).__name__}: {(words_of(error).strip().splitlines() or [''])[0][:120]}"
    if isinstance(error, ModuleNotFoundError) and error.name and f"{own.partition(':')[0]}.".startswith(f"{error.name}."):
        return f"{said}; right the entry point, module:class"
    if isinstance(error, AttributeError) and isinstance(error.obj, ModuleType):  # the file: two packages may have one name
        return f"{said} ({getattr(error.obj, '__file__', None)}){nearest(str(error.name), dir(error.obj))}"
    top = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if top and top not in sys.modules:
        return f"{said}; type: pip install {top.replace('_', '-')}"
    frames = [(Path(frame.f_code.co_filename), line) for frame, line in traceback.walk_tb(error.__traceback__)
              if "importlib" not in frame.f_code.co_filename and not frame.f_globals["__name__"].startswith("rhs.")]
    inside = [one for one in frames if one[0].parent.is_relative_to(frames[0][0].parent)]
    return said if isinstance(error, SyntaxError) or not inside else f"{said} ({inside[-1][0].name}:{inside[-1][1]})"


def _check_plugin(cls: Any, origin: Origin) -> None:
    who = f"{origin.kind}={origin.name} ({origin})"
    if origin.kind == "metric":
        _check_metrics(cls, who)
        return
    if not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise PluginError(f"{who} is not a dataclass; name the settings dataclass in the entry point")
    plugin: Any = cls
    try:
        inspect.signature(plugin.build).bind("self", "context")
    except (AttributeError, TypeError):
        raise PluginError(f"{who} has no build(self, context)") from None
    api = getattr(cls, "api", API_VERSION)
    if not isinstance(api, int):
        raise PluginError(f"{who}: api is {api!r}; expected the number of the plugin API it was written for, {API_VERSION}")
    if api > API_VERSION:
        raise PluginError(f"{who} was written for plugin API {api}; this rhs has {API_VERSION}: upgrade rhs")
    for word in ("needs", "provides"):
        value = getattr(cls, word, None)
        if not isinstance(value, (frozenset, set)) or not all(isinstance(v, str) for v in value):
            raise PluginError(f"{who} declares no {word}; write `{word}: ClassVar[frozenset[str]] = frozenset()`")
    preload = getattr(cls, "preload", ())
    if not isinstance(preload, tuple | list) or not all(isinstance(one, str) for one in preload):
        raise PluginError(f"{who}: preload is {preload!r}; expected a tuple of modules to import, as (\"scipy\",)")
    if origin.kind == "task" and not isinstance(getattr(cls, "kinds", None), tuple | list):
        raise PluginError(f'{who} declares no kinds; write `kinds: ClassVar[tuple[str, ...]] = ("planner",)`, those it has')
    if origin.kind == "task" and (wrong := sorted(set(plugin.kinds) - set(PLUGIN_KINDS))):
        raise PluginError(f"{who}: there is no kind {wrong[0]}{nearest(wrong[0], list(PLUGIN_KINDS))}")
    if origin.kind == "task" and (taken := AT_TOP & {item.name for item in dataclasses.fields(cls)}):
        raise PluginError(f"{who} has a setting called {min(taken)}, which rhs uses itself; rename it")
    try:
        said = unusable(cls)
    except NameError as error:  # an annotation that stands under `if TYPE_CHECKING`
        raise PluginError(f"{who} has a setting whose type cannot be looked up: {error}; import it at the top") from error
    if said:
        raise PluginError(f"{who}: {said}")


def _check_metrics(found: Any, who: str) -> None:
    if not (isinstance(found, tuple) and found and all(isinstance(item, Metric) for item in found)):
        raise PluginError(f"{who} is not a tuple of rhs.api.metric.Metric")


def _distribution(point: EntryPoint) -> str:
    return _name_of(point.dist) if point.dist is not None else "an unknown distribution"


@cache
def _name_of(distribution: Distribution) -> str:
    """Name and version; read once for all entry points of a distribution, which share one object."""
    return f"{distribution.name} {distribution.version}"


def names_in(kind: str, name: str) -> list[str]:
    """The plugins that a name stands for: one, or of degradations as many as it joins."""
    return name.split(JOINED) if kind == DEGRADE else [name]


def joined(kind: str, members: dict[str, type]) -> type:
    """One settings dataclass for these plugins; each of its settings is one of theirs.

    Raises PluginError where two of them have a setting of one name."""
    hints = {name: typing.get_type_hints(cls) for name, cls in members.items()}
    owner: dict[str, str] = {}
    fields: list[Any] = []
    for name, cls in members.items():
        for item in dataclasses.fields(cls):
            if not item.init or item.name in RESERVED:
                continue
            if item.name in owner:
                raise PluginError(f"{kind}={JOINED.join(members)}: {owner[item.name]} and {name} both have a setting "
                                  f"{item.name}; rename it in one of them")
            owner[item.name] = name
            fields.append((item.name, hints[name][item.name], _default(item)))

    def check(self: Any) -> None:
        members_of(self)

    named = {"needs": frozenset().union(*(cls.needs for cls in members.values())),  # type: ignore[attr-defined]
             "provides": frozenset(), "members": members, "__post_init__": check}
    return dataclasses.make_dataclass("Joined", fields, namespace=named)


def _default(item: dataclasses.Field[Any]) -> Any:
    if item.default is not dataclasses.MISSING:
        return dataclasses.field(default=item.default)
    return dataclasses.field(default_factory=item.default_factory)  # type: ignore[arg-type]


def members_of(settings: Any) -> list[Any]:
    """The settings of each plugin that joined settings stand for, each checked by its own rules; of one plugin its own."""
    members = getattr(settings, "members", None)
    if members is None:
        return [settings]
    return [cls(**{item.name: getattr(settings, item.name) for item in dataclasses.fields(cls) if item.init})
            for cls in members.values()]


def no_setting_of(kind: str, name: str, key: str, known: list[str]) -> ConfigError:
    """The error for a setting that this part has not; another of its kind is named if it is the only one that has it."""
    usable = [one for one in names(kind) if failure(kind, one) is None]
    owners = [one for one in usable if key in {item.name for item in dataclasses.fields(load(kind, one))}]
    if key not in known and len(owners) == 1:
        return ConfigError(f"unknown key {kind}.{key}: {kind}={name} has no such setting; type {kind}={owners[0]} too")
    return unknown_key(kind, key, known)
