"""Which settings of a part matter? Each number halved and doubled, in several buildings, paired with the default.

Every numeric setting of the part (those under `advanced` too) is tried at half and at twice its value, clipped into the
range that it is checked for; zeros, which have no double, and settings that are unset are left out. Each run has the
building and the seed of a run with nothing changed. The effect is the geometric mean of new over old, with Student's
interval of its logarithm over buildings. Thirty settings are sixty questions: of those that do nothing, one in twenty has
an interval beside zero all the same.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api import settings
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.config.compose import Composer, RunConfig, to_plain
from rhs.config.overrides import Word, parse, plain_words, sweep_words, swept_keys
from rhs.metrics.shares import half_width
from rhs.reports.intervals import LEAST, units
from rhs.runfolder.row import machine_dependent, number_in
from rhs.worlds.random.names import building_of

from . import recorded
from .jobs import Job
from .kept import Row
from .sweep import job_of

FACTORS = (0.5, 2.0)
SMALL = ("source.image_width=160",)
LIGHT = ("recording=off", "pictures=off")
BUILDINGS = ("zip(world=random:loop/1,random:office/1,random:home/1,random:hall/1,random:non_manhattan/1 seed=0,1,2,3,4)",)
QUESTIONS = ("world=map1,map2,map3,map4", "seed=0,1,2")
MOST_PAIRS = 50
BUILDINGS_OWN = {"world", "seed", "source"}  # words that say nothing of a recording
REPLAY = Word("source", "replay", "source=replay")
Recorded = tuple[str, list[Word]]  # a recording's name or path, and the words that read it
# kind -> (task, column that is compared, less is better). map_agreement is compared by what it lacks of 1
# and a thousandth.
MEASURES = {"odometry": ("survey", "ate_before_closing_m"), "loop_closer": ("survey", "ate_rmse_m"),
            "slam": ("survey", "ate_rmse_m"), "sensor": ("survey", "ate_before_closing_m"),
            "degrade": ("survey", "ate_before_closing_m"), "mapper": ("survey", "map_agreement"),
            "localiser": ("patrol", "patrol_rmse_m"), "replan": ("patrol", "path_length_m"),
            "planner": ("planning", "plan_length_m")}
LACKS = ("map_agreement",)
LEAST_LACK = 1e-3  # added to what is lacking, so that a map without fault is compared like any other
MATTERS = 0.02  # an effect whose interval leaves out all up to this share is called one
CHANCE = 0.05  # of calling it `fails` where nothing is changed but luck
DOUBT = 2  # so many more runs that do not succeed are not called harmless


@dataclass(frozen=True)
class Change:
    """One setting with another value. factor: as it was asked for; the value may be clipped."""

    key: str
    before: float
    value: float
    factor: float

    @property
    def word(self) -> Word:
        return Word(self.key, self.value, f"{self.key}={self.value!r}")

    def __str__(self) -> str:
        return f"{self.key} {self.before:g} -> {self.value:g}"


@dataclass(frozen=True)
class Question:
    """part: `kind=name`. pairs: (world, job with nothing changed). changed: one list of jobs, in the order of the pairs, for
    each change. left_out: setting -> why it is not tried."""

    part: str
    measure: str
    pairs: tuple[tuple[str, Job], ...]
    changes: tuple[Change, ...]
    changed: tuple[tuple[Job, ...], ...]
    left_out: Mapping[str, str]

    @property
    def jobs(self) -> list[Job]:
        return [job for _, job in self.pairs] + [job for jobs in self.changed for job in jobs]

    @property
    def recorded(self) -> list[Job]:
        """Of the jobs with nothing changed those on a recording."""
        return [job for _, job in self.pairs if "source=replay" in job.words]


def ask(words: Sequence[str], *, only: Sequence[str] = (), recordings: Sequence[Recorded] = ()) -> Question:
    """Compose everything. words: `kind=name`, then words of a run. only: settings to try, by the beginning of their keys
    below the part. recordings: in addition. Raises ConfigError in one line."""
    kind, _, name = (words[0] if words else "").partition("=")
    if kind not in MEASURES:
        raise ConfigError(f"sensitivity: say which part, for example odometry=procrustes; kinds: {', '.join(MEASURES)}")
    registry.check_requirements(kind, name, registry.load(kind, name))
    task, measure = MEASURES[kind]
    if recordings and not measure.startswith("ate_"):
        raise ConfigError(f"sensitivity --recording, --data: a {kind} is compared by {measure}, which no recording tells; "
                          f"leave it out")
    composer = Composer(())
    runs = list(_runs(task, list(words), recordings))
    first = composer.config(runs[0][1])
    changes, left_out = changes_of(kind, first, only)
    pairs = tuple((world, _job(composer, typed)) for world, typed in runs)
    changed = tuple(tuple(_job(composer, typed, change.word) for _, typed in runs) for change in changes)
    return Question(f"{kind}={name}", measure, pairs, tuple(changes), changed, left_out)


def _runs(task: str, words: list[str], recordings: Sequence[Recorded]) -> Iterator[tuple[str, list[Word]]]:
    """(world, words) of each pair."""
    given = {key for word in parse(words) for key in _keys(word)}
    where: tuple[str, ...] = BUILDINGS if task != "planning" else QUESTIONS
    if "world" in given:
        where = () if "seed" in given else ("seed=0,1,2,3,4",)
    small = SMALL if task != "planning" and not {"source", "source.image_width"} & given else ()
    typed = parse([f"task={task}", *LIGHT, *small, *words, *where])
    if stray := [key for key in swept_keys(typed) if key not in ("world", "seed")]:
        raise ConfigError(f"sensitivity: {stray[0]} takes one value; only world and seed may take several")
    for combination in sweep_words(typed, most=MOST_PAIRS):
        yield next((str(word.value) for word in combination if word.key == "world"), ""), combination
    own = [word for word in parse(words) if not {key.partition(".")[0] for key in _keys(word)} & BUILDINGS_OWN]
    for name, read in recordings:
        yield name, [*plain_words(parse([f"task={task}", *LIGHT])), *plain_words(own), REPLAY, *read]


def recording(typed: str) -> Recorded:
    """A recording as it is typed: `PATH key=value ...`. Raises ConfigError."""
    try:
        path, *rest = shlex.split(typed)
    except ValueError as error:
        raise ConfigError(f"sensitivity --recording '{typed}': {error}; type \"PATH key=value ...\"") from error
    return path, [Word("source.path", path, f"source.path={path}"), *plain_words(parse(rest))]


def frozen(data: Path, words: Sequence[str]) -> list[Recorded]:
    """The recordings of recordings-v1 with colour, depth and true poses, in this folder. Raises ConfigError."""
    names = recorded.asked_of(" ".join(words))
    if any(recorded.BY_NAME[name].sensor != "rgbd" for name in names):
        raise ConfigError("sensitivity --data: the laser logs of recordings-v1 have no true poses; leave it out")
    recorded.check_data(data, names)
    return [(name, recorded.BY_NAME[name].read_from(data)) for name in names]


def _keys(word: Any) -> list[str]:
    """What a word of a sweep gives values to."""
    return [str(column.key_or_group) for column in getattr(word, "columns", [word])]


def _job(composer: Composer, words: Sequence[Word], *more: Word) -> Job:
    typed = [*words, *more]
    return job_of(composer.config(typed), typed, ["world", "seed", "source.path", *(word.key for word in more)])


# --- the values to try ----------------------------------------------------------------------------------------------

def changes_of(kind: str, config: RunConfig, only: Sequence[str] = ()) -> tuple[list[Change], dict[str, str]]:
    """Half and double of every numeric setting of the part of this kind; setting -> why it is left out."""
    now = getattr(config, kind).settings
    values = to_plain(config)[kind]
    values = {key: value for key, value in values.items() if key != "name"}
    changes: list[Change] = []
    left_out: dict[str, str] = {}
    met: set[str] = set()
    for path, before in numbers(values):
        key = ".".join((kind, *path))
        if only and not any(".".join(path).startswith(one) for one in only):
            continue
        met |= {one for one in only if ".".join(path).startswith(one)}
        if before == 0:
            left_out[key] = "is 0, which has no double"
            continue
        for factor in FACTORS:
            value, why = _valid(type(now), values, path, before * factor, kind, whole=isinstance(before, int))
            if why or value == before:
                left_out[key] = why or "is at the end of its range, or too small a whole number"
            else:
                changes.append(Change(key, before, value, factor))
    tried = {change.key for change in changes}
    missed = [one for one in only if one not in met]
    if not (missed or changes) and left_out:
        key, why = next(iter(left_out.items()))
        raise ConfigError(f"sensitivity: nothing to try: {key} {why}")
    if missed or not changes:
        raise ConfigError(f"sensitivity: {kind}={getattr(config, kind).name} has no such numeric setting"
                          + (f" as {', '.join(missed or only)}" if only else ""))
    return changes, {key: why for key, why in left_out.items() if key not in tried}


def numbers(values: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float | int]]:
    """(keys, value) of every number in nested settings."""
    for key, value in values.items():
        if isinstance(value, Mapping):
            yield from numbers(value, (*above, key))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            yield (*above, key), value


def _valid(cls: type, values: Mapping[str, Any], path: tuple[str, ...], target: float, kind: str, *, whole: bool,
           ) -> tuple[float, str]:
    """The target, rounded as its type is, or the end of the allowed range next to it; and why it cannot be tried, if so."""
    value = round(target) if whole else float(f"{target:.4g}")
    for _ in range(2):
        try:
            settings.make(cls, _with(values, path, value), kind)
            return value, ""
        except ConfigError as error:
            said = re.search(re.escape(path[-1]) + r"=.* outside the allowed range \[([^,]+), ([^\]]+)\]", str(error))
            if said is None:
                return value, str(error)
            value = min(max(value, float(said[1])), float(said[2]))
            value = round(value) if whole else value
    return value, f"cannot be {target:g}"


def _with(values: Mapping[str, Any], path: Sequence[str], value: float) -> dict[str, Any]:
    """The settings with one of them changed."""
    head, *rest = path
    return {**values, head: _with(values[head], rest, value) if rest else value}


# --- effects --------------------------------------------------------------------------------------------------------

@dataclass(frozen=True)
class Effect:
    """change: of the measure, as a share, geometric mean over buildings; low, high: its 95 % interval. runs: all; pairs:
    those in which both are known. lost, won: successes. fails: so many are lost that chance hardly does it (Boschloo 1970,
    one-sided; the sets of runs count as independent, which is on the safe side). same: every row is the default's."""

    of: Change
    change: float
    low: float
    high: float
    runs: int
    pairs: int
    lost: int
    won: int
    fails: bool
    same: bool

    @property
    def says(self) -> str:
        """One word or two."""
        if self.same:
            return "changes nothing"
        if self.fails:
            return "fails"
        if self.low > MATTERS:
            return "worse"
        if self.lost - self.won >= DOUBT:
            return "not sure"
        if self.high < -MATTERS:
            return "better"
        return "no effect" if -MATTERS <= self.low and self.high <= MATTERS else "not sure"


def check_recorded(rows: Sequence[Row]) -> None:
    """Raises ConfigError where a recording is refused: it would count for nothing. rows: of `Question.recorded`."""
    for row in rows:
        if row["status"] == "refused":
            raise ConfigError(f"sensitivity --recording 'PATH source.KEY=VALUE': {row.get('reason')}")


def effects(asked: Question, rows: Sequence[Row]) -> list[Effect]:
    """The effect of each change, largest first. rows: of `asked.jobs`."""
    count = len(asked.pairs)
    before, where = rows[:count], [building_of(world, job.config.seed) for world, job in asked.pairs]
    found = [_effect(change, asked.measure, where, before, rows[(k + 1) * count:(k + 2) * count])
             for k, change in enumerate(asked.changes)]
    return sorted(found, key=lambda one: (-(one.lost + one.won), -abs(math.log1p(one.change)) if one.pairs else 0.0,
                                          one.of.key, one.of.factor))


def _effect(change: Change, measure: str, where: Sequence[str], before: Sequence[Row], after: Sequence[Row]) -> Effect:
    old, new = (np.array([_value(row, measure) for row in rows]) for rows in (before, after))
    known = (old > 0.0) & (new > 0.0)
    several = len(set(where)) > 1  # in one building runs with other seeds are what there is to compare
    logs = units(np.log(new[known] / old[known]), np.array(where)[known] if several else None)
    mean, half = float(logs.mean()) if len(logs) else math.nan, half_width(logs) if len(logs) >= LEAST else math.nan
    done_before, done_after = ([row.get("success") == 1.0 for row in rows] for rows in (before, after))
    won = [a - b for a, b in zip(done_after, done_before, strict=True)]
    fails = _fails(sum(done_before), sum(done_after), len(before))
    same = any(row["status"] == "ok" for row in before) and all(alike(a, b) for a, b in zip(after, before, strict=True))
    middle, low, high = (math.expm1(value) for value in (mean, mean - half, mean + half))
    return Effect(change, middle, low, high, len(before), int(known.sum()), won.count(-1), won.count(1), fails, same)


def _fails(before: int, after: int, runs: int) -> bool:
    """Whether fewer runs succeed than chance has it."""
    from scipy.stats import boschloo_exact

    table = [[before, after], [runs - before, runs - after]]
    return after < before and bool(boschloo_exact(table, alternative="greater").pvalue < CHANCE)


def _value(row: Row, measure: str) -> float:
    """NaN of a run that broke off: its figures are of a shorter way."""
    if row["status"] != "ok":
        return math.nan
    return 1.0 + LEAST_LACK - number_in(row, measure) if measure in LACKS else number_in(row, measure)


def alike(a: Row, b: Row) -> bool:
    """Whether two rows say the same, the machine and the hash of the settings left out."""
    def comparable(row: Row) -> dict[str, Any]:
        return {key: None if isinstance(v, float) and math.isnan(v) else v for key, v in row.items()
                if key != "config_hash" and not machine_dependent(key)}

    return comparable(a) == comparable(b)


def in_words(found: Sequence[Effect], asked: Question) -> list[str]:
    """What matters, what changes nothing at all, and what was left out."""
    settings_ = list(dict.fromkeys(one.of.key for one in found))
    matter = [one for one in found if one.says in ("fails", "worse", "better")]
    keys = list(dict.fromkeys(one.of.key for one in matter))
    inert = [key for key in settings_ if all(one.same for one in found if one.of.key == key)]
    lines = [f"{len(keys)} of {len(settings_)} settings of {asked.part} matter here"
             + (": " + "; ".join(_in_one_line(one) for one in matter[:8]) if matter else "")]
    doubtful = [one for one in found if one.says == "not sure" and one.lost - one.won >= DOUBT]
    if doubtful:
        lines.append("it may be chance, give more by world= and seed=: " + "; ".join(map(_in_one_line, doubtful[:8])))
    if inert:
        lines.append(f"halved or doubled, these change nothing: {', '.join(inert)}")
    lines += [f"{key} was not tried: {why}" for key, why in asked.left_out.items()]
    return lines


def _in_one_line(one: Effect) -> str:
    count = f", {one.lost - one.won:+d} of {one.runs} runs fail" if one.lost != one.won else ""
    change = f"{100 * one.change:+.3g} %" if one.pairs else "no pair known"
    return f"{one.of} {one.says} ({change}{count})"
