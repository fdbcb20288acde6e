"""Counterfactual patrols in processes of their own, forked where they begin to differ.

The survey is taken once. From there a process for each way of estimating it (with true or real senses and odometry), and
from its end a process for each patrol: what is common to several runs is computed once and shared by fork, so that every
patrol is what it would have been alone. At most `processes` of them work at a time.
"""

from __future__ import annotations

import importlib
import json
import multiprocessing
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from rhs.api.contracts import DEGRADE, KINDS, Context, Source
from rhs.api.files import replacing
from rhs.api.floorplan import World
from rhs.api.randomness import generator
from rhs.api.task import Parts
from rhs.base.processes import die_with_parent
from rhs.config import registry
from rhs.config.degraded import Degraded, fault_of
from rhs.config.parts import Chosen, build, build_part
from rhs.config.registry import members_of
from rhs.estimation.survey import ViewCollector
from rhs.metrics.evaluate import evaluate
from rhs.patrol.culprit import in_one_line
from rhs.patrol.gate import gated
from rhs.patrol.job import collect, patrol, settle
from rhs.patrol.loop import end_of
from rhs.patrol.observers import RunLog, open_log, unwatched
from rhs.patrol.run import RunContext

from .oracles import TrueClosing, TrueDrive, TrueLocaliser, TrueMap, TrueOdometry, Watched
from .settings import Blame

SURVEYED = ("sense", "odometry")  # links that the survey's estimate depends on; drive where wheels are spoiled
TRACEBACK = "traceback"  # of columns: what no table holds
KILLED = {"status": "killed", "reason": "its process was killed"}
# Compiled code that every patrol loads: once, before they are forked
COMMON = ("rhs.estimation.paths.shorten", "rhs.estimation.scans.votes", "rhs.metrics.judge_kernels")
OF = multiprocessing.get_context("fork")


@dataclass
class Chain:
    """All that a counterfactual is made of."""

    settings: Blame
    context: RunContext
    world: World
    parts: Parts
    source: Watched  # without its degradations
    spoiling: tuple[str, ...]  # the link that each degradation is a fault of
    folder: Path  # of the counterfactuals; the patrol with nothing replaced goes to the run folder

    @property
    def surveyed(self) -> frozenset[str]:
        """Links that the survey's estimate depends on."""
        return frozenset({*SURVEYED, *self.spoiling})

    def spoiled(self, state: frozenset[str]) -> Source:
        """The source behind the degradations of all links but those that were given the truth."""
        if not isinstance(self.parts.source, Degraded):
            return self.source
        kept = [one for one, link in zip(self.parts.source.chain, self.spoiling, strict=True) if link not in state]
        return cast(Source, Degraded(self.source, kept)) if kept else self.source


def spoiling(context: RunContext) -> tuple[str, ...]:
    """The link that each degradation of the run is a fault of."""
    chosen = context.config.parts.get(DEGRADE)
    return () if chosen is None else tuple(fault_of(one) for one in members_of(chosen.settings))


class Trials:
    """A process for each way of estimating the survey, begun when it is first needed, that drives patrols when told to."""

    def __init__(self, chain: Chain, processes: int) -> None:
        self.chain, self.at_once = chain, OF.Semaphore(processes)
        for name in COMMON:
            importlib.import_module(name)
        self.groups: dict[frozenset[str], tuple[Any, Any]] = {}  # state of the survey -> process, what it is told

    def drive(self, wanted: Sequence[frozenset[str]], done: Callable[[int], None]) -> dict[frozenset[str], dict[str, Any]]:
        """Links that were given the truth -> columns of the patrol, `status` and `reason` among them. done(n): how many have
        ended."""
        sys.stdout.flush()
        sys.stderr.flush()
        states = {state: [links for links in wanted if links & self.chain.surveyed == state]
                  for state in sorted({links & self.chain.surveyed for links in wanted}, key=sorted)}
        for state, resting in states.items():
            if state not in self.groups:
                queue = OF.SimpleQueue()
                group = OF.Process(target=_survey, args=(self.chain, state, queue, self.at_once))
                group.start()
                self.groups[state] = group, queue
            self.groups[state][1].put(resting)
        while any(self.groups[state][0].is_alive() and not all(map(self._ended, resting))
                  for state, resting in states.items()):
            time.sleep(0.1)
            done(sum(map(self._ended, wanted)))
        return {links: _read(self.chain, links) for links in wanted}

    def close(self) -> None:
        """No more."""
        for group, queue in self.groups.values():
            queue.put(None)
            group.join()

    def _ended(self, links: frozenset[str]) -> bool:
        return _answer(self.chain, links).exists()


def _survey(chain: Chain, state: frozenset[str], queue: Any, at_once: Any) -> None:
    """In a process: estimate the survey once, then a process for each patrol that rests on it."""
    die_with_parent()
    wanted: list[frozenset[str]] | None = None
    try:
        with at_once:
            parts = _estimating(chain, state)
            log = _log(chain, parts, chain.folder / f"survey_{label(state)}")
            collected = end_of(collect(parts, chain.context, chain.settings, log))
        while (wanted := queue.get()) is not None:
            patrols = [OF.Process(target=_patrol, args=(chain, parts, collected, log, links, at_once)) for links in wanted]
            for one in patrols:  # forked when its turn comes: each that waited would count as memory of the run
                at_once.acquire()
                one.start()
            for one, links in zip(patrols, wanted, strict=True):
                one.join()
                if not _answer(chain, links).exists():
                    _write(chain, links, KILLED)
    except BaseException as error:
        wanted = queue.get() if wanted is None else wanted
        while wanted is not None:
            for links in wanted:
                _write(chain, links, _failed(chain, error))
            wanted = queue.get()
    else:
        log.table.close()


def _patrol(chain: Chain, parts: Parts, collected: ViewCollector, led: RunLog, links: frozenset[str], at_once: Any) -> None:
    """In a process that holds one of `at_once`: settle the survey, patrol, evaluate."""
    die_with_parent()
    try:
        parts = _patrolling(chain, parts, links)
        folder = chain.context.folder if not links else chain.folder / label(links)
        log = _log(chain, parts, folder)
        log.table.add_rows(led.table.partial.read_text("utf-8"))
        surveyed = settle(collected, parts, log)
        end_of(patrol(parts, chain.settings, surveyed, log, seed=chain.context.seed))
        log.table.close()
        columns: dict[str, Any] = {"status": "ok", **evaluate(folder, "patrol")}
    except BaseException as error:
        columns = _failed(chain, error)
    finally:
        at_once.release()
    _write(chain, links, columns)


def _failed(chain: Chain, error: BaseException) -> dict[str, Any]:
    """What became of a patrol that an error ended; its traceback for whoever mends it."""
    reason = in_one_line(error, "", chain.context.config, vars(chain.parts))
    return {"status": "failed", "reason": reason, TRACEBACK: "".join(traceback.format_exception(error))}


def _estimating(chain: Chain, state: frozenset[str]) -> Parts:
    """The parts with the truth in what the survey's estimate depends on, where it was asked for."""
    parts, context = replace(chain.parts, source=chain.spoiled(state)), chain.context
    if "sense" in state:
        parts = _built_for_clean_views(chain, parts)
    if "odometry" in state:
        scans = "scan" not in context.settings("sensor").provides
        parts.odometry = TrueOdometry(parts.odometry, chain.source, scans=scans)
    else:
        needs = context.settings("odometry").needs
        parts.odometry = gated(parts.odometry, needs, chain.settings.gate, parts.who["odometry"],
                               timed=parts.source.timed)
    return parts


def _built_for_clean_views(chain: Chain, parts: Parts) -> Parts:
    """All parts anew, since they are told of the camera: behind a sensor without noise, before the parts' source."""
    run, chosen = chain.context, dict(chain.context.config.parts)
    chosen.pop(DEGRADE, None)
    sensor = chosen["sensor"]
    if hasattr(sensor.settings, "noise"):
        chosen["sensor"] = Chosen(sensor.name, replace(sensor.settings, noise=False))
    nobody: dict[str, Any] = dict.fromkeys((kind for kind in KINDS if kind != "source"), None)
    return build(chosen, seed=run.seed, world=chain.world, folder=run.folder, features=run.features,
                 made=replace(parts, **nobody))


def _patrolling(chain: Chain, parts: Parts, links: frozenset[str]) -> Parts:
    """The parts with the truth in the links that come after the survey."""
    parts, run = replace(parts), chain.context
    if "closing" in links:
        parts.loop_closer = TrueClosing({capture.stamp_s: truth for capture, truth, _ in chain.source.taken
                                         if truth is not None})
    if "map" in links:
        parts.mapper = TrueMap(parts.mapper, chain.world)
    if "localise" in links:
        parts.localiser = TrueLocaliser(parts.source)
    if "plan" in links:
        exact = Chosen("astar", registry.load("planner", "astar")())
        context = Context(generator(run.seed, "planner"), parts.source.camera, parts.source.facts, run.folder, run.features)
        parts.planner = build_part("planner", exact, context)
    if "drive" in links:  # below the degradations, in this process
        chain.source.source = TrueDrive(chain.source.source)  # type: ignore[assignment]
    return parts


def _log(chain: Chain, parts: Parts, folder: Path) -> RunLog:
    folder.mkdir(parents=True, exist_ok=True)
    config = replace(chain.context.config, recording="off", live="")
    return open_log(config, parts, chain.world, folder, unwatched)


def label(links: frozenset[str]) -> str:
    """A folder's name for a set of links."""
    return "+".join(sorted(links)) or "nothing"


def _answer(chain: Chain, links: frozenset[str]) -> Path:
    return chain.folder / f"{label(links)}.json"


def _write(chain: Chain, links: frozenset[str], columns: Mapping[str, Any]) -> None:
    with replacing(_answer(chain, links)) as file:
        file.write(json.dumps({"oracles": sorted(links), **columns}) + "\n")


def _read(chain: Chain, links: frozenset[str]) -> dict[str, Any]:
    try:
        return json.loads(_answer(chain, links).read_text("utf-8"))
    except (OSError, ValueError):
        return dict(KILLED)
