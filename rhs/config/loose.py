"""Plugins from a file, tried without packaging: `--plugin my.py planner=mine`.

The file may call `rhs.register(kind, name, cls)` itself. If it does not, a word `kind=name` that nobody answers to is
matched with the plugin dataclass of the file: the one whose name it is, or the only one there is.
"""

from __future__ import annotations

import dataclasses
import importlib.util
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from rhs.api.contracts import PLUGIN_KINDS
from rhs.base.errors import PluginError

from . import registry

_loaded: dict[str, None] = {}


def load_files(files: Sequence[str], words: Sequence[str]) -> None:
    """Run these files and register the plugins that the words ask for. Raises PluginError in one line."""
    for file in files:
        path = Path(file).expanduser()
        before = len(registry.by_hand())
        module = _load(path)
        if len(registry.by_hand()) == before:
            _match(module, words)
        _loaded[str(path.absolute())] = None


def loaded() -> list[str]:
    """The files that were loaded in this process, for the jobs of a sweep. No file of data ever names one."""
    return list(_loaded)


def _load(path: Path) -> ModuleType:
    if not path.is_file():
        raise PluginError(f"--plugin {path}: there is no such file")
    name = re.sub(r"\W", "_", path.stem)
    spec = importlib.util.spec_from_file_location(name, path.resolve())
    if spec is None or spec.loader is None:
        raise PluginError(f"--plugin {path}: expected a Python file, my_plugin.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        raise PluginError(f"--plugin {path} cannot be run: {type(error).__name__}: {error}") from error
    return module


def _match(module: ModuleType, words: Sequence[str]) -> None:
    """Register the file's plugin under the words that nobody answers to."""
    found = {name: cls for name, cls in vars(module).items() if _is_plugin(cls, module)}
    asked = []
    for word in words:
        kind, _, value = word.partition("=")
        asked += [(kind, name) for name in value.split(",")
                  if kind in PLUGIN_KINDS and name.isidentifier() and name not in registry.names(kind)]
    for kind, name in asked:
        cls = found.get(_class_name(name)) or (next(iter(found.values())) if len(found) == 1 else None)
        if cls is None:
            raise PluginError(f"{kind}={name}: {module.__file__} holds {', '.join(found) or 'no plugin dataclass'}; "
                              f"write rhs.register({kind!r}, {name!r}, CLASS) in it")
        registry.register(kind, name, cls)


def _class_name(name: str) -> str:
    return "".join(part.capitalize() for part in name.split("_"))


def _is_plugin(cls: Any, module: ModuleType) -> bool:
    return (isinstance(cls, type) and dataclasses.is_dataclass(cls) and cls.__module__ == module.__name__
            and callable(getattr(cls, "build", None)))
