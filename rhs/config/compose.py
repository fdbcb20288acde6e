"""From words on the command line to a checked RunConfig; rhs.config.parts builds what it describes.

Everything that can be refused is refused here, before a part is built: unknown keys and plugins, values of a wrong type
or out of range, a part whose needs no other part meets.

A configuration is the settings of every run (`Core`), the task with its own settings, which stand at the top level too,
and under each kind of part that the task needs the plugin taken and its settings.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from rhs.api import settings
from rhs.api.contracts import DEGRADE, KINDS, REPLACED_BY_SLAM, SLAM
from rhs.api.errors import Bounded, ConfigError, PluginError, one_of, within
from rhs.api.files import replacing
from rhs.api.records import FeatureSettings
from rhs.base.strict_yaml import load_yaml

from . import registry
from .parts import Chosen, check_combination

TASK = "task"
# What is kept and how many processes work: no number depends on these.
OUTPUTS = ("output", "overwrite", "recording", "pictures", "video", "live", "processes", "ahead")


@dataclass
class Core(Bounded):
    """What every run has, whatever its task."""

    world: str = "square"
    """a world of worlds/, the path of a world file, or random:FAMILY, a building drawn for this seed: see `rhs worlds`"""
    seed: int = within(0, 0, 2**63 - 1)
    """seed of every random number of the run"""
    recording: str = one_of("auto", "full", "jpeg", "light", "off")
    """run.mcap: full (with images, without loss), jpeg (colour with loss: a replay estimates a little otherwise), light (no
    images), off; auto is full in a single run, light in a sweep"""
    pictures: str = one_of("auto", "on", "off", "page")
    """overview.png and the like, and a patrol's comparison of each place with the survey: on, off, or page, which adds
    report.html; auto is on in a single run, off in a sweep (rhs report makes pictures later, but can compare nothing)"""
    video: bool = False
    """also make video.webm"""
    live: str = ""
    """watch while it runs: viewer (opens Rerun), an address of one, or a file ending in .rrd; empty: do not"""
    ahead: str = one_of("auto", "on", "off")
    """render and sense the views of a survey that is led ahead, in a thread beside the estimates, and draw the pictures in
    another process: on, off, or auto, which is on in a single run where there are two processors, off in a sweep; no number
    depends on it. off: in the first run of an installation nothing is compiled ahead either"""
    output: str = ""
    """run folder; empty: results/runs/DATE_TIME_seedN under the current folder"""
    overwrite: bool = False
    """allow writing into a folder that already holds a finished run"""
    features: FeatureSettings = field(default_factory=FeatureSettings)


@dataclass
class RunConfig(Core):
    """Everything one run depends on, and the names by which it was asked for."""

    task: Chosen = field(default_factory=lambda: Chosen("", None))
    parts: dict[str, Chosen] = field(default_factory=dict)
    presets: str = ""  # `kind=word` of the parts that were named by a word of conf/ which is not the plugin's

    def __getattr__(self, kind: str) -> Chosen:
        """The plugin taken for a kind of part: `config.planner.settings`."""
        try:
            return self.__dict__["parts"][kind]
        except KeyError:
            raise AttributeError(f"no {kind} in this configuration: task={self.__dict__.get('task')}") from None

    @property
    def driving(self) -> bool:
        """Whether there is a robot to drive: a simulator, not a recording."""
        return "source" in self.parts and "driving" in self.parts["source"].settings.provides


_COMPOSING = threading.Lock()  # Hydra has one state for the process, whatever threads compose in it
CORE = tuple(item.name for item in dataclasses.fields(Core))


def compose_config(overrides: Sequence[str] = (), *, folders: tuple[Path, ...] = ()) -> RunConfig:
    """The checked configuration of one run from `key=value` words, as on the command line.

    folders: more conf folders (experiment/, stack/, presets), looked into first. Raises ConfigError in one line.
    """
    from .overrides import parse, plain_words

    return Composer(folders).config(plain_words(parse(overrides)))


class Composer:
    """Makes configurations; what Hydra composed for one set of group options is kept for the next job of a sweep."""

    def __init__(self, folders: tuple[Path, ...] = ()) -> None:
        self.folders = folders
        self.trees: dict[tuple[Any, ...], Any] = {}

    def config(self, words: Sequence[Any]) -> RunConfig:
        """The checked configuration for these words (rhs.config.overrides)."""
        from . import hydra_glue
        from .overrides import Word, is_of_sweep

        if any(word.key.startswith(f"{DEGRADE}.") for word in words):
            from .degraded import with_owners
            words = with_owners(words)
        for word in words:
            if is_of_sweep(word.key):
                raise ConfigError(f"{word.text}: {word.key} is for the jobs of a sweep; add -m, or leave it out")
        options = [word for word in words if word.is_group]
        key = tuple((word.key, word.value) for word in options)
        if key not in self.trees:
            with _COMPOSING:
                self.trees[key] = hydra_glue.compose(options, schema=settings.defaults(Core), folders=self.folders)
        tree = self.trees[key]
        try:
            values = hydra_glue.with_values(tree, [word for word in words if not word.is_group])
            _check_names(values, tree.choices)
            _check_replaced(values, [word.key for word in options])
            config = from_plain(values)
            config.presets = " ".join(f"{kind}={choice}" for kind, choice in tree.choices.items()
                                      if kind in KINDS and kind in config.parts and choice != config.parts[kind].name)
            _check_of_use(config, words)
            if not {"sensor", "stack", "experiment"} & {word.key for word in options} and (sensor := _suited(config)):
                return self.config([*words, Word("sensor", sensor, f"sensor={sensor}")])
            return config
        except ConfigError as error:
            raise hydra_glue.located(error, tree, words) from error


def _suited(config: RunConfig) -> str:
    """The sensor that a recording asks for where nobody chose one and the default has no use for what it holds."""
    suited = getattr(config.parts["source"].settings, "suited_sensor", None) if "sensor" in config.parts else None
    return suited() if suited is not None else ""


def _check_names(values: dict[str, Any], choices: dict[str, str | None]) -> None:
    """A part chosen by name in a YAML file, past the defaults list, would have another's settings. An experiment without
    its first line would be a key of that name."""
    for group in ("experiment", "stack"):
        if group in values:
            raise ConfigError(f"{group}={choices.get(group) or '...'}: its file must begin with the line "
                              "`# @package _global_`: its keys are those of the run")
    for kind in (*KINDS, SLAM, DEGRADE, TASK):
        node, choice = values.get(kind), choices.get(kind)
        name = node.get("name") if isinstance(node, dict) else node
        if node is not None and choice in registry.names(kind) and name != choice:
            raise ConfigError(f"{kind}={name}: in a YAML file this is chosen by `override /{kind}: {name}` under defaults")


# words that a recording has no use for
OF_A_DRIVE = ("planner", "localiser", "replan", "mission", "obstacles", "people", "obstacle_count", "moved_count",
              "people_count", "world")


def _check_of_use(config: RunConfig, words: Sequence[Any]) -> None:
    """Refuse what was typed for a robot that is driven, where a recording is read: nothing typed is silently ignored."""
    if "source" not in config.parts or config.driving or not hasattr(config.source.settings, "path"):
        return
    own = config.task.settings
    for word in words:
        kind = word.key.partition(".")[0]
        if kind in config.parts and "planner" not in config.parts:
            continue  # a task that drives nobody and has a use for it
        if word.key == "world" and getattr(own, "map", None) == "":  # a task in a given map: that building's
            own.map, config.world = str(word.value), Core.world
            continue
        if kind in OF_A_DRIVE:
            raise ConfigError(f"{word.text}: source={config.source.name} is a recording, which nobody drives: there is "
                              f"nothing for {kind} to do; leave it out")


def _check_replaced(values: dict[str, Any], typed: Sequence[str]) -> None:
    replaced = [kind for kind in REPLACED_BY_SLAM if kind in typed]
    if values.get(SLAM) and replaced:
        raise ConfigError(f"slam={values[SLAM]['name']} brings its own {', '.join(REPLACED_BY_SLAM)}; "
                          f"leave out {' '.join(f'{kind}=...' for kind in replaced)}")


def from_plain(values: dict[str, Any]) -> RunConfig:
    """The RunConfig that plain values describe (a config.yaml read back), fully checked."""
    task = _task(values)
    names = [item.name for item in dataclasses.fields(task)]
    own = {key: value for key, value in values.items() if key in names}
    rest = {key: value for key, value in values.items() if key not in (*names, *KINDS, SLAM, DEGRADE, TASK)}
    unknown = [key for key in rest if key not in CORE]
    if unknown:
        raise registry.no_setting(unknown[0], values[TASK], [*CORE, *names, *task.kinds])
    core = settings.make(Core, rest, "")
    chosen = {kind: _choose(kind, values.get(kind)) for kind in _kinds(task, values)}
    config = RunConfig(**{key: getattr(core, key) for key in CORE}, parts=chosen,
                       task=Chosen(str(values[TASK]), settings.make(task, own, "")))
    check_combination(chosen)
    _check_task(config)
    return config


def _task(values: dict[str, Any]) -> Any:
    """The settings dataclass of the task that plain values name."""
    name = values.get(TASK)
    if not isinstance(name, str):
        raise ConfigError(f"task={name}: choose one of {', '.join(registry.names(TASK))} by task=NAME")
    cls = registry.load(TASK, name)
    registry.check_requirements(TASK, name, cls)
    if taken := [item.name for item in dataclasses.fields(cls) if item.name in CORE]:
        raise PluginError(f"task={name} has a setting called {taken[0]}, which rhs uses itself; rename it")
    return cls


def _kinds(task: Any, values: dict[str, Any]) -> list[str]:
    """The kinds of parts of this run: the task's, but for those that a slam takes the place of, and degradations if any."""
    kinds = list(task.kinds)
    if values.get(SLAM) and set(REPLACED_BY_SLAM) & set(kinds):
        kinds = [kind for kind in kinds if kind not in REPLACED_BY_SLAM] + [SLAM]
    if values.get(DEGRADE):
        if "source" not in kinds:
            raise ConfigError(f"{DEGRADE}: task={values[TASK]} takes no views that could be degraded; leave it out")
        kinds.append(DEGRADE)
    return kinds


def _check_task(config: RunConfig) -> None:
    """Refuse a task that needs what its source does not provide, or the sensor does not hand on."""
    needs = config.task.settings.needs
    for kind, asked in (("source", needs), ("sensor", needs & {"image", "depth", "scan"})):
        if kind not in config.parts or not (missing := asked - config.parts[kind].settings.provides):
            continue
        others = [name for name in registry.names(kind) if registry.failure(kind, name) is None
                  and missing <= registry.load(kind, name).provides]  # type: ignore[attr-defined]
        hint = f"; type {' or '.join(f'{kind}={name}' for name in others)}" if others else ""
        raise ConfigError(f"task={config.task.name} needs {min(missing)}, which {kind}={config.parts[kind].name} does not "
                          f"provide{hint}")


def _choose(kind: str, node: Any) -> Chosen:
    if not isinstance(node, dict) or not isinstance(node.get("name"), str):
        known = ", ".join(registry.names(kind))
        raise ConfigError(f"{kind}: choose one of {known} by {kind}=NAME" if node in (None, {}) else
                          f"{kind}={node}: not a plugin; choose one of {known} by {kind}=NAME")
    name = node["name"]
    cls = registry.load(kind, name)
    registry.check_requirements(kind, name, cls)
    values = {k: v for k, v in node.items() if k != "name"}
    return Chosen(name, settings.make(cls, values, kind))


def to_plain(config: RunConfig) -> dict[str, Any]:
    """The configuration as plain values for config.yaml; `from_plain` reads it back."""
    values = {TASK: config.task.name, **{name: settings.plain(getattr(config, name)) for name in CORE}}
    values |= settings.plain(config.task.settings)
    for kind, chosen in config.parts.items():
        values[kind] = {"name": chosen.name, **settings.plain(chosen.settings)}
    return values


def write_config(config: RunConfig, folder: Path) -> None:
    """config.yaml: the resolved configuration, which `from_plain` reads back."""
    with replacing(folder / "config.yaml") as file:
        yaml.dump(to_plain(config), file, getattr(yaml, "CSafeDumper", yaml.SafeDumper), sort_keys=False, allow_unicode=True)


def read_values(folder: Path) -> dict[str, Any]:
    """The plain values that a run folder remembers, in the words of now. Raises ConfigError."""
    from .overrides import DEPRECATED

    values = load_yaml(folder / "config.yaml")
    if not isinstance(values, dict):
        raise ConfigError(f"{folder}/config.yaml: expected `key: value` lines")
    for old, now in DEPRECATED.items():
        key_of, _, text = old.partition("=")
        *above, last = key_of.split(".")
        node: Any = values
        for key in above:
            node = node.get(key) if isinstance(node, dict) else None
        if isinstance(node, dict) and node.get(last) == text:
            node[last] = now.partition("=")[2]
    return values


def overlaid(values: dict[str, Any], words: Sequence[str]) -> RunConfig:
    """The checked configuration of plain values (a config.yaml read back) after `key=value` words; `kind=name` takes that
    part with its defaults. Raises ConfigError."""
    from .overrides import parse, plain_words

    laid = dict(values)
    for word in plain_words(parse(list(words))):
        *above, last = word.key.split(".")
        node = laid
        for key in above:
            node[key] = dict(node.get(key) or {})
            node = node[key]
        node[last] = {"name": word.value} if word.is_group and word.key != "task" else word.value
    return from_plain(laid)


def config_hash(config: RunConfig) -> str:
    """10 hex digits of everything the numbers of a run depend on: its task, the kinds of parts that task needs and their
    settings, world and seed; not where and how much of it is kept. Shared features count where there are views."""
    left_out = OUTPUTS if "sensor" in config.parts else (*OUTPUTS, "features")
    values = {k: v for k, v in to_plain(config).items() if k not in left_out}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:10]


def identity(config: RunConfig) -> dict[str, Any]:
    """The columns of a row that say which run it is; parts that drive are not asked of a recording, nor named."""
    idle = OF_A_DRIVE if "source" in config.parts and "planner" in config.parts and not config.driving else ()
    names = {kind: chosen.name for kind, chosen in config.parts.items() if kind not in idle}
    presets = {"presets": config.presets} if config.presets else {}
    return {"task": config.task.name, "world": config.world, **names, **presets, "seed": config.seed,
            "config_hash": config_hash(config), "plugins": " ".join(registry.sources(config.task.name, names))}
