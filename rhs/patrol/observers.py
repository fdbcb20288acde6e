"""Everything of one run that listens to its steps, and the files that are not a step's."""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from rhs.api.files import replacing
from rhs.api.floorplan import Moving, World, after, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Closure, Step, WorldFacts
from rhs.api.records import Path as Plan
from rhs.api.task import Parts
from rhs.base.memory import let_go_of_compiler
from rhs.base.processes import end_unless
from rhs.config.compose import RunConfig, to_plain
from rhs.metrics.patrol import VISITED_M
from rhs.recording.rerun_view import Audience, Listener, LiveView
from rhs.recording.writer import Recorder, bytes_a_view
from rhs.runfolder.steps_csv import StepTable
from rhs.worlds.maps import save_map
from rhs.worlds.reach import reach

if TYPE_CHECKING:
    from tqdm import tqdm

log = logging.getLogger("rhs")
SAID_BYTES = 10e6  # a recording that is smaller is not spoken of
Watch = Callable[[Iterable[Step], str, int | None], Iterable[Step]]


def unwatched(steps: Iterable[Step], phase: str, expected: int | None) -> Iterable[Step]:
    """The default watcher: looks away. A progress bar has the same signature."""
    return steps


class Beside:
    """A listener in a thread of its own: it writes a step, which nobody changes, while the run makes the next one.

    What it raises comes out at the next call."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._thread = ThreadPoolExecutor(1, "recorder")
        self._under_way: Future[None] | None = None

    def step(self, step: Step) -> None:
        self._finish()
        self._under_way = self._thread.submit(self._listener.step, step)

    def map(self, grid: OccupancyGrid, stamp_s: float) -> None:
        self._finish()
        self._listener.map(grid, stamp_s)

    def close(self, status: str = "ok", reason: str = "") -> None:
        try:
            self._finish()
        finally:
            self._thread.shutdown()
            self._listener.close(status, reason)

    def _finish(self) -> None:
        under_way, self._under_way = self._under_way, None
        if under_way is not None:
            under_way.result()


@dataclass
class RunLog:
    """Everything of one run that listens to its steps: the table, the recording, the progress bar. in_world: the source
    drives in the world that was typed; world: that one, for the judge, where it does."""

    folder: Path
    table: StepTable
    recorder: Listener
    watch: Watch
    in_world: bool = True
    world: World | None = None
    counts: dict[str, int] = field(default_factory=dict)
    began_s: float | None = None
    stamp_s: float = 0.0

    @property
    def robot_s(self) -> float:
        """Seconds the robot has lived through, NaN before the first view."""
        return float("nan") if self.began_s is None else self.stamp_s - self.began_s

    def follow(self, steps: Iterable[Step], phase: str, expected: int | None) -> Iterator[Step]:
        process = os.getpid()
        for step in self.watch(steps, phase, expected):
            end_unless(process)
            self.table.add(step)
            self.recorder.step(step)
            self.counts[phase] = self.counts.get(phase, 0) + 1
            self.stamp_s = step.stamp_s
            self.began_s = step.stamp_s if self.began_s is None else self.began_s
            if self.counts[phase].bit_count() == 1:  # views 1, 2, 4, ...: kernels are loaded when they are first needed
                let_go_of_compiler()
            yield step


def open_log(config: RunConfig, parts: Parts, world: World | None, folder: Path, watch: Watch) -> RunLog:
    """The run's files that grow with its steps, and the true plan beside them for the judge."""
    facts = parts.source.facts
    places = [{"name": n, "x_m": x, "y_m": y} for n, x, y in facts.places]
    write_json(folder / "facts.json", {"name": facts.name, "start": list(facts.start), "places": places,
                                       "bounds_m": list(facts.bounds_m), "robot_radius_m": facts.robot_radius_m,
                                       **({"footprint_m": facts.footprint.corners_m} if facts.footprint else {})})
    in_world = world is not None and drives_in(world, facts)
    if world is not None and in_world:
        save_map(folder / "true_map", truth_grid(world))
        if after(world) is not world:
            save_map(folder / "true_map_patrol", truth_grid(after(world)))
        if not world.moving.still:
            write_json(folder / "moving.json", moving_rows(world.moving))
    level = "full" if config.recording == "auto" else config.recording
    if watch is not unwatched:
        _foretell(level, bytes_a_view(level, parts.source.camera, parts.provides), parts.source.views_expected or 0)
    recorder = Recorder(folder / "run.mcap", level, parts.source.camera, facts, config=to_plain(config),
                        timed=parts.source.timed)
    listeners: list[Listener] = [recorder if level == "off" else Beside(recorder)]
    if config.live:
        listeners.append(LiveView(config.live, parts.source.camera, facts.name))
    return RunLog(folder, StepTable(folder), Audience(listeners), watch, in_world, world if in_world else None)


def _foretell(level: str, view_bytes: float, views: int) -> None:
    """Say how large the recording of a survey will be, where it is large, and what makes it smaller."""
    if view_bytes * views >= SAID_BYTES:
        log.warning("rhs: run.mcap takes about %.0f MB for the survey's %d views, and %.0f kB for each of the patrol's; %s"
                    "recording=light: no images", views * view_bytes / 1e6, views, view_bytes / 1e3,
                    "" if level == "jpeg" else "recording=jpeg: half, ")


def write_reach(log: RunLog, truth: np.ndarray | None) -> None:
    """reach.json, for the judge alone: how wide a way there is to each place from where the patrol truly begins. truth: the
    4x4 pose there; nothing is written where nobody knows it."""
    if log.world is None or truth is None:
        return
    room_m, unsure_m = reach(log.world, np.asarray(truth)[:2, 3], within_m=VISITED_M)
    places = [{"name": name, "room_m": room} for (name, *_), room in zip(log.world.places, room_m, strict=True)]
    write_json(log.folder / "reach.json", {"unsure_m": unsure_m, "places": places})


def drives_in(world: World, facts: WorldFacts) -> bool:
    """Whether a simulator drives in the world that was typed: one of somebody else may have its own; its facts tell."""
    return (world.start, world.places) == (tuple(facts.start), tuple(facts.places))


def moving_rows(moving: Moving) -> dict[str, Any]:
    """What moves by itself, for pictures and people; times in seconds of the patrol."""
    people = [{"name": one.name, "path_m": one.path_m.tolist(), "width_m": one.width_m, "height_m": one.height_m,
               "speed_mps": one.speed_mps, "survey": one.survey} for one in moving.people]
    timed = [{"name": one.box.name, "stands_s": [list(pair) for pair in one.stands_s], "every_s": one.every_s,
              "corners_m": one.box.corners_m.tolist(),
              "otherwise_m": None if one.otherwise is None else one.otherwise.corners_m.tolist()} for one in moving.timed]
    return {"people": people, "timed": timed, "light_s": [list(pair) for pair in moving.light_s]}


def closure_rows(closure: Closure) -> dict[str, Any]:
    edges = [{"earlier": e.earlier, "later": e.later, "inliers": e.inliers, "accepted": e.accepted, "reason": e.reason,
              "earlier_from_later": np.round(e.earlier_from_later, 9).tolist()} for e in closure.edges]
    return {"edges": edges, "details": dict(closure.details)}


def plan_row(mission: int, plan: Plan) -> dict[str, Any]:
    return {"mission": mission, "reason": str(plan.reason), "plan_ms": plan.plan_ms, "learn_ms": plan.learn_ms,
            "points_m": np.asarray(plan.points_m).tolist(), "raw_m": np.asarray(plan.raw_m).tolist()}


def write_json(path: Path, value: Any) -> None:
    """Written whole or not at all; numbers and arrays of NumPy as plain ones."""
    with replacing(path) as file:
        file.write(json.dumps(value, indent=1, default=methodcaller("tolist")) + "\n")


def in_notebook() -> bool:
    """Whether a person looks at this process through a notebook."""
    if "IPython" not in sys.modules:
        return False
    from IPython import get_ipython  # type: ignore[import-not-found,unused-ignore]

    return hasattr(get_ipython(), "kernel")


def meter(total: int | None, *, quiet: bool = False, **how: Any) -> tqdm[NoReturn]:
    """A bar on stderr where somebody looks at a terminal or a notebook. how: as of tqdm."""
    from tqdm import tqdm

    looked_at = sys.stderr is not None and (sys.stderr.isatty() or in_notebook())
    return tqdm(total=total, disable=quiet or not looked_at, file=sys.stderr, dynamic_ncols=True, **how)


def bar(steps: Iterable[Step], phase: str, expected: int | None) -> Iterator[Step]:
    """The same steps; a bar with the phase, the place in it and the last event is drawn on stderr meanwhile."""
    with meter(expected, desc=f"{phase:<8}", unit="view", smoothing=0.1) as shown:
        for step in steps:
            shown.set_postfix_str(_note(step), refresh=False)
            shown.update()
            yield step


def _note(step: Step) -> str:
    words = [str(step.motion.status)] if str(step.motion.status) != "ok" else []
    if step.mission:
        words.append(f"mission {step.mission}")
    return " ".join([*words, step.event])
