"""Where Hydra finds our configuration: conf/ read strictly, and plugins as config groups, imported when chosen.

Two ConfigSources stand in the search path, before anything else: `rhs-conf://` reads YAML by rhs.strict_yaml, and
`rhs-plugins://` serves `<kind>/<entry point name>` from the defaults of the plugin's dataclass. Listing names imports
nothing. They serve one composition at a time: the one that rhs.hydra_glue has put into `under_way`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.object_type import ObjectType
from hydra.errors import ConfigCompositionException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import OmegaConf

from rhs.api import settings
from rhs.api.contracts import CHOICES
from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import load_yaml

from . import registry
from .composed import names_in
from .overrides import GROUPS

DEFAULT_STACK = "rgbd"  # what a sensor without a stack file of its own gets


@dataclass
class UnderWay:
    """The composition under way: its conf folders (first wins), the core's own defaults, and the YAML files it has read."""

    folders: list[Path] = field(default_factory=list)
    schema: dict[str, Any] | None = None
    files: list[Path] = field(default_factory=list)


under_way = UnderWay()


class ConfSource(ConfigSource):
    """A folder of YAML files, read strictly."""

    @staticmethod
    def scheme() -> str:
        return "rhs-conf"

    @property
    def folder(self) -> Path:
        return Path(self.path)

    def available(self) -> bool:
        return self.folder.is_dir()

    def _file(self, config_path: str) -> Path:
        file = self.folder / self._normalize_file_name(config_path)
        group, _, name = config_path.removesuffix(".yaml").partition("/")
        if group == "stack" and not file.is_file() and (sensor := _sensor_of(name)):
            own = _stack(self.folder, sensor)
            return own if own.is_file() else _stack(self.folder, DEFAULT_STACK)
        return file

    def is_group(self, config_path: str) -> bool:
        return config_path in GROUPS or (self.folder / config_path).is_dir()

    def is_config(self, config_path: str) -> bool:
        return self._file(config_path).is_file()

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        found: list[str] = []
        base = self.folder / config_path
        for item in sorted(base.iterdir()) if base.is_dir() else []:
            if item.is_dir() or item.suffix == ".yaml":
                self._list_add_result(found, f"{config_path}/{item.name}".lstrip("/"), item.name, results_filter)
        return sorted(set(found))

    def load_config(self, config_path: str) -> ConfigResult:
        path = self._file(config_path)
        try:
            content = load_yaml(path)
            under_way.files.append(path)
        except ConfigError as error:
            raise ConfigCompositionException(str(error)) from error
        if content is None:
            content = {}
        if not isinstance(content, dict):
            raise ConfigCompositionException(f"{path}: expected `key: value` lines, found a {type(content).__name__}")
        if config_path.startswith("experiment/"):
            content = {key: value for key, value in content.items() if key != "sweep"}  # for hydra_glue.experiment_sweep
        header = self._get_header_dict(path.read_text("utf-8-sig"))
        if config_path.removesuffix(".yaml") == "config" and under_way.schema is not None:
            own = {k: v for k, v in content.items() if k != "defaults"}
            content = {**under_way.schema, **own, "defaults": content.get("defaults", [])}
        return _result(self, content, header)


class PluginSource(ConfigSource):
    """`<kind>/<name>` for every registered plugin, and `stack/<sensor>_<source>` for sensors that have no stack file."""

    @staticmethod
    def scheme() -> str:
        return "rhs-plugins"

    @staticmethod
    def _split(config_path: str) -> tuple[str, str]:
        kind, _, name = config_path.strip("/").removesuffix(".yaml").partition("/")
        return kind, name

    def available(self) -> bool:
        return True

    def is_group(self, config_path: str) -> bool:
        kind, name = self._split(config_path)
        return kind in CHOICES and not name

    def is_config(self, config_path: str) -> bool:
        kind, name = self._split(config_path)
        if kind == "stack":
            sensor = _sensor_of(name)
            has_file = any(_stack(folder, stem).is_file() for folder in under_way.folders for stem in (name, sensor))
            return bool(sensor) and not has_file
        return kind in CHOICES and bool(name) and set(names_in(kind, name)) <= set(registry.names(kind))

    def list(self, config_path: str, results_filter: ObjectType | None) -> list[str]:
        kind, name = self._split(config_path)
        if not kind:
            return [] if results_filter == ObjectType.CONFIG else sorted(CHOICES)
        if kind in CHOICES and not name and results_filter != ObjectType.GROUP:
            return registry.names(kind)
        return []

    def load_config(self, config_path: str) -> ConfigResult:
        kind, name = self._split(config_path)
        if kind == "stack":
            return _result(self, {"defaults": ["default"]}, {"package": "_global_"})
        try:
            values = settings.defaults(registry.load(kind, name))
        except ConfigError as error:
            raise ConfigCompositionException(str(error)) from error
        if kind == "task":  # its settings stand at the top level: the task is what the run does
            return _result(self, {"task": name, **values}, {"package": "_global_"})
        return _result(self, {"name": name, **values}, {"package": None})


def _sensor_of(name: str) -> str:
    """The sensor that a stack is for, SENSOR or SENSOR_SOURCE; empty where it is for none."""
    sensors = registry.names("sensor")
    pairs = (sensor for sensor in sensors for source in registry.names("source") if name == f"{sensor}_{source}")
    return name if name in sensors else next(pairs, "")


def _stack(folder: Path, name: str) -> Path:
    return folder / "stack" / f"{name}.yaml"


class Search(SearchPathPlugin):
    """Puts our sources in place of the primary folder, for our own compositions only."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        if not under_way.folders:
            return
        path = search_path.get_path()
        path[:] = [item for item in path if item.provider != "main"]
        for folder in reversed(under_way.folders):
            search_path.prepend("main", f"rhs-conf://{folder}")
        search_path.prepend("rhs-plugins", "rhs-plugins://")


def _result(source: ConfigSource, content: dict, header: dict) -> ConfigResult:
    return ConfigResult(config=OmegaConf.create(content), path=source.full_path(), provider=source.provider,
                        header=header)
