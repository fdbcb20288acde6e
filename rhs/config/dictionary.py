"""The data dictionary: every column of a row and of steps.csv, every event and status, in words.

Metrics say it themselves (rhs.api.metric); here stand the columns that are no metric, and the enumerations.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

from rhs.api import contracts, records
from rhs.api.contracts import PLUGIN_KINDS
from rhs.api.metric import Metric

from . import registry
from .documented import own_docs


@dataclass(frozen=True)
class Column:
    """One column in words: name, unit as people write it, meaning, where it comes from, and of what kind it is: `word`,
    `count` (a whole number), `number`, or empty where that is not known. more_is_better: a loss where it falls."""

    name: str
    unit: str
    meaning: str
    source: str
    kind: str = ""
    more_is_better: bool = False


def _rows(source: str, *columns: tuple[str, str, str], words: tuple[str, ...] = (), counts: tuple[str, ...] = (),
          more_is_better: tuple[str, ...] = ()) -> tuple[Column, ...]:
    return tuple(Column(name, unit, meaning, source, "word" if name in words else "count" if name in counts else "number",
                        name in more_is_better) for name, unit, meaning in columns)


RUN = _rows(
    "the run",
    ("status", "", "how the run ended: see statuses"),
    ("reason", "", "why it did not end well, in one line"),
    ("success", "", "1: the run did what was asked of it (a patrol: every place that can be reached), 0: it did not; "
     "unknown where nothing was asked"),
    ("failure", "", "why not, in words"),
    ("task", "", "what was done: patrol, survey, localise, planning, places, unroll, or a plugin's"),
    ("world", "", "the world, map or recording; random:FAMILY: the building of that family whose number is the seed"),
    *((kind, "", f"the {kind} plugin") for kind in PLUGIN_KINDS if kind not in ("task", "metric", "engine", "degrade")),
    ("degrade", "", "what spoiled the captures between source and sensor, joined by +; not there: nothing"),
    ("presets", "", "parts taken under a second name (conf/), as kind=word, which is the plugin with other settings"),
    ("seed", "", "seed of every random number"),
    ("config_hash", "", "10 hex digits of task, kinds it needs, their settings, world and seed"),
    ("plugins", "", "plugins that are not rhs's own: their files or packages, and a hash of their code"),
    ("global_random", "", "whose global generator somebody's plugin used, which no seed holds; not there: none"),
    ("commit", "", "git commit of the checkout, + with changes"),
    ("versions", "", "versions of Python and of the libraries that can change a number; vectors: the processor's"),
    ("renderer", "", "what drew the views of a simulated run"),
    ("scale_from", "", "what fixes the scale of the odometry: depth, wheel, or a plugin's own words"),
    ("lost", "", "what was lost of a damaged recording"),
    ("stamps_repaired", "", "stamps of a recording that stepped back and were put right; its own order was kept"),
    ("views", "", "views taken in all"),
    ("views_lost", "", "views that never arrived: of a recording unreadable, or kept back by degrade; not there: none"),
    ("row_failures", "", "columns that a row cannot have, and why"),
    ("metric_failures", "", "metrics that failed, and how"),
    ("picture_failures", "", "pictures that could not be drawn, and why"),
    ("wall_ms", "ms", "time of the whole run on this machine"),
    ("real_time_factor", "", "time the robot lived through per time the program took"),
    ("peak_memory_mb", "MB", "most memory the process held"),
    words=("status", "reason", "failure", "task", "world", *PLUGIN_KINDS, "presets", "config_hash", "plugins",
           "global_random", "commit", "versions", "renderer", "scale_from", "lost", "row_failures", "metric_failures",
           "picture_failures"),
    counts=("seed", "stamps_repaired", "views_lost"), more_is_better=("success", "real_time_factor"),
)
BEFORE = [column.name for column in RUN].index("commit")  # so many stand before the metrics of a row, the others after
TASKS = _rows(
    "rhs_tasks",
    ("plan_learn_ms", "ms", "task=planning: of that, what the same question took less the second time: learning"),
    ("plan_ms", "ms", "task=planning: CPU time of the first question, learning included"),
    ("plan_again_ms", "ms", "task=planning: CPU time of the same question again"),
    ("plan_wall_ms", "ms", "task=planning: wall-clock time of the first question"),
    ("plan_claimed_ms", "ms", "task=planning: what the planner says it took"),
    ("plan_again_wall_ms", "ms", "task=planning: wall-clock time of the second question"),
    ("plan_again_claimed_ms", "ms", "task=planning: what the planner says the second took"),
    ("plan_learn_wall_ms", "ms", "task=planning: learning, by the wall clock"),
    ("plan_learn_claimed_ms", "ms", "task=planning: what the planner says learning took"),
    ("plan_start_moved_m", "m", "task=planning: how far the planner set off from a blocked start; any plan_* is its detail"),
    ("places_stored", "", "task=places: views stored"),
    ("queries", "", "task=places: query views beside the route"),
    *((f"loc{name}_{outcome}", "share", f"task=places: answers of {words}: share {outcome}")
      for name, words in (("", "the plain vote, off the route"), ("_check", "vlad and geometric check, off the route"),
                          ("_same_lap", "the plain vote, on the same lap"),
                          ("_same_lap_check", "vlad and geometric check, on the same lap"),
                          ("_sequence", "the localiser after a sequence of views"))
      for outcome in ("correct", "near", "wrong", "abstained")),
    ("strips", "", "task=unroll: views unrolled"),
    ("strips_registered_share", "share", "task=unroll: views whose strip agreed with the mosaic so far"),
    ("strip_agreement", "", "task=unroll: correlation of a strip with the mosaic under it, median"),
    ("strip_agreement_least", "", "task=unroll: the same, least"),
    ("along_m", "m", "task=unroll: believed way along the tube at the last view"),
    ("bend_deg", "degrees", "task=unroll: how far the tube has turned to the left by then"),
    ("mosaic_length_m", "m", "task=unroll: length of the mosaic"),
    ("mosaic_known_share", "share", "task=unroll: pixels of the mosaic that were seen"),
    ("mosaic_correlation", "", "task=unroll: correlation with the true texture"),
    ("along_error_pct", "%", "task=unroll: error of the way along, share of the true one"),
    ("bend_error_deg", "degrees", "task=unroll: largest error of the tube's direction"),
    ("unroll_ms", "ms", "task=unroll: CPU time per view, median"),
    more_is_better=("strips_registered_share", "strip_agreement", "strip_agreement_least", "mosaic_known_share",
                    "mosaic_correlation", "loc_correct", "loc_check_correct", "loc_same_lap_correct",
                    "loc_same_lap_check_correct", "loc_sequence_correct"),
)
STEPS = _rows(
    "steps.csv",
    ("index", "", "number of the view, survey and patrol counted on"),
    ("phase", "", "survey or patrol; localise in task=localise"),
    ("stamp_s", "s", "time of the view"),
    ("mission", "", "number of the mission, 0 in the survey"),
    ("event", "", "what happened, joined by +: see events"),
    ("motion_status", "", "how far the motion can be trusted: see motion statuses"),
    ("motion_reason", "", "why it is not ok, in the odometry's words"),
    ("motion_replaced", "", "1: the gate put the wheels' motion in the place of the odometry's"),
    ("belief_status", "", "whether the belief is a place or a hope: see belief statuses"),
    ("belief_probability", "", "stated chance that the belief is right (0.25 m, 5 degrees)"),
    ("x_m", "m", "believed position in the map"), ("y_m", "m", "believed position in the map"),
    ("yaw_rad", "rad", "believed heading in the map, left positive"),
    ("sigma_x_m", "m", "its standard deviation along x of the map"),
    ("sigma_y_m", "m", "its standard deviation along y of the map"),
    ("sigma_yaw_rad", "rad", "its standard deviation in heading"),
    ("true_x_m", "m", "true position; unknown in most recordings"), ("true_y_m", "m", "true position"),
    ("true_yaw_rad", "rad", "true heading"),
    ("clearance_m", "m", "least true distance to anything since the last view; below 0: touched"),
    ("collided", "", "1: the robot touched something since the last view"),
    ("forward_mps", "m/s", "command that led to this view: forward"),
    ("turn_radps", "rad/s", "command that led to this view: turn to the left"),
    ("duration_s", "s", "command that led to this view: for how long"),
    ("motion_*", "", "details the odometry tells (inliers, matches, ...)"),
    ("belief_*", "", "details the localiser tells"),
    ("*_ms", "ms", "wall-clock time of a stage: capture, sense, odometry, localise, map, plan; with ahead=on, capture and "
     "sense of a survey are those of a thread beside the others: stages then add up to more than the run took"),
)
STATUSES = {
    "ok": "the run went to its end (what it achieved is `success`)",
    "running": "under way, or its process has vanished without a word",
    "failed": "something raised an error; `reason` says what",
    "refused": "not usable, said before anything ran",
    "interrupted": "ended by Ctrl-C or a signal; what was finished is kept",
    "timeout": "it took longer than --timeout",
    "killed": "the process was killed, or took more memory than --memory-mb",
}
ENUMERATIONS: dict[str, type[StrEnum]] = {
    "Events (steps.csv, event)": records.Event,
    "Mission statuses (missions.json)": records.MissionStatus,
    "Motion statuses (steps.csv, motion_status)": records.Tracking,
    "Belief statuses (steps.csv, belief_status)": records.BeliefStatus,
    "Plan reasons (plan_reason, plans.json)": records.PlanReason,
    "Answers to a blocked way (rhs.replan)": contracts.Blocked,
}


# ours, in the order of a table
GROUPS = ("cause", "blame", "patrol", "moving", "localise", "calibration", "survey", "explore", "map", "laser", "recording",
          "planning", "stages")


def metrics_by_group(task: str = "") -> dict[str, list[Metric]]:
    """Group -> its metrics of a task's rows (empty: of any), ours first and then everybody's. Those of a plugin that cannot
    be imported are left out; `metric_failures` says so."""
    groups = sorted(registry.names("metric"), key=lambda name: (GROUPS.index(name) if name in GROUPS else len(GROUPS), name))
    return {group: [metric for metric in registry.load("metric", group)  # type: ignore[attr-defined]
                    if not task or not metric.tasks or task in metric.tasks]
            for group in groups if registry.failure("metric", group) is None}


def metrics(task: str = "") -> list[Metric]:
    """The same in one list."""
    return [metric for group in metrics_by_group(task).values() for metric in group]


def columns() -> dict[str, Column]:
    """Every column a row can have, by name, in the order of a table."""
    return _columns(tuple(registry.names("metric")), len(registry.changes))[0]


def added(names: Iterable[str]) -> list[str]:
    """Of the columns of a row, those that a plugin of somebody else put there: its metrics, and what its task returned."""
    known = [group for group in GROUPS if group in registry.names("metric") and registry.failure("metric", group) is None]
    ours = {metric.name for group in known for metric in registry.load("metric", group)}  # type: ignore[attr-defined]
    ours |= {column.name for column in (*RUN, *TASKS)}
    return [name for name in names if name not in ours and not name.startswith("plan_")]  # any plan_* is a planner's detail


def rank(name: str) -> int | None:
    """Place of a column in that order; None for one that nobody described."""
    return _columns(tuple(registry.names("metric")), len(registry.changes))[1].get(name)


@cache
def _columns(groups: tuple[str, ...], changes: int) -> tuple[dict[str, Column], dict[str, int]]:
    """Columns and their places, for these groups of metrics, after so many changes of the registry: in a notebook a metric
    is registered again under its name."""
    found = [Column(m.name, m.unit, m.meaning, m.source, "word" if m.word else "count" if m.count else "number",
                    m.more_is_better) for m in metrics()]
    known = {column.name: column for column in reversed([*RUN[:BEFORE], *found, *TASKS, *RUN[BEFORE:]])}
    ordered = dict(reversed(known.items()))
    return ordered, {name: place for place, name in enumerate(ordered)}


def kind_of(name: str) -> str:
    """`word`, `count`, `number`, or empty for a column that nobody described."""
    column = columns().get(name)
    return column.kind if column is not None else ""


def members(cls: type[StrEnum]) -> dict[str, str]:
    """Value -> meaning of the members of an enumeration, from the text after each."""
    docs = own_docs(cls)
    return {member.value: docs.get(member.name, "") for member in cls}


def lines() -> Iterator[tuple[str, str, str]]:
    """(section, name, meaning) of everything, for help and documents."""
    for column in columns().values():
        yield "Columns of a row", column.name, _with_unit(column)
    for column in STEPS:
        yield "Columns of steps.csv", column.name, _with_unit(column)
    for name, meaning in STATUSES.items():
        yield "Statuses of a run", name, meaning
    for title, cls in ENUMERATIONS.items():
        for name, meaning in members(cls).items():
            yield title, name, meaning


def _with_unit(column: Column) -> str:
    meaning = f"{column.meaning}; more is better" if column.more_is_better else column.meaning
    return f"{meaning} [{column.unit}] ({column.source})" if column.unit else f"{meaning} ({column.source})"
