"""planning-v1: a frozen set of planning questions, their scores, and the page of a table that anyone makes again.

Frozen: the questions (FROZEN is their hash; a change is another version), seeds 0 to 2 for each, the scoring. Rows hold no
time, so that they are the same bytes wherever they are made; times stand in a table of their own.
"""

from __future__ import annotations

import csv
import hashlib
import io
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.estimation.paths.shorten import shortened
from rhs.metrics.path_judge import polyline_length
from rhs.metrics.planning import above_optimum_pct
from rhs.worlds.plan_files import question_of
from rhs.worlds.planning_question import load_arena

from .forked import ForkResult
from .planners import ask, exact_m
from .questions import Question, questions

NAME = "planning-v1"
FROZEN = "b9f280d900b4e53c"  # of the questions: sha256, 16 digits
SEEDS = (0, 1, 2)
MAPS = ("map1", "map2", "map3", "map4")  # of worlds/maps, from their start to their goal
SMALL, LARGE, SEED = 6, 2, 10_000
FINER = 4  # of the large ones: each cell becomes so many along both sides
MOST_PCT = 100.0  # a path longer by more is worth no more than none (PAR-2)
PLANNERS = ("astar", "bit_star", "fast_marching", "fmt", "informed_rrt_star", "potential_field", "prm", "prm_star", "rrt",
            "rrt_connect", "rrt_star", "theta_star")
PATIENCE_S = 120.0
ROW = ("planner", "question", "seed", "solvable", "solved", "reason", "fault", "optimal_m", "length_m", "length_short_m",
       "above_pct", "above_short_pct")
SCORES = {
    "solved_share": "questions with a way, answered by a path that the judge holds free",
    "wrong_share": "answers that are wrong, of all: paths that are not free, a way denied, ...",
    "above_par2_pct": "length above the exact shortest path, as found, mean; no path, or one longer by more than "
                      f"{MOST_PCT:g} %, counts {2 * MOST_PCT:g}",
    "above_pct": "the same, of the paths found alone",
    "above_short_pct": "of these, when every planner's path is pulled tight alike",
}


@dataclass(frozen=True)
class Row:
    """One answer. cells: by ROW. plan_ms: CPU time, no part of the row."""

    cells: tuple[str, ...]
    plan_ms: float

    def __getitem__(self, name: str) -> str:
        return self.cells[ROW.index(name)]


@cache
def frozen_questions() -> tuple[Question, ...]:
    """The questions: small ones of every kind, some of them four times as fine, the maps of worlds/maps."""
    small = [replace(one, name=f"small {one.name}") for one in questions(SMALL, SEED)]
    large = [finer(one) for one in questions(LARGE, SEED + 1)]
    return (*small, *large, *map(of_map, MAPS))


def finer(question: Question) -> Question:
    """The same place in finer cells: the way is as long."""
    problem = question.problem
    blocked = np.kron(problem.blocked, np.ones((FINER, FINER), bool))
    return Question(f"large {question.name}", replace(problem, blocked=blocked, resolution_m=problem.resolution_m / FINER),
                    question.optimal_m)


def of_map(name: str) -> Question:
    """The question of a map of worlds/maps."""
    problem = question_of(load_arena(name)).problem()
    return Question(name, problem, exact_m(problem))


def digest(asked: Sequence[Question]) -> str:
    """16 hex digits of everything in these questions."""
    sha = hashlib.sha256()
    for one in asked:
        problem = one.problem
        sha.update(f"{one.name} {problem.blocked.shape} {problem.resolution_m!r} {problem.origin_m!r}".encode())
        sha.update(np.packbits(problem.blocked).tobytes())
        sha.update(np.round([problem.start_m, problem.goal_m], 9).tobytes())
    return sha.hexdigest()[:16]


def work(name: str, settings: Any, asked: Sequence[Question]) -> Iterator[Row]:
    """Every question with every seed, each of a new planner; one before them all, so that no time is loading."""
    with tempfile.TemporaryDirectory() as folder:
        ask(settings, asked[0], Path(folder))
        for question in asked:
            for seed in SEEDS:
                yield row_of(name, question, seed, ask(settings, question, Path(folder), seed=seed))


def row_of(name: str, question: Question, seed: int, answered: tuple[Any, Any]) -> Row:
    """An answer as it stands in the table; figures in 9 digits, nothing where there is none."""
    answer, path = answered
    step = question.problem.resolution_m
    solved = bool(np.isfinite(answer.length_m))
    tight = shortened(path, question.problem).points_m if solved else np.empty((0, 2))
    short_m = polyline_length(tight) if solved else float("nan")
    figures = (answer.optimal_m, answer.length_m, short_m, answer.above_pct,
               above_optimum_pct(tight, answer.optimal_m, step) if solved else float("nan"))
    return Row((name, question.name, str(seed), str(int(answer.solvable)), str(int(solved)), answer.reason,
                "+".join(answer.faults), *("" if value != value else f"{value:.9g}" for value in figures)), answer.cpu_ms)


def csv_of(rows: Sequence[Row]) -> str:
    """The rows, without a time."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([ROW, *(row.cells for row in rows)])
    return text.getvalue()


def hash_of(rows: Sequence[Row]) -> str:
    """16 hex digits of a planner's rows."""
    return hashlib.sha256(csv_of(rows).encode()).hexdigest()[:16]


def scores(result: ForkResult, count: int) -> dict[str, float]:
    """The scores and times of one planner; count: answers that were asked for. What was not answered is not solved."""
    rows = result.items
    way = [row for row in rows if row["solvable"] == "1"]
    asked_m = [one.optimal_m for one in frozen_questions()]
    missing = len(SEEDS) * int(np.isfinite(asked_m).sum()) - len(way) if count > len(rows) else 0
    above = [float(row["above_pct"]) if row["solved"] == "1" else np.inf for row in way] + [np.inf] * missing
    worth = [value if value <= MOST_PCT else 2 * MOST_PCT for value in above]
    found = [row for row in way if row["solved"] == "1"]
    plan_ms = [row.plan_ms for row in rows]
    return {"solved_share": len(found) / len(above), "wrong_share": sum(bool(row["fault"]) for row in rows) / len(rows),
            "above_par2_pct": float(np.mean(worth)), "above_pct": _mean(found, "above_pct"),
            "above_short_pct": _mean(found, "above_short_pct"), "plan_ms": float(np.median(plan_ms)),
            "plan_p95_ms": float(np.percentile(plan_ms, 95)), "memory_mb": result.memory_mb}


def _mean(rows: Sequence[Row], name: str) -> float:
    return float(np.mean([float(row[name]) for row in rows])) if rows else float("nan")


def page(found: Mapping[str, ForkResult], count: int, *, command: str, made_at: str) -> str:
    """planning-v1.md: best first."""
    scored = {name: scores(result, count) for name, result in found.items() if result.items}
    order = sorted(scored, key=lambda name: (scored[name]["above_par2_pct"], name))
    lines = [f"# {NAME}", "", f"`{command}` at commit {made_at}: {count // len(SEEDS)} questions ({FROZEN}), seeds "
             f"{', '.join(map(str, SEEDS))}, each of a new planner. `rows`: hash of the planner's rows in {NAME}.csv; the "
             "same everywhere, or something differs.", "",
             f"| planner | {' | '.join(SCORES)} | rows |", f"|---|{'---|' * len(SCORES)}---|"]
    lines += [f"| {name} | {' | '.join(f'{scored[name][one]:.4g}' for one in SCORES)} | {hash_of(found[name].items)} |"
              for name in order]
    lines += ["", *(f"- `{name}`: {meaning}" for name, meaning in SCORES.items())]
    lines += [f"- {name} did not come to its end: {result.ended}" for name, result in found.items() if result.ended]
    lines += ["", "## Times", "", "Of the machine it was made on: compare within this table. CPU time of a question, "
              "learning included.", "", "| planner | median ms | 95 % ms | memory MB |", "|---|---|---|---|"]
    lines += [f"| {name} | {one['plan_ms']:.3g} | {one['plan_p95_ms']:.3g} | {one['memory_mb']:.0f} |"
              for name, one in sorted(scored.items(), key=lambda item: item[1]["plan_ms"])]
    return "\n".join(lines) + "\n"
