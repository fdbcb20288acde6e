"""How Hydra composes our configuration, where it finds it, and how its errors become one line.

Two ConfigSources stand in the search path, before anything else: `rhs-conf://` reads the YAML files of conf/ strictly, and
`rhs-plugins://` serves `<kind>/<entry point name>` from the defaults of the plugin's dataclass. Listing names imports
nothing. They serve one composition at a time: the one that stands in `under_way`. Types and ranges are checked after
composing, by rhs.api.settings, whichever way a value came in.
"""

from __future__ import annotations

import copy
import itertools
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import hydra
import omegaconf
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.global_hydra import GlobalHydra
from hydra.core.object_type import ObjectType
from hydra.core.plugins import Plugins
from hydra.errors import ConfigCompositionException
from hydra.plugins.config_source import ConfigResult, ConfigSource
from hydra.plugins.search_path_plugin import SearchPathPlugin
from omegaconf import DictConfig, OmegaConf, open_dict

from rhs.api import settings
from rhs.api.contracts import CHOICES, DEGRADE, KINDS, SLAM
from rhs.base.data_dirs import data_dir
from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import load_yaml

from . import registry
from .overrides import GROUPS, Word, check_options, quoted
from .registry import names_in

DEFAULT_STACK = "rgbd"  # what a sensor without a stack file of its own gets


@dataclass
class UnderWay:
    """The composition under way: its conf folders (first wins), the core's own defaults, and the YAML files it has read."""

    folders: list[Path] = field(default_factory=list)
    schema: dict[str, Any] | None = None
    files: list[Path] = field(default_factory=list)


under_way = UnderWay()


@dataclass(frozen=True)
class Tree:
    """A composed configuration before single values are set, the options chosen, and the YAML files read for it."""

    config: DictConfig
    choices: dict[str, str | None]
    files: tuple[Path, ...]

    @cached_property
    def plain(self) -> dict[str, Any] | None:
        """Its values where each has one and none refers to another; else None."""
        try:
            content = OmegaConf.to_container(self.config, throw_on_missing=True)
        except omegaconf.errors.OmegaConfBaseException:
            return None
        return None if "${" in json.dumps(content, default=str) else content  # type: ignore[return-value]


def compose(options: Sequence[Word], *, schema: dict[str, Any], folders: tuple[Path, ...] = ()) -> Tree:
    """Hydra's composition for the chosen group options.

    schema: the core's own settings with their defaults. folders: conf folders looked into before rhs's own.
    Raises ConfigError in one line.
    """
    with _session(schema, folders):
        check_options(options, _options)
        try:
            taken = [f"{w.key}={_spelt(w.value)}" if w.value else f"~{w.key}" for w in options]
            config = hydra.compose("config", taken, return_hydra_config=True)
        except (hydra.errors.HydraException, omegaconf.errors.OmegaConfBaseException) as error:
            raise (error.__cause__ if isinstance(error.__cause__, ConfigError) else
                   ConfigError(_in_one_line(error))) from error
        choices = {k: v for k, v in config.hydra.runtime.choices.items() if not k.startswith("hydra/")}
        with open_dict(config):
            del config["hydra"]
        return Tree(config, choices, tuple(under_way.files))


def _spelt(name: str) -> str:
    """A name as Hydra's grammar takes it, which lacks all letters that are not English."""
    return name if name.isascii() else quoted(name)


def with_values(tree: Tree, values: Sequence[Word]) -> dict[str, Any]:
    """Plain values of the tree with single settings changed, interpolations resolved. Raises ConfigError."""
    words = [*itertools.chain.from_iterable(map(_leaves, values))]
    if tree.plain is not None and all(_is_plain(word.value) for word in words):
        for word in words:
            _check_key(tree.config, word)
        content = copy.deepcopy(tree.plain)
        if all([_replaced(content, word) for word in words]):
            return content
    config = copy.deepcopy(tree.config)
    for word in words:
        _check_key(config, word)
        try:
            OmegaConf.update(config, word.key, word.value, merge=True, force_add=True)
        except omegaconf.errors.OmegaConfBaseException as error:
            raise ConfigError(f"{word.text}: {_in_one_line(error)}") from error
    return to_plain(config)


def _is_plain(value: Any) -> bool:
    """Whether OmegaConf would take a value as it is."""
    return "${" not in value and value != "???" if isinstance(value, str) else isinstance(value, bool | int | float | None)


def _replaced(content: dict[str, Any], word: Word) -> bool:
    """Put the value of a word in the place of another single value, or of none in a setting that is a dict; whether it
    could be."""
    *owners, last = word.key.split(".")
    node: Any = content
    for owner in owners:
        node = node.get(owner) if isinstance(node, dict) else None
    if not isinstance(node, dict) or isinstance(node.get(last), dict | list):
        return False
    node[last] = word.value
    return True


def _leaves(word: Word) -> Iterator[Word]:
    """`planner={samples: 3}` as planner.samples=3; other words as they are."""
    if not isinstance(word.value, dict):
        yield word
        return
    for key, value in word.value.items():
        yield from _leaves(Word(f"{word.key}.{key}", value, word.text))


def _check_key(config: DictConfig, word: Word) -> None:
    """Refuse a dotted key that leads nowhere, naming the nearest that does."""
    node: Any = config
    parts = word.key.split(".")
    for depth, part in enumerate(parts):
        owner = ".".join(parts[:depth])
        if isinstance(node, DictConfig) and part in node.keys():
            node = _child(node, part)
        elif _is_free(config, parts[:depth]):
            break
        elif isinstance(node, DictConfig):
            known = [str(k) for k in node.keys()]
            if owner in KINDS:
                raise registry.no_setting_of(owner, str(config[owner].name), part, known)
            raise settings.unknown_key(owner, part, known) if depth else registry.no_setting(part, str(config.task), known)
        else:
            top = f"; a task's settings stand at the top level: {parts[-1]}=VALUE" if owner == "task" else ""
            raise ConfigError(f"unknown key {word.key}: {owner} is a single value; write {owner}=VALUE{top}")
    if len(parts) == 2 and parts[0] in KINDS and parts[1] == "name":
        raise ConfigError(f"{word.text}: a part is chosen by {parts[0]}={word.value}")


def _is_free(config: DictConfig, owner: Sequence[str]) -> bool:
    """Whether it is a setting of a part whose keys are anybody's: a dict."""
    if owner and owner[0] in (*KINDS, SLAM, DEGRADE):
        return len(owner) > 1 and settings.is_dict(registry.load(owner[0], str(config[owner[0]].name)), owner[1:])
    return bool(owner) and settings.is_dict(registry.load("task", str(config.task)), owner)


def _options(group: str) -> list[str]:
    """Every option of a group: plugins, and YAML files in the conf folders under way."""
    found = set(registry.names(group) if group in CHOICES else [])
    for folder in under_way.folders:
        found |= {path.stem for path in (folder / group).glob("*.yaml")}
    return sorted(found)


def experiment_sweep(name: str, folders: tuple[Path, ...] = ()) -> list[str]:
    """The words `key=values` that an experiment sweeps over when it is run with -m: its file's mapping `sweep`."""
    for folder in (*folders, data_dir("conf")):
        path = folder / "experiment" / f"{name}.yaml"
        if path.is_file():
            content = load_yaml(path)
            sweep = content.get("sweep", {}) if isinstance(content, dict) else {}
            if not isinstance(sweep, dict):
                raise ConfigError(f"{path}: sweep: expected `key: values` lines, found a {type(sweep).__name__}")
            return [f"{key}={value}" for key, value in sweep.items()]
    return []


def to_plain(config: DictConfig) -> dict[str, Any]:
    """Plain dicts and lists, interpolations resolved; raises ConfigError for `???` and cycles."""
    try:
        content = OmegaConf.to_container(config, resolve=True, throw_on_missing=True)
    except omegaconf.errors.MissingMandatoryValue as error:
        key = getattr(error, "full_key", None) or "?"
        raise ConfigError(f"{key} has no value; give it one on the command line: {key}=VALUE") from error
    except (omegaconf.errors.OmegaConfBaseException, RecursionError) as error:
        said = "an interpolation that refers to itself" if "ecursi" in str(error) else _in_one_line(error)
        raise ConfigError(f"{_unresolved(config)}: {said}; write the value out") from error
    return content  # type: ignore[return-value]


def _unresolved(node: DictConfig, owner: str = "") -> str:
    """`key=value` of the first interpolation that cannot be resolved, for instance seed=${seed}."""
    for name in map(str, node):
        key = f"{owner}.{name}" if owner else name
        if OmegaConf.is_interpolation(node, name):
            try:
                node[name]
            except (omegaconf.errors.OmegaConfBaseException, RecursionError):
                return f"{key}={OmegaConf.to_container(node, resolve=False)[name]}"  # type: ignore[call-overload, index]
        elif isinstance(below := _child(node, name), DictConfig) and (found := _unresolved(below, key)):
            return found
    return ""


def _child(node: DictConfig, key: str) -> Any:
    """What stands under a key, None where it has to be looked up elsewhere (an interpolation) or is missing (`???`)."""
    return None if OmegaConf.is_interpolation(node, key) or OmegaConf.is_missing(node, key) else node[key]


@contextmanager
def _session(schema: dict[str, Any], folders: tuple[Path, ...]) -> Iterator[None]:
    """Hydra initialised for one composition; whatever the caller had set up (a notebook's own Hydra) comes back."""
    conf = data_dir("conf")
    for cls in (ConfSource, PluginSource, Search):
        Plugins.instance().register(cls)
    before = GlobalHydra.instance().hydra
    GlobalHydra.instance().clear()
    version = {"version_base": "1.3"} if hydra.__version__.startswith("1.3") else {}
    under_way.folders = [*folders, conf]
    under_way.schema = schema
    under_way.files = []
    try:
        with hydra.initialize_config_dir(str(conf), job_name="rhs", **version):
            yield
    finally:
        under_way.folders, under_way.schema = [], None
        GlobalHydra.instance().hydra = before


def located(error: ConfigError, tree: Tree, words: Sequence[Word]) -> ConfigError:
    """The same error with file:line before it, if the key at fault was written in a YAML file and not typed."""
    match = re.match(r"(?:unknown key )?([\w.]+)", str(error))
    leaf = match.group(1).rpartition(".")[2] if match else ""
    if not leaf or any(leaf in re.split(r"[./]", word.key) or leaf in str(word.value) for word in words):
        return error
    for path in reversed(tree.files):
        for number, line in enumerate(path.read_text("utf-8-sig").splitlines(), 1):
            if re.match(rf"\s*{re.escape(leaf)}\s*:", line):
                return type(error)(f"{path}:{number}: {error}")
    return error


def _in_one_line(error: BaseException) -> str:
    """Hydra's and OmegaConf's errors, which fill several lines, as one."""
    cause = error.__cause__ if not str(error).strip() and error.__cause__ else error
    lines = [line.strip() for line in str(cause).splitlines() if line.strip()]
    lines = [line for line in lines if not re.match(r"(object_type|full_key|See https?:)", line)]
    return " ".join(lines) or type(error).__name__


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
            content = {key: value for key, value in content.items() if key != "sweep"}  # see experiment_sweep
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
