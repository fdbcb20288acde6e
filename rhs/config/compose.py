"""From words on the command line to a checked RunConfig; rhs.parts builds what it describes.

Everything that can be refused is refused here, before a part is built: unknown keys and plugins, values of a wrong type
or out of range, a part whose needs no other part meets.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import KINDS, FeatureSettings
from rhs.api.files import replacing
from rhs.base.errors import ConfigError, check_choice, check_range
from rhs.base.strict_yaml import load_yaml
from rhs.patrol.gate_settings import Gate
from rhs.patrol.mission import MissionSettings
from rhs.recording.rerun_view import check_live
from rhs_tasks.unroll.settings import Unroll

from . import registry, settings
from .parts import Chosen, Parts, build, check_combination

TASKS = ("patrol", "survey", "planning", "places", "unroll")
OUTPUTS = ("output", "overwrite", "recording", "video", "live")  # what is kept of a run; no number depends on these


@dataclass
class Places:
    """Which views are kept as places."""

    # a view is stored every so many steps of the survey (thesis 5.2: 3)
    every: int = 3
    # places task: every so many views of the queried lap is asked
    ask_every: int = 3
    # places task: candidates checked by geometry
    checks: int = 5
    # places task: rms distance of the queried lap from the surveyed route, metres
    off_route_m: float = 0.3
    # places task: rms of its heading against the route, degrees
    off_route_deg: float = 8.0
    # places task: so many times the localiser is started from nothing ...
    sequences: int = 25
    # ... and led so far before it is judged, metres
    sequence_m: float = 3.0

    def __post_init__(self) -> None:
        check_range("places", "every", self.every, low=1, high=100_000)
        check_range("places", "ask_every", self.ask_every, low=1, high=100_000)
        check_range("places", "checks", self.checks, low=1, high=1000)
        check_range("places", "off_route_m", self.off_route_m, low=0.0, high=0.3, unit="m")
        check_range("places", "off_route_deg", self.off_route_deg, low=0.0, high=15.0, unit="degrees")
        check_range("places", "sequences", self.sequences, low=1, high=100_000)
        check_range("places", "sequence_m", self.sequence_m, low=0.0, high=1000.0, unit="m")


@dataclass
class Planning:
    """The planning task."""

    # the map is grown by this radius, metres; null: what the map or world says
    robot_radius_m: float | None = None
    # which problem of a MovingAI .scen file, from 0
    scenario: int = 0
    # pull every planner's path tight before it is measured; the length it was found with stands beside
    shorten: bool = True
    # a start in a blocked cell may be left over blocked cells this near, metres
    start_radius_m: float = 0.3

    def __post_init__(self) -> None:
        check_range("planning", "start_radius_m", self.start_radius_m, low=0.0, high=10.0, unit="m")
        if self.robot_radius_m is not None:
            check_range("planning", "robot_radius_m", self.robot_radius_m, low=0.0, high=100.0, unit="m")
        check_range("planning", "scenario", self.scenario, low=0, high=10_000_000)


@dataclass
class Features:
    """The SIFT features every part shares (rhs.vision)."""

    # key-points kept per 320x240 pixels of a view, strongest first (1200 at 640x480)
    count: int = 300
    # SIFT contrast threshold: lower finds more, weaker points
    contrast: float = 0.02
    # ratio test: a match is kept when its distance is below this share of the second best (Lowe 2004)
    ratio: float = 0.8

    def __post_init__(self) -> None:
        check_range("features", "count", self.count, low=10, high=100_000)
        check_range("features", "contrast", self.contrast, low=0.0, high=1.0)
        check_range("features", "ratio", self.ratio, low=0.1, high=1.0)


@dataclass
class RunConfig:
    """Everything one run depends on."""

    # what to do: patrol (map, then patrol), survey (map only), planning (planners alone on a map), places (recognise
    # single views), unroll (the wall of a tube as one flat picture)
    task: str = "patrol"
    # a world of worlds/, or the path of a world file
    world: str = "square"
    # seed of every random number of the run
    seed: int = 0
    # run.mcap: full (with images), light (no images), off; auto is full in a single run, light in a sweep
    recording: str = "auto"
    # also make video.webm
    video: bool = False
    # watch while it runs: viewer (opens Rerun), an address of one, or a file ending in .rrd; empty: do not
    live: str = ""
    # run folder; empty: results/runs/DATE_TIME_seedN under the current folder
    output: str = ""
    # allow writing into a folder that already holds a finished run
    overwrite: bool = False
    # boxes the map does not know, put in when the patrol begins: [[x_m, y_m, width_m, depth_m], ...]
    obstacles: list[list[float]] = field(default_factory=list)
    # planning task: where to start, [x_m, y_m]; empty: the world's
    start: list[float] = field(default_factory=list)
    # planning task: where to go, [x_m, y_m]; empty: the world's
    goal: list[float] = field(default_factory=list)
    planning: Planning = field(default_factory=Planning)
    places: Places = field(default_factory=Places)
    unroll: Unroll = field(default_factory=Unroll)
    features: Features = field(default_factory=Features)
    gate: Gate = field(default_factory=Gate)
    mission: MissionSettings = field(default_factory=MissionSettings)
    source: Any = None
    sensor: Any = None
    odometry: Any = None
    loop_closer: Any = None
    mapper: Any = None
    planner: Any = None
    localiser: Any = None

    def __post_init__(self) -> None:
        check_choice("", "task", self.task, TASKS)
        check_range("", "seed", self.seed, low=0, high=2**63 - 1)
        check_choice("", "recording", self.recording, ("auto", "full", "light", "off"))
        check_live(self.live)
        for box in self.obstacles:
            _check_numbers("obstacles", box, 4)
            check_range("obstacles", "width_m", box[2], low=0.01, high=1000.0, unit="m")
            check_range("obstacles", "depth_m", box[3], low=0.01, high=1000.0, unit="m")
        for key in ("start", "goal"):
            if getattr(self, key):
                _check_numbers(key, getattr(self, key), 2)

    def chosen(self) -> dict[str, Chosen]:
        """The plugin taken for each kind, in building order."""
        return {kind: getattr(self, kind) for kind in KINDS}


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
        self.trees: dict[tuple, Any] = {}

    def config(self, words: Sequence[Any]) -> RunConfig:
        """The checked configuration for these words (rhs.overrides)."""
        from . import hydra_glue

        options = [word for word in words if word.is_group]
        key = tuple((word.key, word.value) for word in options)
        if key not in self.trees:
            self.trees[key] = hydra_glue.compose(options, schema=core_defaults(), folders=self.folders)
        tree = self.trees[key]
        try:
            values = hydra_glue.with_values(tree, [word for word in words if not word.is_group])
            _check_names(values, tree.choices)
            return from_plain(values)
        except ConfigError as error:
            raise hydra_glue.located(error, tree, words) from error


def _check_names(values: dict[str, Any], choices: dict[str, str | None]) -> None:
    for kind in KINDS:
        node, choice = values.get(kind), choices.get(kind)
        if isinstance(node, dict) and choice in registry.names(kind) and node.get("name") != choice:
            raise ConfigError(f"{kind}.name={node.get('name')}: a part is chosen by {kind}=NAME, "
                              f"or in a YAML file by `override /{kind}: NAME` under defaults")


def core_defaults() -> dict[str, Any]:
    """The core's own settings with their defaults, without the parts."""
    return {k: v for k, v in settings.defaults(RunConfig).items() if k not in KINDS}


def from_plain(values: dict[str, Any]) -> RunConfig:
    """The RunConfig that plain values describe (a config.yaml read back), fully checked."""
    parts = {kind: _choose(kind, values.get(kind)) for kind in KINDS}
    core = settings.make(RunConfig, {k: v for k, v in values.items() if k not in KINDS}, "")
    config = dataclasses.replace(core, **parts)
    check_combination(config.chosen())
    return config


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
    values = {f.name: settings.plain(getattr(config, f.name)) for f in dataclasses.fields(config)}
    for kind, chosen in config.chosen().items():
        values[kind] = {"name": chosen.name, **settings.plain(chosen.settings)}
    return values


def write_config(config: RunConfig, folder: Path) -> None:
    """config.yaml: the resolved configuration, which `from_plain` reads back."""
    import yaml

    with replacing(folder / "config.yaml") as file:
        yaml.dump(to_plain(config), file, getattr(yaml, "CSafeDumper", yaml.SafeDumper), sort_keys=False, allow_unicode=True)


def read_config(folder: Path) -> RunConfig:
    """The configuration that a run folder remembers, checked like one that was typed."""
    values = load_yaml(folder / "config.yaml")
    if not isinstance(values, dict):
        raise ConfigError(f"{folder}/config.yaml: expected `key: value` lines")
    return from_plain(values)


def config_hash(config: RunConfig) -> str:
    """10 hex digits of everything the numbers of a run depend on (not where and how much of it is kept)."""
    values = {k: v for k, v in to_plain(config).items() if k not in OUTPUTS}
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:10]


def identity(config: RunConfig) -> dict[str, Any]:
    """The columns of a row that say which run it is."""
    names = {kind: chosen.name for kind, chosen in config.chosen().items()}
    return {"task": config.task, "world": config.world, **names, "seed": config.seed, "config_hash": config_hash(config)}


def build_parts(config: RunConfig, world: Any, folder: Path) -> Parts:
    """The seven parts of a run, each with its own generator; nothing has moved yet.

    world: the loaded rhs.world.World, or None for a recording made elsewhere.
    """
    return build(config.chosen(), seed=config.seed, world=world, folder=folder,
                 features=FeatureSettings(**settings.plain(config.features)))


def _check_numbers(key: str, values: Sequence[float], count: int) -> None:
    if len(values) != count or not all(np.isfinite(values)):
        raise ConfigError(f"{key}={list(values)}: expected {count} finite numbers")
