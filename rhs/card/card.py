"""The card of one part: its contract, what it is worth on the standard set beside ours, where it breaks, what it costs.

Nothing of it is the part's own word: it is built from its settings as in any run, in processes of its own, and held against
truths that it never sees. Everything but times and memory is the same for everybody.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

from rhs.api import settings as plain_settings
from rhs.api.contracts import DEGRADE, KINDS, SLAM
from rhs.base.errors import ConfigError
from rhs.base.provenance import commit, versions
from rhs.config import registry
from rhs.reports.export import without_nan
from rhs.testing.checks import checks

from . import localisers, loop_closers, mappers, odometries, planners
from .forked import ForkResult, run_forked

MEASURED: dict[str, ModuleType] = {"planner": planners, "localiser": localisers, "odometry": odometries,
                                   "mapper": mappers, "loop_closer": loop_closers}
REFERENCES = {"planner": ("astar", "prm", "rrt_connect"), "odometry": ("keyframe", "procrustes", "wheel"),
              "localiser": ("sift_db", "particle_filter", "particle_filter_scan"), "mapper": ("occupancy",),
              "loop_closer": ("pose_graph", "scan_graph", "error_distribution")}
STANDARD_SET = {
    "planner": "70 questions made by chance on small maps of seven kinds (scattered cells, boxes, rooms, mazes, the border, "
               "cells corner to corner, closed walls), each of a new planner, some asked twice; starts and goals that are "
               "none; one map after another. Exact answers by the visibility graph.",
    "localiser": "Four patrols of 84 views beside the surveyed lap of two small rooms (rhs.testing); twice in each the "
                 "robot is carried elsewhere while it stands still. Motions as wrong as their covariance says. Then two "
                 "thirds of the first patrol under each degradation.",
    "odometry": "A lap of 64 views in a room and in a furnished one, 41 views through a corridor and a tube (rhs.testing), "
                "with the noise of good sensors. Then half of the first lap under each degradation.",
    "mapper": "The scans of a lap of 64 views in a room and in a furnished one and of 41 views through a corridor "
              "(rhs.testing), 5 mm of noise on a range; of a lap whose poses are 2 cm and half a degree wrong; of one on "
              "which somebody passes by to and fro.",
    "loop_closer": "Surveys of 127 views, twice round a room: with noise alone, bent by 0.15 degrees a view, and the same "
                   "in a furnished room; 41 views through a corridor, bent too, in which there is no loop.",
}
PATIENCE_S = {"planner": 20.0, "localiser": 180.0, "odometry": 180.0, "mapper": 60.0, "loop_closer": 180.0}
CHECK_PATIENCE_S = 120.0
MADE_UP = 0.05  # share of walls that are none from which the verdict says so
WIDE = 10.0  # sigmas over errors, as many as rhs.testing allows the other way round
WAITS = 0.2  # share of its time from which the verdict says that CPU times are not all of it
HARM_PCT = 110.0  # rhs.testing allows a tenth more
Tell = Callable[[str], None]


@dataclass
class Card:
    """content: what card.json holds. results: part -> what it did, for the pictures; pictures: those drawn already."""

    content: dict[str, Any]
    results: dict[str, ForkResult] = field(default_factory=dict)
    pictures: list[tuple[str, Any]] = field(default_factory=list)

    @property
    def passes(self) -> bool:
        return bool(self.content["passes"])


def card_of(kind: str, name: str, settings: Any, tell: Tell = lambda said: None) -> Card:
    """The card of `kind=name` with these settings. tell: hears what is under way. Raises ConfigError for a kind that has
    none."""
    if kind not in (*KINDS, DEGRADE, SLAM):
        raise ConfigError(f"card: a {kind} has no card; there is one for {', '.join([*KINDS, DEGRADE, SLAM])}")
    tell("contract")
    content = about(kind, name, settings)
    card = Card(content)
    if kind in MEASURED:
        measure(card, kind, {name: settings} | references(kind, name), tell)
    content["verdict"] = verdict(content)
    content["passes"] = (all(one["holds"] for one in content["contract"]) and not content.get("faults")
                         and not content.get("ended", {}).get(content["part"]))
    card.content = without_nan(content)
    return card


def about(kind: str, name: str, settings: Any) -> dict[str, Any]:
    """What every card says of a part: what it is, and whether it keeps its contract."""
    return {"part": f"{kind}={name}", "from": " and ".join(origin.distribution for origin in registry.origins(kind, name)),
            "settings": plain_settings.plain(settings), "commit": commit(), "versions": versions(),
            "contract": contract(kind, settings)}


def contract(kind: str, settings: Any, tell: Callable[[dict[str, Any]], None] = lambda one: None) -> list[dict[str, Any]]:
    """Every check of rhs.testing, whether it holds and why not, in a process of its own. tell: hears each as it ends."""
    names = list(checks(kind))

    def work() -> Iterator[tuple[str, str]]:
        for name, check in checks(kind).items():
            with tempfile.TemporaryDirectory() as folder:
                try:
                    check(settings, Path(folder))
                    yield name, ""
                except AssertionError as error:
                    yield name, " ".join(str(error).split()) or "it does not hold"

    result = run_forked(work, patience_s=CHECK_PATIENCE_S, tell=lambda said: tell(_checked(*said)))
    left = [_checked(name, "not reached" if k else result.ended) for k, name in enumerate(names[len(result.items):])]
    for one in left:
        tell(one)
    return [_checked(*said) for said in result.items] + left


def _checked(name: str, why: str) -> dict[str, Any]:
    return {"check": name.replace("_", " "), "holds": not why, "why": why}


def references(kind: str, but: str) -> dict[str, Any]:
    """First-party parts to stand beside, with their defaults; those that cannot be used here are left out."""
    return {name: registry.load(kind, name)() for name in REFERENCES[kind]
            if name != but and name in registry.names(kind) and registry.failure(kind, name) is None}


def measure(card: Card, kind: str, parts: dict[str, Any], tell: Tell) -> None:
    """The figures of the part and of those beside it, each in a process of its own."""
    module, content = MEASURED[kind], card.content
    module.prepare()
    content |= {"standard_set": STANDARD_SET[kind], "columns": module.COLUMNS, "figures": {}, "ended": {}}
    for name, settings in parts.items():
        part = f"{kind}={name}"
        tell(part)
        work = partial(module.work, settings, degraded=part == content["part"])
        result = card.results[part] = run_forked(work, patience_s=PATIENCE_S[kind])
        content["figures"][part] = module.figures(result)
        content["ended"][part] = result.ended
    content |= module.details(card.results[content["part"]]) | {"waited_share": card.results[content["part"]].waited_share}


def verdict(content: dict[str, Any]) -> list[str]:
    """What the card says, in sentences."""
    said = [of_contract(content)]
    ended = content.get("ended", {}).get(content["part"])
    if "faults" in content:
        faults = [f"{one['says']} ({one['times']} of {content['answers']} answers: {one['questions'][0]})"
                  for one in content["faults"]]
        said += faults or [f"no fault in {content['answers']} answers"]
    if ended:
        said.append(f"did not come to its end on the standard set: {ended}")
    figures = content.get("figures", {}).get(content["part"], {})
    if "wrong_sure_share" in figures:
        said.append(f"wrong and sure of it in {100 * figures['wrong_sure_share']:.1f} % of views, "
                    f"right in {100 * figures['right_share']:.0f} %")
    if math.isfinite(figures.get("within_95_share", math.nan)):
        held = figures["within_95_share"]
        said.append(f"{100 * held:.0f} % of its errors within the ellipse that should hold 95 %"
                    + (": too sure of itself" if held < 0.9 else ""))
    said += [f"states the error of its {what} {figures[name]:.0f} times as wide as it is: too unsure, or another unit"
             for name, what in (("wide_m", "position"), ("wide_rad", "turn")) if figures.get(name, 0.0) > WIDE]
    if figures.get("false_walls_share", 0.0) > MADE_UP:
        said.append(f"{100 * figures['false_walls_share']:.0f} % of its walls stand where nothing does")
    if figures.get("false_share", 0.0) > 0.0:
        said.append(f"{100 * figures['false_share']:.0f} % of the {figures['accepted']} loops that it believes are false")
    if figures.get("harm_pct", 0.0) > HARM_PCT:
        said.append(f"makes a survey without a loop worse: {figures['harm_pct']:.0f} % of the error before")
    if content.get("waited_share", 0.0) > WAITS:
        said.append(f"waits for {100 * content['waited_share']:.0f} % of its time: it sleeps, or others do its work (files, "
                    "processes, the network); CPU times do not hold that")
    for one in content.get("breaks", []):
        if one["breaks_at"] is not None:
            said.append(f"half is lost at {one['dial']}={one['breaks_at']:g}")
    return said + [f"beside it, {part} did not come to its end: {why}" for part, why in content.get("ended", {}).items()
                   if why and part != content["part"]]


def of_contract(content: dict[str, Any]) -> str:
    """Whether it keeps its contract, in a sentence."""
    failed = [one["check"] for one in content["contract"] if not one["holds"]]
    count = len(content["contract"])
    return (f"breaks its contract in {len(failed)} of {count} checks: {', '.join(failed)}" if failed
            else f"keeps its contract ({count} checks)")


def table(content: dict[str, Any]) -> tuple[list[str], Sequence[Sequence[str]]]:
    """Names and cells of the figures, the part itself first."""
    names = [name for name in content.get("columns", {}) if any(name in found for found in content["figures"].values())]
    return ["part", *names], [[part, *(short(found.get(name)) for name in names)]
                              for part, found in content.get("figures", {}).items()]


def short(value: Any) -> str:
    """A figure in three digits; a dash for one that nobody knows."""
    return "-" if value is None or value != value else f"{value:.3g}" if isinstance(value, float) else str(value)
