"""Which parts fit together, and building them: each with a random generator of its own.

A sensor hides what it does not hand on: an odometry that needs depth cannot have it with one eye, whatever the source
could see.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from rhs.api.contracts import KINDS, Context, FeatureSettings, SourceContext, complete
from rhs.base.errors import ConfigError

from . import registry


@dataclass
class Chosen:
    """The plugin taken for one kind of part: its name and its settings dataclass."""

    name: str
    settings: Any


# What a sensor hands on only if the source has it, and what the source offers past the sensor.
THROUGH = frozenset({"wheel", "command"})
PAST = frozenset({"driving", "teleport"})


def check_combination(chosen: Mapping[str, Chosen]) -> None:
    """Refuse parts that do not fit: each part's needs against what the parts before it provide."""
    for kind in KINDS:
        missing = chosen[kind].settings.needs - offered(kind, chosen)
        if missing:
            raise ConfigError(_misfit(kind, min(missing), chosen))


def really_there(chosen: Chosen, source: Any) -> Chosen:
    """The source with what it turned out to provide, if it says so: not every recording holds all that a recording can."""
    if source.provides is None:
        return chosen
    there = chosen.settings.provides & source.provides
    return Chosen(chosen.name, SimpleNamespace(needs=chosen.settings.needs, provides=there))


def offered(kind: str, chosen: Mapping[str, Chosen]) -> frozenset[str]:
    """What the parts before `kind` provide: the sensor hides what it does not hand on."""
    source, sensor = chosen["source"].settings.provides, chosen["sensor"].settings.provides
    if kind == "source":
        return frozenset()
    if kind == "sensor":
        return frozenset(source)
    seen = (sensor - (THROUGH - source)) | (source & PAST)
    for earlier in KINDS[2:KINDS.index(kind)]:
        seen |= chosen[earlier].settings.provides
    return frozenset(seen)


def _misfit(kind: str, word: str, chosen: Mapping[str, Chosen]) -> str:
    """Who needs what, who does not have it, and what to type instead."""
    lacking = word in PAST | THROUGH and word not in chosen["source"].settings.provides
    culprit = "source" if kind == "sensor" or lacking else "sensor"
    instead = [f"{kind}={name}" for name in _usable(kind) if _fits(kind, name, chosen)]
    between = KINDS[2 : KINDS.index(kind)] if culprit == "sensor" else ()
    for other in (culprit, *between):
        instead += [f"{other}={name}" for name in _usable(other) if name != chosen[other].name
                    and word in registry.load(other, name).provides  # type: ignore[attr-defined]
                    and _fits(other, name, chosen)]
    hint = f"; type {' or '.join(instead[:4])}" if instead else "; no other registered part helps"
    return f"{kind}={chosen[kind].name} needs {word}, which {culprit}={chosen[culprit].name} does not provide{hint}"


def _fits(kind: str, name: str, chosen: Mapping[str, Chosen]) -> bool:
    return registry.load(kind, name).needs <= offered(kind, chosen)  # type: ignore[attr-defined]


def _usable(kind: str) -> list[str]:
    return [name for name in registry.names(kind) if registry.failure(kind, name) is None]


@dataclass
class Parts:
    """The seven parts of a run, what the features they share are like, what all of them provide, and what each is called in
    an error: kind=name (distribution)."""

    source: Any
    sensor: Any
    odometry: Any
    loop_closer: Any
    mapper: Any
    planner: Any
    localiser: Any
    features: FeatureSettings
    provides: frozenset[str]
    who: dict[str, str]


def generator(seed: int, part: str) -> np.random.Generator:
    """A random generator of its own for each part, by name: no part's draws move another's."""
    key = int.from_bytes(hashlib.sha256(part.encode()).digest()[:4], "big")
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=(key,)))


def build(chosen: Mapping[str, Chosen], *, seed: int, world: Any, folder: Path, features: FeatureSettings) -> Parts:
    """Build source, sensor, ..., localiser, in this order, after checking that they fit."""
    check_combination(chosen)
    source = _build("source", chosen, SourceContext(generator(seed, "source"), world, folder))
    built: dict[str, Any] = {"source": source}
    try:
        chosen = {**chosen, "source": really_there(chosen["source"], source)}
        check_combination(chosen)
        for kind in KINDS[1:]:
            context = Context(generator(seed, kind), source.camera, source.facts, folder, features)
            built[kind] = _build(kind, chosen, context)
    except BaseException:
        source.close()
        raise
    provides = offered("localiser", chosen) | chosen["localiser"].settings.provides
    who = {kind: _called(kind, chosen[kind]) for kind in KINDS}
    return Parts(**built, features=features, provides=frozenset(provides), who=who)


def _called(kind: str, chosen: Chosen) -> str:
    """A part as a person chose it, and which distribution it is of, where it is one of a distribution."""
    origins = registry.origins(kind, chosen.name)
    return f"{kind}={chosen.name}" + (f" ({origins[0].distribution})" if origins else "")


def _build(kind: str, chosen: Mapping[str, Chosen], context: Any) -> Any:
    try:
        return complete(kind, chosen[kind].settings.build(context))
    except ModuleNotFoundError as error:
        package = (error.name or "?").partition(".")[0].replace("_", "-")
        raise ConfigError(f"{kind}={chosen[kind].name} needs the package {package}, which is not installed; "
                          f"type: pip install {package}") from error
