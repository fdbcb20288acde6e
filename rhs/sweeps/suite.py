"""corridor-v1, home-v1, recordings-v1 (recorded.py): frozen buildings, questions and scores; rows that anyone makes again.

Frozen: the buildings as they are drawn, the words of every run, the columns (`Suite.frozen` is their hash; a change is
another version). Buildings were not chosen: they are the first of their families from number 10000 on, which nothing was
tuned on. Rows hold no time and no machine; those stand in a table of their own.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.floorplan import World, after
from rhs.base.errors import ConfigError, PluginError
from rhs.config.compose import Composer
from rhs.config.overrides import Word, parse, plain_words
from rhs.runfolder.row import number_in
from rhs.worlds.random.names import parse as parse_name
from rhs.worlds.random.obstacles import reached
from rhs.worlds.world import load_world

from . import recorded
from .jobs import Job
from .sweep import job_of

FIRST = 10_000  # numbers from here on are for judging
DISC_M = 0.05  # places count as reachable for a disc so much wider than the robot's radius
COMMON = ("task=patrol", "source.image_width=160", "recording=off", "pictures=off")
CELLS = ("combination", "building", "seed", "status", "success", "places", "reachable", "visited", "collisions", "ate_m",
         "wrong_sure_share", "extra_m", "arrival_m", "cause")
MEANINGS = {
    "success": "runs that visited every place, touches or not, with the 95 % interval over buildings",
    "visited": "places at which the robot truly stood, of those that a disc 5 cm wider than it can reach",
    "collisions": "separate touches of anything in the patrol, and in how many runs",
    "ate_m": "absolute trajectory error of the survey after closing: median, largest",
    "wrong_sure_share": "views of the patrol in which the belief was wrong (0.25 m, 5 degrees) and sure of itself: mean",
    "extra_m": "metres driven beyond the shortest way that learns of obstacles where they are seen: mean over the runs "
               "that reached every place",
    "arrival_m": "true distance to a place when the robot said it had arrived: median of the runs' largest, largest",
}
# What an entry may choose; all else is the question.
OPEN = ("sensor", "odometry", "loop_closer", "mapper", "planner", "localiser", "replan", "slam", "features", "stack",
        "places", "gate")
OURS = {
    "procrustes": "odometry=procrustes localiser=sift_db planner=prm",
    "procrustes+theta_star": "odometry=procrustes localiser=sift_db planner=theta_star",
    "procrustes+particles": "odometry=procrustes localiser=particle_filter planner=prm",
    "procrustes+scans": "odometry=procrustes localiser=particle_filter_scan planner=prm",
    "keyframe": "odometry=keyframe localiser=sift_db planner=prm",
    "orb": "odometry=orb localiser=sift_db planner=prm",
    "kiss_icp+scans": "odometry=kiss_icp localiser=particle_filter_scan planner=prm",
}


@dataclass(frozen=True)
class Suite:
    """buildings: (world, seed of the run), or names of recordings. frozen: 16 hex digits of `digest`. ours: name -> words.
    recorded: recordings instead of buildings."""

    name: str
    buildings: tuple[tuple[str, int], ...]
    frozen: str
    title: str
    ours: Mapping[str, str]
    recorded: bool = False

    @property
    def cells(self) -> tuple[str, ...]:
        """The columns."""
        return recorded.CELLS if self.recorded else CELLS

    def quick(self) -> tuple[tuple[str, int], ...]:
        """The first building of each family, the first recording of each sensor."""
        first: dict[str, tuple[str, int]] = {}
        for world, seed in self.buildings:
            family = recorded.BY_NAME[world].sensor if self.recorded else world.partition("/")[0]
            first.setdefault(family, (world, seed))
        return tuple(first.values())

    def asked(self, words: str) -> tuple[tuple[str, int], ...]:
        """The buildings or recordings that a combination is asked about."""
        if not self.recorded:
            return self.buildings
        names = recorded.asked_of(words)
        return tuple(one for one in self.buildings if one[0] in names)


def _first(families: Sequence[str], count: int) -> tuple[tuple[str, int], ...]:
    return tuple((f"random:{family}/{FIRST + k}", FIRST + k) for family in families for k in range(count))


SUITES = {one.name: one for one in (
    Suite("corridor-v1", (*_first(("loop", "ladder", "office"), 3), *(("square_small", FIRST + k) for k in range(3))),
          "288569015d7615ef", "corridors: three loops, three ladders, three offices, a small square with three seeds", OURS),
    Suite("home-v1", _first(("home", "hall", "non_manhattan"), 4),
          "c933b39c8ababe9d", "rooms: four homes, four halls, four buildings without right angles", OURS),
    Suite("recordings-v1", tuple((one.name, 0) for one in recorded.RECORDINGS), "453a2c300eda66df",
          "recordings: two with colour and depth, two laser logs", recorded.OURS, recorded=True))}


def digest(suite: Suite) -> str:
    """16 hex digits of everything an answer rests on: the buildings, the words, the columns."""
    if suite.recorded:
        return recorded.question_hash(suite.name)
    worlds = [[world, seed, plain_world(load_world(world, seed=seed))] for world, seed in suite.buildings]
    text = json.dumps([suite.name, worlds, COMMON, CELLS, DISC_M], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def plain_world(value: Any) -> Any:
    """A world as plain values, coordinates in micrometres, without where its file lies; what has its default is left out,
    so that a world stays what it is when worlds learn something new."""
    if is_dataclass(value):
        found = {one.name: plain_world(getattr(value, one.name)) for one in fields(value) if one.name != "path"}
        usual = {one.name: plain_world(one.default) for one in fields(value) if one.default is not MISSING}
        return {name: item for name, item in found.items() if name not in usual or item != usual[name]}
    if isinstance(value, np.ndarray | np.generic):
        return plain_world(value.tolist())
    if isinstance(value, tuple | list):
        return [plain_world(item) for item in value]
    return round(value, 6) + 0.0 if isinstance(value, float) else value


def jobs_of(words: str, buildings: Sequence[tuple[str, int]], data: Path | None = None, *, more: str = "") -> list[Job]:
    """The runs of a combination, composed. data: where recordings lie. more: words of the question's own. Raises ConfigError
    in one line for words that are none of an entry's."""
    typed = plain_words(parse(words.split()))
    stray = [word.text for word in typed if word.key.partition(".")[0] not in OPEN or word.key.startswith("sensor.")]
    if stray:
        raise ConfigError(f"bench: {stray[0]} is part of the question; an entry chooses {', '.join(OPEN)}")
    composer, jobs = Composer(()), []
    keys = [word.key for word in typed]
    for world, seed in buildings:
        if data is None:
            chosen = [*plain_words(parse([*COMMON, *more.split()])), *typed, Word("world", world, f"world={world}"),
                      Word("seed", seed, f"seed={seed}")]
        else:
            chosen = [*plain_words(parse(recorded.COMMON)), *typed, *recorded.BY_NAME[world].read_from(data)]
        jobs.append(job_of(composer.config(chosen), chosen, ["source.path" if data else "world", *keys]))
    return jobs


def usable(combinations: Mapping[str, str], suite: Suite) -> tuple[dict[str, str], dict[str, str]]:
    """(those whose parts can be used here, name -> why not of the others)."""
    good, bad = {}, {}
    for name, words in combinations.items():
        try:
            jobs_of(words, [("square_small", 0)] if not suite.recorded else suite.asked(words)[:1],
                    Path() if suite.recorded else None)
            good[name] = words
        except PluginError as error:
            bad[name] = str(error)
    return good, bad


# --- buildings that nobody could tune on: their list is promised by a hash now and shown later --------------------------

# A promise is the SHA-256 of `NAME\nSALT\nBUILDING BUILDING ...`; whoever shows the list shows the salt with it, as JSON:
# {"suite": NAME, "salt": SALT, "buildings": ["random:FAMILY/NUMBER", ...]}. Without the salt the list could be guessed.
PROMISED = {
    "corridor-v1": "aeaa74bf16432c3022d1d2ad9e4d80bad809c3ee4089ebf46eac02158e216491",
    "home-v1": "e7b5a511ea8179f0b3471b41389a50efeb5673a342a56880a5da6ae0709eb4a3",
}


def promise(name: str, salt: str, buildings: Sequence[str]) -> str:
    """The 64 hex digits that stand for this list."""
    return hashlib.sha256(f"{name}\n{salt}\n{' '.join(buildings)}".encode()).hexdigest()


def revealed(name: str, path: Path) -> tuple[tuple[str, int], ...]:
    """The buildings of a list that is shown, with the seeds of their runs. Raises ConfigError unless it is the one that was
    promised."""
    try:
        content = json.loads(path.read_text("utf-8"))
        salt, buildings = str(content["salt"]), [str(one) for one in content["buildings"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f'{path}: expected {{"suite": ..., "salt": ..., "buildings": [...]}} ({error})') from error
    if promise(name, salt, buildings) != PROMISED.get(name):
        raise ConfigError(f"{path} is not the list that was promised for {name}: sha256 {PROMISED.get(name, 'none')}")
    return tuple((world, parse_name(world).number or 0) for world in buildings)


# --- rows -----------------------------------------------------------------------------------------------------------

@cache
def _reachable(world: str, seed: int) -> tuple[int, int]:
    """(places, those that can be reached)."""
    found: World = load_world(world, seed=seed)
    return len(found.places), len(reached(after(found), radius_m=found.robot_radius_m + DISC_M))


def cells_of(name: str, building: tuple[str, int], row: Mapping[str, Any]) -> dict[str, str]:
    """A run as it stands in the table; figures in 9 digits, nothing where there is none."""
    world, seed = building
    places, reachable = _reachable(world, seed)
    visited = number_in(row, "places_visited")
    extra_m = number_in(row, "path_length_m") - number_in(row, "path_optimal_informed_m") if visited >= places else np.nan
    figures = {"success": number_in(row, "success"), "places": places, "reachable": reachable, "visited": visited,
               "collisions": number_in(row, "collisions"), "ate_m": number_in(row, "ate_rmse_m"),
               "wrong_sure_share": number_in(row, "belief_wrong_sure_share"), "extra_m": extra_m,
               "arrival_m": number_in(row, "arrival_error_max_m")}
    said = {name: "" if value != value else f"{value:.9g}" for name, value in figures.items()}
    cause = " ".join(str(row.get("cause") or row.get("reason") or "").split())
    cells = {"combination": name, "building": world, "seed": str(seed), "status": str(row["status"]), **said, "cause": cause}
    return {one: cells[one] for one in CELLS}


def csv_of(rows: Sequence[Mapping[str, str]], cells: Sequence[str] = CELLS) -> str:
    """The rows, without a time."""
    text = io.StringIO()
    table = csv.DictWriter(text, cells, lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()


def read_csv(text: str, cells: Sequence[str] = CELLS) -> list[dict[str, str]]:
    """Rows back from their text. Raises ConfigError for a table of other columns."""
    table = csv.DictReader(io.StringIO(text))
    if tuple(table.fieldnames or ()) != tuple(cells):
        raise ConfigError(f"a table of this suite has the columns {', '.join(cells)}")
    return list(table)


def hash_of(rows: Sequence[Mapping[str, str]], cells: Sequence[str] = CELLS) -> str:
    """16 hex digits of a combination's rows, whatever it is called."""
    return hashlib.sha256(csv_of([{**row, "combination": ""} for row in rows], cells).encode()).hexdigest()[:16]


def times_of(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """What is the machine's: commits, seconds and views of the runs, memory."""
    ended = [row for row in rows if number_in(row, "wall_ms") > 0.0]
    seconds = [number_in(row, "wall_ms") / 1e3 for row in ended]
    return {"commit": " ".join(sorted({str(row.get("commit") or "unknown") for row in rows})),
            "wall_s": round(float(np.median(seconds)), 2) if seconds else None,
            "views": int(sum(number_in(row, "views") for row in ended)),
            "memory_mb": round(max((number_in(row, "peak_memory_mb") for row in ended), default=0.0))}
