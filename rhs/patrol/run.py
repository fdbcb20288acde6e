"""One run: build its task, do the work, evaluate, write the row, draw."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.api.contracts import Context
from rhs.api.floorplan import World
from rhs.api.geometry import se2
from rhs.api.records import Step
from rhs.api.spare import grant
from rhs.api.task import Parts, StepJob
from rhs.base.errors import ConfigError, ContractError
from rhs.base.global_generators import drawn_since, global_states
from rhs.base.memory import hand_back, keep_freed_memory, let_go_of_compiler
from rhs.base.processes import end_unless
from rhs.base.provenance import commit, peak_memory_mb, versions
from rhs.config.compose import RunConfig, identity, write_config
from rhs.config.dictionary import RUN
from rhs.config.parts import Chosen, build, build_part, called
from rhs.metrics.evaluate import evaluate
from rhs.metrics.success import with_success
from rhs.recording.rerun_view import check_live
from rhs.runfolder.row import begin_row, sound, write_row
from rhs.worlds.world import load_world

from .culprit import exit_noticed, in_one_line, raised_in, write_traceback
from .eyes import Ahead, Eyes, Remembered, looks_ahead, wants_ahead
from .loop import Led, end_of, steps
from .observers import RunLog, Watch, open_log, unwatched

if TYPE_CHECKING:
    from rhs.reports.beside import Drawer

    from .shared_survey import DrawnViews, SharedSurvey

    Keep = Callable[[SharedSurvey], None]


def run_config(config: RunConfig, folder: Path, watch: Watch = unwatched, *,
               shared: SharedSurvey | None = None, keep: Keep | None = None,
               building: World | None = None, drawn: DrawnViews | None = None) -> dict[str, Any]:
    """Run one experiment in `folder` and return its row, which is also written there whatever the outcome.

    Raises ConfigError, before anything ran, for what can be refused. A failure later is a row with a reason; the
    exception that caused it is chained to the returned row under the key `_cause` and not written. shared: the survey
    that this run begins with, led already. keep: is given the survey that this run leads.
    building: where it was read already. drawn: the views of the survey, where they were.
    """
    return end_of(run_steps(config, folder, watch, shared=shared, keep=keep, building=building, drawn=drawn, alone=True))


def run_steps(config: RunConfig, folder: Path, watch: Watch = unwatched, *,
              shared: SharedSurvey | None = None, keep: Keep | None = None,
              building: World | None = None, drawn: DrawnViews | None = None,
              alone: bool = False) -> Generator[Step, None, dict[str, Any]]:
    """The same, one step at a time where the task has steps; the row is the generator's value. alone: nobody else computes
    between the steps."""
    keep_freed_memory()
    check_live(config.live)
    run, process = RunContext(config, folder, watch, shared, keep, building, drawn), os.getpid()
    row: dict[str, Any] = identity(config)
    run.looks_for_draws = alone and bool(row["plugins"])
    columns: Mapping[str, Any] = {}
    cause: BaseException | None = None
    with exit_noticed(lambda reason: run_ended(run, row, reason)):
        try:
            begin_row(folder, row)
            row |= {"commit": commit(), "versions": versions()}
            columns = yield from run.work()
        except ConfigError as error:
            if not run.begun:
                run.close("refused", str(error))
                (folder / "row.json").unlink(missing_ok=True)
                raise
            cause = error
        except BaseException as error:  # a plugin may raise anything, even exit; its run is a row with a reason
            cause = error
        end_unless(process)
        known = own_columns(columns)
        row = {**known, **row, "world": known.get("world", row["world"])}  # a task names its recording, nobody what it was
        refused = run.close(**run.outcome_of(cause))
        cause = cause or refused
        run.hand_back()
        row = finished(run, row, run.outcome_of(cause))
    if cause is not None:
        write_traceback(folder, cause)
    run.forget_parts()
    draw(run, row)
    return row | {"_cause": cause}


def finished(run: RunContext, row: Mapping[str, Any], outcome: Mapping[str, str]) -> dict[str, Any]:
    """The row with what became of the run and the figures. Whatever fails in evaluating costs figures, never the row.

    A failure is written at once. A run that went well is `running` until its figures stand: killed before, it is a killed
    run that `recover` has figures for and a sweep does again, not a finished one without them."""
    row = {**sound(outcome), **row}
    if outcome["status"] != "ok":
        write_row(run.folder, row | {"metric_failures": "the process ended before the figures were computed"})
    failures = []
    interrupted: KeyboardInterrupt | None = None
    for compute in (lambda: evaluate(run.folder, run.config.task.name), run.columns):
        try:
            row |= sound(compute())
        except BaseException as error:
            failures.append(run.said_of(error))
            interrupted = error if isinstance(error, KeyboardInterrupt) else interrupted
    if failures:
        row["metric_failures"] = "; ".join([*failures, *filter(None, [row.get("metric_failures")])])
    row = with_success(row)
    write_row(run.folder, row)
    if interrupted is not None:
        raise interrupted
    return row


def own_columns(columns: Mapping[str, Any]) -> dict[str, Any]:
    """The columns of a task that a row can hold; how a run ended and what it was are not its to say."""
    taken = ({column.name for column in RUN} - {"world"}) & set(columns)
    known = sound({name: value for name, value in columns.items() if name not in taken})
    said = [*filter(None, [known.get("row_failures")]),
            *(f"{name}: every row has a column of that name; rename the task's" for name in sorted(taken))]
    return known | ({"row_failures": "; ".join(map(str, said))} if said else {})


def run_ended(run: RunContext, row: Mapping[str, Any], reason: str) -> None:
    """The row of a run whose process is about to be ended by a part."""
    outcome = {"status": "failed", "reason": f"{reason}{run.at}"}
    run.close(**outcome)
    finished(run, row, outcome)


def draw(run: RunContext, row: dict[str, Any]) -> None:
    """The pictures that the files of the folder allow. One that fails is named in the row."""
    config, folder = run.config, run.folder
    if config.pictures == "off" and not config.video:
        return
    try:
        drawn = config.pictures == "off" or (run.drawer is not None and run.drawer.pictures(folder))
        if not drawn or config.pictures == "page" or config.video:
            from rhs.reports import report  # which loads what draws
        if not drawn:
            report.pictures(folder)
        if config.pictures == "page":
            report.html(folder)
        if config.video:
            report.video(folder)
    except BaseException as error:
        row["picture_failures"] = run.said_of(error)
        write_row(folder, row)
        if isinstance(error, KeyboardInterrupt):
            raise


def building_of(config: RunConfig) -> World:
    """The building of a run, for the robot, and with as long a survey, as its source's settings want."""
    source = config.parts["source"].settings
    wanted = {key: getattr(source, key, None) for key in ("robot_radius_m", "camera_height_m", "footprint_m", "survey_m")}
    return load_world(config.world, seed=config.seed, robot={key: metres for key, metres in wanted.items() if metres})


class RunContext:
    """A run under way, as its task sees it (rhs.api.task.TaskContext)."""

    def __init__(self, config: RunConfig, folder: Path, watch: Watch, shared: SharedSurvey | None = None,
                 keep: Keep | None = None, building: World | None = None, drawn: DrawnViews | None = None) -> None:
        self.config, self.folder, self._watch, self.shared, self.keep = config, folder, watch, shared, keep
        self.seed, self.world, self.features = config.seed, config.world, config.features
        self.building = building  # as it was read already
        self.views = drawn  # of the survey, by the parts that drew them
        self.log: RunLog | None = None
        self.drawer: Drawer | None = None
        self.begun = False  # from here on a failure is a row
        self._built: list[Parts] = []
        self._eyes: list[Eyes | Ahead | Remembered] = []
        self._parts: dict[str, object] = {}  # kind -> part, as built last
        self.began_s = time.perf_counter() - sum(led.took_s for led in (shared, drawn) if led is not None)
        self.looks_for_draws = False
        self._generators = global_states()
        self._path = list(sys.path)

    def work(self) -> Generator[Step, None, Mapping[str, Any]]:
        """Build the task's job and run it; the columns that the task knows."""
        job = deepcopy(self.config.task.settings).build(self)
        if not callable(getattr(job, "run", None)):
            raise ConfigError(f"{self.who('task')}: {type(job).__name__}, which build() returned, has no run()")
        self._parts["task"] = job
        self.begun = True
        write_config(self.config, self.folder)
        if isinstance(job, StepJob):
            yield from job.steps()
            return {}
        columns: Mapping[str, Any] | None = job.run()
        if not isinstance(columns, Mapping | None):
            raise ContractError(f"{self.who('task')}: run() returned {type(columns).__name__}; expected columns, or None")
        return columns or {}

    # --- for the task -----------------------------------------------------------------------------------------------

    def settings(self, kind: str) -> Any:
        return self.config.parts[kind].settings

    def who(self, kind: str) -> str:
        return called(kind, self.config.task if kind == "task" else self.config.parts[kind])

    def floor_plan(self) -> World | None:
        """The building, for the robot that the source's settings want."""
        if not self.config.driving:
            return None
        return self.building or building_of(self.config)

    def parts(self, *, world: World | None = None, seed: int | None = None,
              changes: Mapping[str, Mapping[str, Any]] | None = None, without: Collection[str] = ()) -> Parts:
        """As every task has it. without: kinds that nothing will be asked of."""
        chosen = {kind: part for kind, part in self.config.parts.items() if kind not in without}
        for kind, values in (changes or {}).items():
            chosen[kind] = Chosen(chosen[kind].name, replace(chosen[kind].settings, **values))
        parts = build(chosen, seed=self.seed if seed is None else seed, folder=self.folder, features=self.features,
                      world=self.floor_plan() if world is None else world,
                      made=next((led.parts for led in (self.shared, self.views) if led is not None), None))
        self._built.append(parts)
        self._parts |= {kind: getattr(parts, kind) for kind in chosen if hasattr(parts, kind)}
        let_go_of_compiler()
        return parts

    def build_part(self, kind: str, context: Context) -> Any:
        part = build_part(kind, self.config.parts[kind], context)
        self._parts[kind] = part
        return part

    def lead(self, parts: Parts) -> Iterator[Step]:
        led = Led(se2(*parts.source.facts.start), parts.mapper, parts.slam)
        ahead = self.views is None and looks_ahead(self.config.ahead, parts.source, parts.sensor)
        in_line = Eyes(parts.source, parts.sensor, parts.who)
        eyes: Eyes | Ahead | Remembered = Ahead(in_line) if ahead else in_line
        if self.views is not None:
            eyes = Remembered(self.views.seen)
        grant(ahead)
        self._eyes.append(eyes)
        return steps(parts.source, parts.sensor, parts.odometry, led, who=parts.who, eyes=eyes)

    def follow(self, steps: Iterable[Step], phase: str, expected: int | None = None) -> Iterator[Step]:
        if self.log is None:
            self.open_log(self._built[0], self.floor_plan())
        assert self.log is not None
        return self.log.follow(steps, phase, expected)

    # --- for the patrol ---------------------------------------------------------------------------------------------

    def open_log(self, parts: Parts, world: World | None) -> RunLog:
        """The files that grow with the steps of this run."""
        self.log = open_log(self.config, parts, world, self.folder, self._watch)
        return self.log

    def draw_beside(self) -> None:
        """Have the pictures drawn by another process, where a processor is to spare. Begun before the world is built, it has
        loaded what draws when both processors are wanted."""
        if wants_ahead(self.config.ahead) and self.config.pictures != "off":
            from rhs.reports.beside import Drawer

            self.drawer = Drawer()

    # --- for the run ------------------------------------------------------------------------------------------------

    def outcome_of(self, error: BaseException | None) -> dict[str, str]:
        """Status and reason of a run: what ended it, and where in the run, in one line."""
        if error is None:
            return {"status": "ok", "reason": ""}
        if isinstance(error, KeyboardInterrupt | GeneratorExit):
            who, line = raised_in(error, self.config, self._parts)
            return {"status": "interrupted", "reason": f"interrupted{self.at}" + (f" in {who}, {line}" if who else "")}
        return {"status": "failed", "reason": self.said_of(error, self.at)}

    def said_of(self, error: BaseException, at: str = "") -> str:
        """An error in one line, and whose it is."""
        return in_one_line(error, at, self.config, self._parts)

    @property
    def watched(self) -> bool:
        """Whether somebody looks at the progress."""
        return self._watch is not unwatched

    @property
    def at(self) -> str:
        """Where in the run, in words."""
        return f" at step {sum(self.log.counts.values())}" if self.log is not None else ""

    def close(self, status: str, reason: str) -> BaseException | None:
        """Close sources and files, each whatever became of the others; the first refusal."""
        grant(False)
        sys.path += [one for one in self._path if one not in sys.path]  # or nobody is found any more
        closers = [eyes.close for eyes in self._eyes]
        closers += [parts.source.close for parts in self._built if parts.source is not None]
        if self.log is not None:
            closers += [self.log.table.close, lambda: self.log.recorder.close(status, reason)]  # type: ignore[union-attr]
        first: BaseException | None = None
        for close in closers:
            try:
                close()
            except BaseException as error:  # a source may even exit; the files are closed all the same
                first = first or error
        return first

    def forget_parts(self) -> None:
        """Let the parts and all that they hold go: what follows looks at files."""
        self._built, self._parts, self._eyes, self.shared, self.views = [], {}, [], None, None
        self.hand_back()

    def hand_back(self) -> None:
        """Give the system the memory of the views, if there were any."""
        if self.log is not None:
            hand_back()

    def drawn(self) -> set[str]:
        """Whose global generators were used since this run began, in the survey that it shares too."""
        return {*drawn_since(self._generators), *(() if self.shared is None else self.shared.drawn)}

    def columns(self) -> dict[str, Any]:
        """What the run itself knows: what it cost, and what its parts say of themselves."""
        wall_s = time.perf_counter() - self.began_s
        columns: dict[str, Any] = {"wall_ms": 1e3 * wall_s, "peak_memory_mb": peak_memory_mb()}
        if self.looks_for_draws and (drawn := self.drawn()):
            columns["global_random"] = " and ".join(sorted(drawn))
        if self.log is not None:
            columns |= {"views": sum(self.log.counts.values()), "real_time_factor": self.log.robot_s / wall_s}
        parts = self._built[0] if self._built else None
        if parts is None or parts.source is None:
            return columns
        if not self.config.driving or (self.log is not None and not self.log.in_world):
            columns["world"] = parts.source.facts.name  # of the recording, or of a simulator with a world of its own
        if not self.config.driving:
            columns["stamps_repaired"] = parts.source.stamps_repaired
        columns |= {"renderer": parts.source.renderer, "lost": parts.source.lost}
        if parts.source.views_lost:
            columns["views_lost"] = parts.source.views_lost
        if "odometry" in self.config.parts:
            metric = sorted({"depth", "wheel"} & self.config.odometry.settings.needs)
            columns["scale_from"] = parts.odometry.scale_from or " + ".join(metric)
        return columns
