"""Plugins from a file, tried without packaging: `--plugin my.py planner=mine`.

The file may call `rhs.register(kind, name, cls)` itself. If it does not, a word `kind=name` that nobody answers to is
matched with the plugin dataclass of the file: the one whose name it is, or the only one there is. Its metrics
are used.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import importlib.util
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from rhs.api.contracts import PLUGIN_KINDS
from rhs.api.metric import Metric
from rhs.api.settings import nearest
from rhs.base.errors import ConfigError, PluginError

from . import registry
from .registry import names_in


def carried(chosen: Collection[tuple[str, str]]) -> list[dict[str, str]]:
    """What another process needs to register those of the chosen (kind, name) that were registered by hand in this one, and
    the metrics that were."""
    wanted = {(kind, one) for kind, name in chosen for one in names_in(kind, name)}
    return [{"kind": one.kind, "name": one.name, "class": one.value, "file": one.file} for one in registry.by_hand()
            if (one.kind, one.name) in wanted or one.kind == "metric"]


def loose_names() -> list[str]:
    """What was registered by hand, for a person to give again: no file that was written ever makes this program run
    another."""
    return [f"{one.kind}={one.name} from {one.distribution}" for one in registry.by_hand()]


def take_over(carried: Sequence[Mapping[str, str]]) -> None:
    """Register what `carried` of another process names; what is registered here already stays.

    Raises PluginError for a class that stands in no file, or in one that cannot be run."""
    for one in carried:
        if not _known(one):
            found = _found(one)
            if not _known(one):  # its file may have done it
                registry.register(one["kind"], one["name"], found)


def check_in_files(carried: Sequence[Mapping[str, str]]) -> None:
    """Raises PluginError for the first of them that another process cannot have."""
    for one in carried:
        if not Path(one["file"]).is_file() or "<locals>" in one["class"]:
            raise _nowhere(one, one["class"].partition(":")[2])


def _known(one: Mapping[str, str]) -> bool:
    return any((one["kind"], one["name"]) == (other.kind, other.name) for other in registry.by_hand())


def _found(one: Mapping[str, str]) -> Any:
    """The class, from its module where one can import it, else from its file, which may also register it itself."""
    module_name, _, qualname = one["class"].partition(":")
    if not Path(one["file"]).is_file():
        raise _nowhere(one, qualname)
    found: Any = _imported(module_name, one["file"])
    for part in qualname.split("."):
        found = getattr(found, part, None)
    if found is None and not _known(one):
        raise _nowhere(one, qualname)
    return found


def _nowhere(one: Mapping[str, str], qualname: str) -> PluginError:
    return PluginError(f"{one['kind']}={one['name']}: {qualname} does not stand at the top of a file, so another process "
                       f"cannot have it; write it at the top of a .py file")


def _imported(name: str, file: str) -> ModuleType:
    """The module of this name, if it is of this file; else the file is run."""
    try:
        found = None if name == "__main__" else importlib.import_module(name)
    except ModuleNotFoundError:
        found = None
    return found if found is not None and _is_of(found.__file__, Path(file)) else _load(Path(file))


def load_files(files: Sequence[str], words: Sequence[str]) -> None:
    """Run these files and register the plugins that the words ask for. Raises PluginError in one line."""
    _silent.clear()
    for file in {Path(file).expanduser().resolve(): file for file in files}.values():
        before = registry.by_hand()
        module = _load(Path(file).expanduser())
        _check_none_replaced(before)
        if len(registry.by_hand()) == len(before):
            _silent.append(module)
            for name, value in vars(module).copy().items():
                if metrics := _metrics(value, f"{file}: {name}"):
                    registry.register("metric", f"{module.__name__}_{name}".lower(), metrics)
    registry.registered_from[:] = [_match] if _silent else []
    match(words)


def _check_none_replaced(before: Sequence[registry.Origin]) -> None:
    """Raises PluginError where a file registered anew what another file had."""
    now = {(one.kind, one.name): one.file for one in registry.by_hand()}
    for one in before:
        if (other := now[one.kind, one.name]) != one.file:
            raise PluginError(f"{one.kind}={one.name}: {one.file} and {other} both register it; rename it in one of them")


def _metrics(value: Any, where: str) -> tuple[Metric, ...]:
    """A metric, or several in a tuple or a list; none where it is something else. Raises PluginError for a mixture."""
    held = tuple(value) if isinstance(value, tuple | list) else (value,)
    if not any(isinstance(one, Metric) for one in held):
        return ()
    for one in held:
        if not (isinstance(one, Metric) and isinstance(one.name, str) and callable(one.function)):
            raise PluginError(f"--plugin {where} holds {' '.join(repr(one).split())[:80]}; expected a tuple of "
                              "rhs.api.metric.Metric, each with a name and a function")
    return held


def match(words: Sequence[str]) -> None:
    """Register plugins of the files that registered none themselves, under those `kind=name` that nobody answers to."""
    for kind, name in _unanswered(words) if _silent else ():
        _match(kind, name)


def _match(kind: str, name: str) -> None:
    """Under this name, the class of the files whose name it is, or the only one there is."""
    held = [(called, module) for module in _silent for called, cls in vars(module).items() if _is_plugin(cls, module)]
    found = {called: vars(module)[called] for called, module in held}
    twice = [str(module.__file__) for called, module in held if called == class_name(name)]
    if len(twice) > 1:
        raise PluginError(f"{kind}={name}: {' and '.join(twice)} both hold {class_name(name)}; rename one of them")
    cls = found.get(class_name(name)) or (next(iter(found.values())) if len(found) == 1 else None)
    if cls is None:
        raise PluginError(f"{kind}={name}: {_instead(kind, name, list(found))}")
    registry.register(kind, name, cls)


def _instead(kind: str, name: str, found: list[str]) -> str:
    """What to do about a name that no class of the files has."""
    files = ", ".join(str(module.__file__) for module in _silent)
    if kind == "metric":
        return f"a metric is not chosen; write a tuple of rhs.api.metric.Metric at the top of {files}"
    wanted = class_name(name)
    if any(isinstance(getattr(module, wanted, None), type) for module in _silent):
        return f"{wanted} in {files} is no plugin; write @dataclass over it, and give it build(self, context)"
    if near := nearest(name, [word_name(one) for one in found], kind).replace(f"{kind}.", f"{kind}="):
        return f"{files} has no {wanted}{near}"
    return (f"{files} holds {', '.join(found[:6]) or 'no @dataclass with a build(context)'}"
            f"{', ...' if len(found) > 6 else ''}; write rhs.register({kind!r}, {name!r}, CLASS) in it")


def _unanswered(words: Sequence[str]) -> list[tuple[str, str]]:
    asked = [(kind, one) for kind, _, value in (word.partition("=") for word in words) for name in value.split(",")
             for one in names_in(kind, name)]
    return [(kind, name) for kind, name in asked
            if kind in PLUGIN_KINDS and name.isidentifier() and name not in registry.names(kind)]


_silent: list[ModuleType] = []
_being_read: list[Path] = []


def check_not_being_read() -> None:
    """Raises ConfigError where a file that is read for its plugins runs experiments as it is read."""
    if _being_read:
        raise ConfigError("it is read for its plugins; put what runs experiments under `if __name__ == '__main__':`")


def _load(path: Path) -> ModuleType:
    if not path.is_file():
        raise PluginError(f"--plugin {path}: there is no such file")
    name = _module_name(path)
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise PluginError(f"--plugin {path}: expected a Python file, my_plugin.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    _being_read.append(path)
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginError(f"--plugin {path} cannot be run: {registry.why_not_imported(error)}") from error
    finally:
        _being_read.pop()
    return module


def _module_name(path: Path) -> str:
    """What the module of a file is called: as the file; with a hash of where it stands, where another module has that name:
    `numpy.py` takes nobody's NumPy away, and of two files `my.py` neither is taken for the other."""
    name = re.sub(r"\W", "_", path.stem)
    try:
        there = sys.modules[name].__spec__ if name in sys.modules else importlib.util.find_spec(name)
    except (ImportError, ValueError):
        there = None
    free = _is_of(there.origin, path) if there is not None else name not in sys.modules
    return name if free else f"{name}_{hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]}"


def _is_of(origin: str | None, path: Path) -> bool:
    return origin is not None and Path(origin).resolve() == path.resolve()


def class_name(name: str) -> str:
    """my_planner -> MyPlanner."""
    return "".join(part.capitalize() for part in name.split("_"))


def word_name(name: str) -> str:
    """MyPlanner -> my_planner."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _is_plugin(cls: Any, module: ModuleType) -> bool:
    return (isinstance(cls, type) and dataclasses.is_dataclass(cls) and cls.__module__ == module.__name__
            and callable(getattr(cls, "build", None)))
