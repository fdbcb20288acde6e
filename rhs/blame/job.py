"""The work of task=blame: take the survey, run the counterfactuals, share out what was lost."""

from __future__ import annotations

import csv
import math
import os
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rhs.api.errors import ConfigError, RhsError
from rhs.api.files import replacing
from rhs.api.floorplan import World
from rhs.api.randomness import generator
from rhs.api.task import Value
from rhs.config.degraded import Degraded
from rhs.metrics.blame import (
    MEASURES,
    Losses,
    judged,
    losses_of,
    off_since,
    shapley,
    shapley_of_orders,
    subsets,
)
from rhs.patrol.observers import write_json
from rhs.patrol.run import RunContext
from rhs.runfolder.run import Run

from .oracles import Watched
from .settings import MOST_EXACT, Blame
from .trials import Chain, label, run_trials, spoiling


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
        self.orders = [] if len(settings.links) <= MOST_EXACT else self._orders()

    def _orders(self) -> list[list[str]]:
        rng = generator(self.context.seed, "blame")
        return [[self.settings.links[k] for k in rng.permutation(len(self.settings.links))]
                for _ in range(self.settings.orders)]

    def run(self) -> Mapping[str, Value]:
        """The columns follow from blame.json and from the files of the patrol with nothing replaced."""
        folder, links = self.context.folder, self.settings.links
        wanted = subsets(links) if not self.orders else list(dict.fromkeys(
            [frozenset(), *(frozenset([link]) for link in links),
             *(frozenset(order[:place]) for order in self.orders for place in range(len(order) + 1))]))
        source = self.parts.source
        bare = source.source if isinstance(source, Degraded) else source
        chain = Chain(self.settings, self.context, self.world, self.parts, Watched(bare), self.spoiling,
                      folder / "counterfactuals")
        if any(truth is None for _, truth, _ in chain.source.taken):
            raise ConfigError("task=blame needs a source that knows the truth")
        chain.folder.mkdir()
        with progress(len(wanted), shown=self.context.watched) as tell:
            columns = run_trials(chain, wanted, self.settings.processes or len(os.sched_getaffinity(0)), tell)
        shutil.rmtree(chain.folder)
        write_table(folder / "counterfactuals.csv", columns)
        for known, found in columns.items():
            if found["status"] != "ok":
                raise RhsError(f"the patrol with {label(known)} replaced by the truth: {found['status']}: {found['reason']}")
        write_json(folder / "blame.json", self._account(columns, off_since(Run(folder).steps)))
        return {}

    def _account(self, columns: Mapping[frozenset[str], Mapping[str, Any]], since: int) -> Any:
        """What blame.json holds."""
        links = self.settings.links
        lost = {known: losses_of(found) for known, found in columns.items()}
        losses: dict[str, Losses] = {name: {known: found[name] for known, found in lost.items()} for name in MEASURES}
        errors: dict[str, dict[str, float]] = {}
        shares: dict[str, dict[str, float]] = {}
        for measure, known in losses.items():
            if self.orders:
                found = shapley_of_orders(known, self.orders)
                shares[measure] = {link: share for link, (share, _) in found.items()}
                errors[measure] = {link: error for link, (_, error) in found.items()}
            else:
                shares[measure] = shapley(known, links)
        nothing, everything = frozenset[str](), frozenset(links)
        return known_or_none({
            "links": links, "runs": len(columns), "off_since": since,
            **judged(losses, links, since=since, shares=shares), "shares": shares, "standard_errors": errors,
            "loss": {name: losses[name][nothing] for name in MEASURES},
            "rest": {name: losses[name][everything] for name in MEASURES},
            "losses": {label(known): found for known, found in lost.items()}})


def known_or_none(value: Any) -> Any:
    """The value with NaN, which JSON does not know, as null."""
    if isinstance(value, dict):
        return {name: known_or_none(item) for name, item in value.items()}
    return None if isinstance(value, float) and math.isnan(value) else value


@contextmanager
def progress(patrols: int, *, shown: bool) -> Iterator[Callable[[int], None]]:
    """A bar on stderr that is told how many patrols have ended."""
    from tqdm import tqdm

    with tqdm(total=patrols, desc="blame", unit="patrol", disable=None if shown else True) as bar:
        yield lambda ended: bar.update(ended - bar.n) and None


def write_table(path: Path, columns: Mapping[frozenset[str], Mapping[str, Any]]) -> None:
    """counterfactuals.csv: one row per patrol."""
    names: Sequence[str] = list(dict.fromkeys(name for found in columns.values() for name in found if name != "oracles"))
    with replacing(path) as file:
        table = csv.DictWriter(file, ["oracles", *names], restval="", lineterminator="\n")
        table.writeheader()
        for links, found in columns.items():
            table.writerow({**found, "oracles": label(links)})
