"""Which parts fit together, and building them: each with a random generator of its own.

A sensor hides what it does not hand on: an odometry that needs depth cannot have it with one camera alone, whatever the
source could see. Extra modalities (rhs.api.contracts) pass every sensor.
"""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from rhs.api.contracts import DEGRADE, KINDS, REPLACED_BY_SLAM, SLAM, Context, Source, SourceContext, complete
from rhs.api.floorplan import World
from rhs.api.randomness import generator
from rhs.api.records import FeatureSettings
from rhs.api.settings import slip
from rhs.api.task import Parts
from rhs.api.validate_source import check_camera, check_facts, check_provides
from rhs.base.errors import ConfigError, ContractError

from . import registry
from .registry import members_of, names_in


@dataclass
class Chosen:
    """The plugin taken for one kind of part: its name and its settings dataclass."""

    name: str
    settings: Any


# What a sensor hands on only if the source has it, and what the source offers past the sensor.
THROUGH = frozenset({"wheel", "command"})
PAST = frozenset({"driving", "teleport"})
# What sensors make of a capture; any other word of a source is an extra modality, which passes them all.
SENSED = frozenset({"image", "depth", "scan", "gray", "texture"}) | THROUGH | PAST
EXTRAS = "extras"  # a source that says so knows only when it is open which extra modalities it has
ORDER = (*KINDS[:2], SLAM, *KINDS[2:])  # in which parts are checked and built


def check_combination(chosen: Mapping[str, Chosen]) -> None:
    """Refuse parts that do not fit: each part's needs against what the parts before it provide."""
    if "source" not in chosen:
        return
    for kind in (kind for kind in (DEGRADE, *ORDER) if kind in chosen):
        missing = chosen[kind].settings.needs - offered(kind, chosen)
        if EXTRAS in chosen["source"].settings.provides:
            missing &= SENSED | {"walls"}
        if missing:
            raise ConfigError(_misfit(kind, min(missing), chosen))
    if DEGRADE in chosen and "sensor" in chosen:
        _check_seen(chosen)


def _check_seen(chosen: Mapping[str, Chosen]) -> None:
    """Refuse a degradation of what the sensor does not look at: nothing typed is silently ignored."""
    looked_at = chosen["sensor"].settings.needs
    for name, settings in zip(names_in(DEGRADE, chosen[DEGRADE].name), members_of(chosen[DEGRADE].settings), strict=True):
        spoilt = settings.needs & {"image", "depth", "scan"}
        if spoilt and not spoilt & looked_at:
            raise ConfigError(f"{DEGRADE}={name} spoils {' and '.join(sorted(spoilt))}, which "
                              f"sensor={chosen['sensor'].name} does not look at; leave it out")


def really_there(chosen: Chosen, source: Source) -> Chosen:
    """The source with what it turned out to provide, if it says so: not every recording holds all that a recording can."""
    if source.provides is None:
        return chosen
    possible = source.provides if EXTRAS in chosen.settings.provides else chosen.settings.provides & source.provides
    return Chosen(chosen.name, SimpleNamespace(needs=chosen.settings.needs, provides=possible - {EXTRAS}))


def offered(kind: str, chosen: Mapping[str, Chosen]) -> frozenset[str]:
    """What the parts before `kind` provide: the sensor hides what it does not hand on."""
    if kind == "source":
        return frozenset()
    source = frozenset(chosen["source"].settings.provides)
    if kind in ("sensor", DEGRADE) or "sensor" not in chosen:
        return source
    sensor = frozenset(chosen["sensor"].settings.provides)
    seen = (sensor - (THROUGH - source)) | (source & PAST) | (source - SENSED)
    for earlier in ORDER[2:ORDER.index(kind)]:
        if earlier in chosen:
            seen |= chosen[earlier].settings.provides
    return seen


def _misfit(kind: str, word: str, chosen: Mapping[str, Chosen]) -> str:
    """Who needs what, who does not have it, and what to type instead."""
    known = SENSED | {"walls"}
    if word not in known and (meant := slip(word, known)):
        return f"{called(kind, chosen[kind])} needs {word}, which no part provides; did you mean {meant}?"
    lacking = (word in PAST | THROUGH or word not in SENSED) and word not in chosen["source"].settings.provides
    culprit = "source" if kind in ("sensor", DEGRADE) or lacking else "sensor"
    own = [f"{kind}={name}" for name in _usable(kind) if _fits(kind, name, chosen)]
    others: list[str] = []
    between = KINDS[2 : KINDS.index(kind)] if culprit == "sensor" and kind in KINDS else ()
    if culprit == "source" and word not in SENSED and kind not in ("sensor", DEGRADE):
        between = ("sensor",)  # an extra modality may also be a sensor's
    for other in (culprit, *(kind for kind in between if kind in chosen)):
        others += [f"{other}={name}" for name in _usable(other) if name != chosen[other].name
                    and word in registry.load(other, name).provides  # type: ignore[attr-defined]
                   and _fits(other, name, chosen)]
    instead = own[: 4 - min(len(others), 2)] + others
    hint = f"; type {' or '.join(instead[:4])}" if instead else "; no other registered part helps"
    could = word in registry.load(culprit, chosen[culprit].name).provides  # type: ignore[attr-defined]
    as_set = f" as it is set (python -m rhs {culprit}={chosen[culprit].name} --help)" if could else ""
    return f"{kind}={chosen[kind].name} needs {word}, which {culprit}={chosen[culprit].name} does not provide{as_set}{hint}"


def _fits(kind: str, name: str, chosen: Mapping[str, Chosen]) -> bool:
    return registry.load(kind, name).needs <= offered(kind, chosen)  # type: ignore[attr-defined]


def _usable(kind: str) -> list[str]:
    return [name for name in registry.names(kind) if registry.failure(kind, name) is None]


def build(chosen: Mapping[str, Chosen], *, seed: int, world: World | None, folder: Path, features: FeatureSettings,
          made: Parts | None = None) -> Parts:
    """Build source, sensor, ..., after checking that they fit; of a kind that is not chosen there is no part.

    world: the loaded world, or None for a recording made elsewhere. made: parts that are there already."""
    check_combination(chosen)
    there = {} if made is None else {kind: getattr(made, kind) for kind in ORDER}
    built: dict[str, Any] = {kind: part for kind, part in there.items() if part is not None}
    if made is None:
        built["source"] = build_part("source", chosen["source"], SourceContext(generator(seed, "source"), world, folder))
    source: Source = built["source"]
    try:
        _checked(source, called("source", chosen["source"]))
        chosen = {**chosen, "source": really_there(chosen["source"], source)}
        check_combination(chosen)
        if DEGRADE in chosen and made is None:
            built["source"] = source = degraded(source, chosen, seed=seed, folder=folder, features=features)
        for kind in (kind for kind in ORDER[1:] if kind in chosen and kind not in built):
            context = Context(generator(seed, kind), source.camera, source.facts, folder, features)
            built[kind] = build_part(kind, chosen[kind], context)
        if SLAM in built and made is None:
            from .slam_parts import in_place_of
            built |= in_place_of(built[SLAM])
    except BaseException:
        source.close()
        raise
    last = [kind for kind in ORDER if kind in chosen][-1]
    provides = offered(last, chosen) | chosen[last].settings.provides
    absent = dict.fromkeys(KINDS, cast(Any, None))
    makers = {kind: SLAM if SLAM in chosen and kind in REPLACED_BY_SLAM else kind for kind in KINDS}
    who = {kind: called(maker, chosen[maker]) for kind, maker in makers.items() if maker in chosen}
    if spoilt := spoiling_pictures(chosen):
        who[DEGRADE] = f"{DEGRADE}={spoilt}"
    return Parts(**(absent | built), features=features, provides=provides, who=who)


def spoiling_pictures(chosen: Mapping[str, Chosen]) -> str:
    """The typed degradations that spoil what a camera sees or is told to be, as they are typed; else empty."""
    if DEGRADE not in chosen:
        return ""
    typed = chosen[DEGRADE]
    named = zip(names_in(DEGRADE, typed.name), members_of(typed.settings), strict=True)
    return "+".join(name for name, settings in named if settings.needs & {"image", "depth"})


def _checked(source: Source, who: str) -> None:
    """What every other part is told by the source. Raises ConfigError: nothing has run yet."""
    try:
        check_camera(source.camera, who=who)
        check_facts(source.facts, who=who)
        check_provides(source.provides, who=who)
    except ContractError as error:
        raise ConfigError(str(error)) from error


def degraded(source: Source, chosen: Mapping[str, Chosen], *, seed: int, folder: Path, features: FeatureSettings) -> Source:
    """The source behind its degradations, each with a generator of its own, the first named first."""
    from .degraded import Degraded

    chain, typed = [], chosen[DEGRADE]
    for name, settings in zip(names_in(DEGRADE, typed.name), members_of(typed.settings), strict=True):
        one = Chosen(name, settings)
        context = Context(generator(seed, f"{DEGRADE}.{name}"), source.camera, source.facts, folder, features)
        chain.append((called(DEGRADE, one), build_part(DEGRADE, one, context)))
    return cast(Source, Degraded(source, chain, called("source", chosen["source"])))


def called(kind: str, chosen: Chosen) -> str:
    """A part as a person chose it, and which distribution it is of, where it is one of a distribution."""
    origins = registry.origins(kind, chosen.name)
    return f"{kind}={chosen.name}" + (f" ({origins[0].distribution})" if origins else "")


def build_part(kind: str, chosen: Chosen, context: Context | SourceContext) -> Any:
    """One part, of a copy of its settings: what it makes of them is its own, and not what the run was asked for. Raises
    ConfigError where a package is missing, naming what to install, and where the part lacks a method."""
    try:
        return complete(kind, deepcopy(chosen.settings).build(context))
    except ContractError as error:
        raise ConfigError(f"{called(kind, chosen)}: {error}") from error
    except ModuleNotFoundError as error:
        package = (error.name or "?").partition(".")[0].replace("_", "-")
        raise ConfigError(f"{kind}={chosen.name} needs the package {package}, which is not installed; "
                          f"type: pip install {package}") from error
