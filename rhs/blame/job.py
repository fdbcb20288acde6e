"""The work of task=blame: take the survey, run the counterfactuals, share out what was lost."""

from __future__ import annotations

import csv
import math
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rhs.api.errors import ConfigError, RhsError
from rhs.api.files import replacing
from rhs.api.floorplan import World
from rhs.api.randomness import generator
from rhs.api.task import Value
from rhs.base.system import processors
from rhs.config.degraded import Degraded
from rhs.metrics.blame import ALONE, MEASURES, WORTH, judged, losses_of, measure_of, off_since
from rhs.metrics.shares import (
    Losses,
    bounds,
    middle,
    next_patrols,
    off_by,
    shapley,
    shapley_of_orders,
    subsets,
)
from rhs.patrol.observers import drives_in, meter, write_json
from rhs.patrol.run import RunContext
from rhs.runfolder.run import Run

from .oracles import Watched
from .settings import MOST_EXACT, Blame
from .trials import SURVEYED, TRACEBACK, Chain, Trials, label, spoiling


class BlameJob:
    """The patrol and its counterfactuals. Files: those of the patrol with nothing replaced, blame.json (losses, shares, the
    sentence), counterfactuals.csv (a row for each patrol, `oracles` says which links were given the truth)."""

    def __init__(self, settings: Blame, context: RunContext, world: World) -> None:
        if "slam" in context.config.parts:
            raise ConfigError("task=blame takes the chain apart; slam= is one part: blame has nothing to replace")
        self.world, self.settings, self.context = world, settings, context
        self.spoiling = spoiling(context)
        noisy = hasattr(context.settings("sensor"), "noise") or "sense" in self.spoiling
        if "sense" in settings.links and not noisy:
            raise ConfigError(f"links: sensor={context.config.parts['sensor'].name} has no setting `noise` to switch off; "
                              f"leave out sense")
        if "drive" in settings.links and "teleport" not in context.config.parts["source"].settings.provides:
            raise ConfigError(f"links: source={context.config.parts['source'].name} cannot teleport; leave out drive")
        self.parts = context.parts(world=world)
        if "map" in settings.links and not drives_in(world, self.parts.source.facts):
            rest = ",".join(link for link in settings.links if link != "map")
            raise ConfigError(f"links: {self.parts.who['source']} drives in a world of its own, whose true map nobody "
                              f"knows; leave out map: links=[{rest}]")
        rng, count = generator(context.seed, "blame"), len(settings.links)
        self.orders = [[settings.links[k] for k in rng.permutation(count)]
                       for _ in range(settings.orders if count > MOST_EXACT else 0)]

    def run(self) -> Mapping[str, Value]:
        """The columns follow from blame.json and from the files of the patrol with nothing replaced."""
        folder, settings = self.context.folder, self.settings
        source = self.parts.source
        bare = source.source if isinstance(source, Degraded) else source
        watched = Watched(bare, self.parts.who["source"])
        chain = Chain(self.settings, self.context, self.world, self.parts, watched, self.spoiling,
                      folder / "counterfactuals")
        if any(truth is None for _, truth, _ in chain.source.taken):
            raise ConfigError("task=blame needs a source that knows the truth")
        chain.folder.mkdir()
        columns = self._driven(Trials(chain, settings.processes or processors()))
        shutil.rmtree(chain.folder)
        tracebacks = {known: found.pop(TRACEBACK, "") for known, found in columns.items()}
        write_table(folder / "counterfactuals.csv", columns)
        for known, found in columns.items():
            if found["status"] != "ok":
                said = f"{found['status']}: {found['reason']}"
                failed = RhsError(f"the patrol with {label(known)} replaced by the truth: {said}")
                failed.add_note(tracebacks[known])
                raise failed
        write_json(folder / "blame.json", self._account(columns, off_since(Run(folder).steps)))
        return {}

    def _driven(self, trials: Trials) -> dict[frozenset[str], dict[str, Any]]:
        """Links that were given the truth -> columns of the patrol, as many patrols as it takes."""
        links, every = self.settings.links, subsets(self.settings.links)
        wanted = every if self.settings.exact else [every[0], every[-1]]
        if self.orders:
            wanted = every = list(dict.fromkeys(
                [frozenset(), *(frozenset([link]) for link in links),
                 *(frozenset(order[:place]) for order in self.orders for place in range(len(order) + 1))]))
        columns: dict[frozenset[str], dict[str, Any]] = {}
        with meter(None, quiet=not self.context.watched, desc="blame", unit="patrol") as bar:
            while wanted:
                ended, bar.total = len(columns), len(columns) + len(wanted)
                bar.update(ended - bar.n)
                columns |= trials.drive(wanted, lambda more, ended=ended: bar.update(ended + more - bar.n))  # type: ignore[misc]
                wanted = [] if self.orders else self._next(columns)
            trials.close()
        return {one: columns[one] for one in every if one in columns}

    def _next(self, columns: Mapping[frozenset[str], Mapping[str, Any]]) -> list[frozenset[str]]:
        """The patrols that are driven next."""
        if any(found["status"] != "ok" for found in columns.values()):
            return []
        losses = self._losses(columns)
        measure = measure_of(losses, self.settings.links)
        return next_patrols(losses[measure], self.settings.links, worth=WORTH[measure], alone=ALONE) if measure else []

    def _losses(self, columns: Mapping[frozenset[str], Mapping[str, Any]]) -> dict[str, Losses]:
        """Measure -> losses of the patrols that were driven; of the survey, those of all that rest on the same one."""
        lost = {known: losses_of(found) for known, found in columns.items()}
        losses: dict[str, Losses] = {name: {known: found[name] for known, found in lost.items()} for name in MEASURES}
        if not self.orders:
            surveyed = {*SURVEYED, *self.spoiling, "closing"}
            ate = {known & surveyed: loss for known, loss in losses["ate"].items()}
            losses["ate"] = {one: ate[one & surveyed] for one in subsets(self.settings.links) if one & surveyed in ate}
        return losses

    def _account(self, columns: Mapping[frozenset[str], Mapping[str, Any]], since: int) -> Any:
        """What blame.json holds."""
        links, losses = self.settings.links, self._losses(columns)
        shares: dict[str, dict[str, float]] = {}
        errors: dict[str, dict[str, float]] = {}
        for measure, known in losses.items():
            if self.orders:
                found = shapley_of_orders(known, self.orders)
                shares[measure] = {link: share for link, (share, _) in found.items()}
                errors[measure] = {link: error for link, (_, error) in found.items()}
            else:
                shares[measure] = shapley(middle(known, links), links)
                errors[measure] = off_by(bounds(known, links), links)
        verdict = judged(losses, links, since=since, shares=shares if self.orders else None)
        nothing, everything = frozenset[str](), frozenset(links)
        return known_or_none({
            "links": links, "runs": len(columns), "off_since": since, **verdict, "shares": shares,
            "off_by": errors,
            "loss": {name: losses[name][nothing] for name in MEASURES},
            "rest": {name: losses[name][everything] for name in MEASURES},
            "losses": {label(known): losses_of(found) for known, found in columns.items()}})


def known_or_none(value: Any) -> Any:
    """The value with NaN, which JSON does not know, as null."""
    if isinstance(value, dict):
        return {name: known_or_none(item) for name, item in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


def write_table(path: Path, columns: Mapping[frozenset[str], Mapping[str, Any]]) -> None:
    """counterfactuals.csv: one row per patrol."""
    names: Sequence[str] = list(dict.fromkeys(name for found in columns.values() for name in found if name != "oracles"))
    with replacing(path) as file:
        table = csv.DictWriter(file, ["oracles", *names], restval="", lineterminator="\n")
        table.writeheader()
        for links, found in columns.items():
            table.writerow({**found, "oracles": label(links)})
