"""Several dials over several combinations: where does each break? Searches of rhs.sweeps.break_point, all of them at once,
round after round, so that an atlas that is stopped has something of everything.

combos.yaml:

    words: [world=square_small, source.image_width=160]     # of every run
    runs: 24                                                # of each search
    seed: 0                                                 # of the first run of each search
    combinations:
      plain: odometry=procrustes
      keyframe: odometry=keyframe localiser=particle_filter
    dials: [degrade.exposure_share=0..1, sensor.depth_noise=0.001..0.1]

What was tried stands in shards (rhs.runfolder.shards): a killed atlas asks them, and goes on with any number of processes.
"""

from __future__ import annotations

import csv
import io
import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rhs.api.settings import nearest
from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import load_yaml
from rhs.runfolder.shards import Line, read_lines, shards, words_key

from .break_point import Plan, Search, account, learn, next_job, plan
from .jobs import Job, Limits, asked_for, run_jobs
from .keep import Keeper
from .kept import MISSING, Row, any_row, same_code
from .worker import COMPILING

KEYS = {"words": list, "runs": int, "seed": int, "combinations": dict, "dials": list}
MOST_SEARCHES = 400
RUNS = 40
CELLS = ("found", "middle", "low", "high", "withstood", "runs")
SMALL = ("recording=off", "pictures=off")  # thousands of runs; their rows are what is kept

Tell = Callable[[str, str], None]  # name of a run, how it ended


@dataclass(frozen=True)
class Atlas:
    """cells: (combination, dial's word, its plan of one search), combinations slowest."""

    cells: tuple[tuple[str, str, Plan], ...]
    runs: int


def read_atlas(path: Path, runs: int = 0) -> Atlas:
    """The atlas of a file, every search composed at both ends of its dial. runs: instead of the file's. Raises ConfigError
    in one line."""
    content = load_yaml(path)
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: expected lines `dials: [...]` and `combinations: {{...}}`")
    for key, value in content.items():
        if key not in KEYS:
            raise ConfigError(f"{path}: unknown key {key}{nearest(str(key), list(KEYS))}; keys: {', '.join(KEYS)}")
        if not isinstance(value, KEYS[key]) or isinstance(value, bool):
            raise ConfigError(f"{path}: {key}: found {value!r}; expected a {KEYS[key].__name__}")
    dials, combinations = content.get("dials", []), content.get("combinations", {})
    if not dials or not combinations or len(dials) * len(combinations) > MOST_SEARCHES:
        raise ConfigError(f"{path}: {len(combinations)} combinations and {len(dials)} dials; expected at least one of each, "
                          f"and at most {MOST_SEARCHES} searches")
    runs = runs or content.get("runs", RUNS)
    if not 4 <= runs <= 10_000:
        raise ConfigError(f"{path}: runs: found {runs}; expected 4 to 10000")
    common = [*SMALL, *map(str, content.get("words", [])), f"seed={content.get('seed', 0)}"]
    cells = tuple(_cell(path, str(name), [*common, *_words(path, str(name), words)], str(dial))
                  for name, words in combinations.items() for dial in dials)
    if len({key_of(found, found.searches[0]) for _, _, found in cells}) < len(cells):
        raise ConfigError(f"{path}: two combinations, or two dials, are the same")
    return Atlas(cells, runs)


def _words(path: Path, name: str, words: object) -> list[str]:
    """A combination's, written as one line or as a list."""
    if isinstance(words, list):
        return list(map(str, words))
    try:
        if words is None or isinstance(words, str):
            return shlex.split(words or "")
    except ValueError:  # a quote that nothing ends
        pass
    raise ConfigError(f"{path}: {name}: found {words!r}; expected words: odometry=procrustes localiser=sift_db")


def _cell(path: Path, name: str, words: Sequence[str], dial: str) -> tuple[str, str, Plan]:
    try:
        found = plan([*words, dial])
    except ConfigError as error:
        raise ConfigError(f"{path}: {name}, {dial}: {error}") from error
    if len(found.searches) > 1:
        raise ConfigError(f"{path}: {name}: its words are {len(found.searches)} combinations; write each under its name")
    return name, dial, found


def run_atlas(atlas: Atlas, folder: Path, limits: Limits, *, tell: Tell) -> None:
    """Every search to its number of runs; what shards of the folder tell of counts, and is told first."""
    known = list(read_lines(shards(folder), []).values())
    searches = [(found, found.searches[0]) for _, _, found in atlas.cells]
    seeds = [_recalled(found, search, known, atlas.runs, tell) for found, search in searches]
    keeper = Keeper(folder, "failures")
    try:
        while any(seeds):
            at_once = max(1, math.ceil(limits.jobs / sum(map(bool, seeds))))
            batch = [(search, *one) for (found, search), left in zip(searches, seeds, strict=True)
                     for one in _next(found, search, left, at_once)]
            rows = _run([job for _, _, job in batch], folder, limits, tell, keeper)
            for (search, level, job), row in zip(batch, rows, strict=True):
                learn(search, level, row, str(folder / job.name))
    finally:
        keeper.close()


def key_of(found: Plan, search: Search) -> str:
    """By which the runs of a search are known again: its words and its dial."""
    dial = found.dial
    return words_key([*(word.text for word in search.words), f"dial {dial.key} {dial.low!r} {dial.high!r}"])


def _recalled(found: Plan, search: Search, known: Sequence[Line], runs: int, tell: Tell) -> list[int]:
    """Learn what was tried before; the seeds that are left."""
    left, key = list(range(found.first_seed, found.first_seed + runs)), key_of(found, search)
    _, some = next_job(found, search, 0.0, found.first_seed)
    for line in known:
        if line.set.get("atlas") == key and same_code(line.row, some) and (seed := int(line.set["atlas_seed"])) in left:
            left.remove(seed)
            learn(search, found.dial.level(float(line.set[found.dial.key])), line.row, line.run)
            tell(line.run, str(line.row["status"]))
    return left


def _next(found: Plan, search: Search, left: list[int], at_once: int) -> Iterator[tuple[float, Job]]:
    """The next runs of a search and the levels of the dial that they are at; their seeds are left no more."""
    now, left[:] = left[:at_once], left[at_once:]
    for seed, level in zip(now, search.known.next_levels(len(now)), strict=True):
        value, job = next_job(found, search, level, seed)
        varied = {**job.varied, found.dial.key: value, "atlas": key_of(found, search), "atlas_seed": seed}
        yield found.dial.level(value), replace(job, varied=varied)


def _run(jobs: Sequence[Job], folder: Path, limits: Limits, tell: Tell, keeper: Keeper) -> list[Row]:
    """One round; each row is on the disk before the next run begins."""
    rows: dict[str, Row] = {}

    def over(job: Job, status: str) -> None:
        if status not in (COMPILING, "interrupted"):
            rows[job.name] = any_row(folder / job.name)
            keeper.take_folder(job)
            keeper.tick()
        tell(job.name, status)

    run_jobs(jobs, folder, limits, tell=over, preload=asked_for(jobs))
    return [rows.get(job.name, {"status": MISSING}) for job in jobs]


def accounts(atlas: Atlas) -> list[dict[str, Any]]:
    """What is known of each search, in the order of the cells."""
    return [account(found.searches[0], found.dial) | {"combination": name, "ends": [found.dial.low, found.dial.high]}
            for name, _, found in atlas.cells if found.searches[0].known.tried]


def csv_of(results: Sequence[Mapping[str, Any]]) -> str:
    """A line for each search."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(("combination", "dial", "from", "to", *CELLS, "says"))
    for one in results:
        figures = [f"{float(value):.6g}" for value in (*one["ends"], *(one[name] for name in CELLS))]
        table.writerow([one["combination"], one["dial"], *figures, one["says"]])
    return text.getvalue()
