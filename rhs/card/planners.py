"""Planners against exact search on questions made by chance: which of their answers are wrong, and of what kind.

Nothing is asked of a planner but `plan`; it gets copies that it may write to, and is seen doing it. A path is judged by
rhs.metrics.path_judge, which shares nothing with any planner, and so is the exact answer it stands beside.
"""

from __future__ import annotations

import copy
import dataclasses
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path as FilePath
from time import process_time
from typing import Any

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import camera_from_fov
from rhs.api.records import FeatureSettings, Path, PlanningProblem, PlanReason, WorldFacts
from rhs.api.segments import with_exact_ends
from rhs.metrics.path_judge import path_valid, polyline_length, shortest_length_m
from rhs.metrics.planning import above_optimum_pct
from rhs.testing.checks import in_words
from rhs.testing.planners import UNREACHABLE
from rhs.testing.shared_state import untouched

from .forked import ForkResult
from .questions import Question, questions

NAN = float("nan")
FAULTS = {
    "raises": "raises an exception instead of answering",
    "no_answer": "does not answer in time",
    "no_path": "returns something that is no Path, or one that contradicts itself",
    "not_finite": "returns points that are not finite numbers",
    "wrong_start": "does not begin exactly at the start",
    "wrong_goal": "does not end exactly at the goal",
    "leaves_the_map": "leaves the map",
    "between_corners": "passes between two blocked cells that meet corner to corner",
    "cuts_corners": "cuts the corners of obstacles",
    "off_by_one": "is a cell off: its paths are free in the map moved by one, or blocked in the outermost row or column",
    "through_walls": "goes through walls",
    "denies_a_way": "says that there is no way (disconnected, or a blocked end) where there is one",
    "wrong_reason": "gives a wrong reason for a start or goal that is blocked or outside",
    "takes_nan": "takes a start or goal that is no number for a place",
    "same_seed_other_path": "plans differently when it is built and asked again with the same seed",
    "remembers_another_map": "answers for a map it was asked about before",
    "writes_to_the_problem": "writes to the problem it is given",
    "global_randomness": "uses a global random generator",
}
SAMPLES_PER_CELL = 20


@dataclasses.dataclass(frozen=True)
class Answer:
    """What came of one question. faults: of FAULTS. length_m: NaN without a valid path. raised: the exception in words."""

    name: str
    faults: tuple[str, ...]
    reason: str
    optimal_m: float
    length_m: float
    above_pct: float
    cpu_ms: float
    points_m: np.ndarray
    raised: str = ""

    @property
    def solvable(self) -> bool:
        return bool(np.isfinite(self.optimal_m))


def answers(settings: Any, todo: list[Question]) -> Iterator[Answer]:
    """An answer to each question, of a new planner each, then the answers to what is asked twice or is not a question."""
    with tempfile.TemporaryDirectory() as folder:
        for number, one in enumerate(todo):
            answer, path = ask(settings, one, FilePath(folder), seed=number)
            yield answer
            if path is not None and number % 5 == 0:
                again, other = ask(settings, one, FilePath(folder), seed=number)
                same = other is not None and np.array_equal(path.points_m, other.points_m)
                yield dataclasses.replace(again, name=f"{one.name} again", faults=() if same else ("same_seed_other_path",))
        yield from strange_answers(settings, todo[0].problem, FilePath(folder))
        yield from second_answers(settings, todo, FilePath(folder))


def ask(settings: Any, question: Question, folder: FilePath, *, seed: int = 0, part: Any = None,
        ) -> tuple[Answer, Path | None]:
    """One question to a new planner, or to `part`."""
    problem, given = question.problem, copy.deepcopy(question.problem)  # whose arrays can be written to
    faults, said, raised, began = [], None, "", process_time()
    try:
        with untouched():
            part = settings.build(context_of(problem, folder, seed)) if part is None else part
            began = process_time()
            said = part.plan(given)
    except AssertionError as error:
        faults.append("global_randomness" if "global generator" in str(error) else "raises")
    except Exception as error:
        raised = in_words(error)
        faults.append("raises" if "read-only" not in str(error) else "writes_to_the_problem")
    cpu_ms = 1e3 * (process_time() - began)
    if not all(np.array_equal(getattr(given, name), getattr(problem, name), equal_nan=name != "blocked")
               for name in ("blocked", "start_m", "goal_m")):
        faults.append("writes_to_the_problem")
    path = said if isinstance(said, Path) and isinstance(said.reason, PlanReason) else None
    if said is not None or not faults:
        faults += ["no_path"] if path is None else faults_of(path, question)
    points = np.empty((0, 2)) if path is None or not path.found or faults else np.asarray(path.points_m, float)
    above = above_optimum_pct(points, question.optimal_m, problem.resolution_m) if len(points) else NAN
    shown = np.empty((0, 2)) if path is None else points_of(path)
    return Answer(question.name, tuple(faults), "" if path is None else str(path.reason), question.optimal_m,
                  polyline_length(points) if len(points) else NAN, above, cpu_ms, shown, raised), path


def points_of(path: Path) -> np.ndarray:
    """(N, 2) its points as they are, or none where they are no points."""
    try:
        points = np.array(path.points_m, float)
    except (TypeError, ValueError):
        return np.empty((0, 2))
    return points if points.ndim == 2 and points.shape[1] == 2 else np.empty((0, 2))


def faults_of(path: Path, question: Question) -> list[str]:
    """What is wrong with an answer; nothing where it is right. A budget that was spent is no fault."""
    problem = question.problem
    points = with_exact_ends(points_of(path), problem.start_m, problem.goal_m)
    if not path.found:
        if len(points):
            return ["no_path"]
        wrong = np.isfinite(question.optimal_m) and path.reason is not PlanReason.BUDGET_SPENT
        return ["denies_a_way"] if wrong else ["wrong_reason"] if path.reason not in UNREACHABLE else []
    if not len(points):
        return ["no_path"]
    if not np.isfinite(points).all():
        return ["not_finite"]
    ends = (("wrong_start", points[0], problem.start_m), ("wrong_goal", points[-1], problem.goal_m))
    faults = [name for name, point, end in ends if not np.array_equal(point, end)]
    if not path_valid(points, problem.blocked, problem.resolution_m, problem.origin_m):
        faults.append(way_through(points, problem))
    return faults


def way_through(points: np.ndarray, problem: PlanningProblem) -> str:
    """Of what kind a path is that is not free: by how deep and how long it is in blocked cells."""
    cells = (points - np.asarray(problem.origin_m)) / problem.resolution_m
    samples = densely(cells)
    rows, columns = problem.blocked.shape
    outside = (samples < -1e-6).any(axis=1) | (samples > np.array([columns, rows]) + 1e-6).any(axis=1)
    if outside.any():
        return "leaves_the_map"
    index = np.clip(np.floor(samples).astype(int), 0, [columns - 1, rows - 1])
    part = samples - index
    deep = np.minimum(part, 1.0 - part).min(axis=1)  # how far into its cell a sample lies
    inside = problem.blocked[index[:, 1], index[:, 0]] & (deep > 1e-6)
    if not inside.any():
        return "between_corners"
    if outermost(index[inside], problem.blocked.shape):
        return "off_by_one"
    runs = np.flatnonzero(np.diff(np.concatenate([[0], inside.astype(int), [0]])))
    lengths = np.diff(runs)[::2] / SAMPLES_PER_CELL
    if lengths.max() < 1.0 and deep[inside].max() < 0.45:
        return "cuts_corners"
    return "off_by_one" if moved_by_one(points, problem) else "through_walls"


def densely(cells: np.ndarray) -> np.ndarray:
    """(M, 2) points along a polyline (N, 2), SAMPLES_PER_CELL per unit of length."""
    out = [cells[:1]]
    for a, b in zip(cells[:-1], cells[1:], strict=True):
        count = max(int(np.ceil(SAMPLES_PER_CELL * np.linalg.norm(b - a))), 1)
        out.append(a + (b - a) * np.linspace(0.0, 1.0, min(count, 100_000) + 1)[1:, None])
    return np.concatenate(out)


def moved_by_one(points: np.ndarray, problem: PlanningProblem) -> bool:
    """The path is free in the map moved by a cell along one axis, or along both: seen in a path of many cells only."""
    if polyline_length(points) < 8 * problem.resolution_m:
        return False
    shifts = [(dx, dy) for dx in (-1, 0, 1) for dy in (-1, 0, 1) if dx or dy]
    return any(path_valid(points - problem.resolution_m * np.array(shift), problem.blocked, problem.resolution_m,
                          problem.origin_m) for shift in shifts)


def outermost(inside: np.ndarray, shape: tuple[int, ...]) -> bool:
    """Every blocked cell that is entered, (N, 2) column and row, lies in one outermost row or column."""
    rows, columns = shape
    return any((inside[:, axis] == edge).all() for axis, edge in ((0, 0), (0, columns - 1), (1, 0), (1, rows - 1)))


def strange_answers(settings: Any, problem: PlanningProblem, folder: FilePath) -> Iterator[Answer]:
    """Starts and goals where nobody can be: outside, inside an obstacle, not a number."""
    rows, columns = problem.blocked.shape
    blocked = np.zeros((rows, columns), bool)
    blocked[rows // 4: 3 * rows // 4, columns // 4: 3 * columns // 4] = True
    corner = np.asarray(problem.origin_m)
    here, middle = (corner + problem.resolution_m * np.array(at) for at in ((1.4, 1.6), (columns / 2, rows / 2)))
    out = corner - 0.7 * problem.resolution_m
    nan = np.array([NAN, here[1]])
    ended = {PlanReason.OUTSIDE, PlanReason.GOAL_BLOCKED}
    cases = {"goal outside": (here, out, {PlanReason.OUTSIDE}), "start outside": (out, here, {PlanReason.OUTSIDE}),
             "goal in an obstacle": (here, middle, {PlanReason.GOAL_BLOCKED}),
             "start in an obstacle": (middle, here, {PlanReason.START_BLOCKED}),
             "goal not a number": (here, nan, ended),
             "start not a number": (nan, here, {PlanReason.OUTSIDE, PlanReason.START_BLOCKED})}
    for name, (start, goal, right) in cases.items():
        one = dataclasses.replace(problem, blocked=blocked, start_m=np.array(start), goal_m=np.array(goal))
        answer, path = ask(settings, Question(name, one, NAN), folder)
        faults = [fault for fault in answer.faults if fault != "wrong_reason"]
        if path is not None and path.reason not in right:
            faults = ["takes_nan" if "number" in name else "wrong_reason"]
        yield dataclasses.replace(answer, faults=tuple(faults))


def second_answers(settings: Any, todo: list[Question], folder: FilePath) -> Iterator[Answer]:
    """The same planner asked about one map after another of the same size and frame."""
    for number in range(0, len(todo), max(len(todo) // 6, 1)):
        first = todo[number]
        kept = np.asarray(first.problem.blocked, bool)
        other = np.rot90(kept, 2).copy()
        for end in (first.problem.start_m, first.problem.goal_m):
            column, row = np.floor((end - first.problem.origin_m) / first.problem.resolution_m).astype(int)
            other[row, column] = False
        changed = dataclasses.replace(first.problem, blocked=other)
        second = Question(f"{first.name} after another map", changed, exact_m(changed))
        try:
            part = settings.build(context_of(changed, folder, number))
            part.plan(copy.deepcopy(first.problem))
        except Exception:
            continue  # told already
        fresh, _ = ask(settings, second, folder, seed=number)
        answer, _ = ask(settings, second, folder, part=part)
        new = set(answer.faults) - set(fresh.faults)
        yield dataclasses.replace(answer, faults=("remembers_another_map",) if new else ())


def exact_m(problem: PlanningProblem) -> float:
    """Length of the exact shortest path."""
    return shortest_length_m(problem.blocked, problem.resolution_m, problem.origin_m, [problem.start_m, problem.goal_m])


def context_of(problem: PlanningProblem, folder: FilePath, seed: int) -> Context:
    """What the planner is built with."""
    rows, columns = problem.blocked.shape
    (x, y), step = problem.origin_m, problem.resolution_m
    facts = WorldFacts("card", (x, y, 0.0), (), (x, y, x + columns * step, y + rows * step), 0.0)
    return Context(np.random.default_rng(seed), camera_from_fov(640, 480, 60.0, height_m=1.2), facts, folder,
                   FeatureSettings())


COLUMNS = {
    "faulty": "answers that are wrong; which faults, below",
    "solved_share": "questions with a way, answered by a path that is free",
    "above_optimum_pct": "length above the exact shortest path, as found, mean",
    "above_optimum_p90_pct": "the same, 90th percentile",
    "plan_ms": "CPU time of a question, median, learning included",
    "plan_slowest_ms": "CPU time of the slowest",
    "memory_mb": "memory taken beyond the process it began in",
}


def prepare() -> None:
    """The questions, once for all parts."""
    asked()


@cache
def asked() -> tuple[Question, ...]:
    """The questions of every card."""
    return tuple(questions())


def work(settings: Any, *, degraded: bool = True) -> Iterator[Answer]:
    """Every answer; a planner sees nothing that could be degraded."""
    return answers(settings, list(asked()))


def plain_ones(result: ForkResult) -> list[Answer]:
    """The first answers to questions that are some."""
    names = {one.name for one in asked()}
    return [one for one in result.items if one.name in names]


def figures(result: ForkResult) -> dict[str, float]:
    """The columns, over all questions that were answered."""
    found = plain_ones(result)
    if not found:
        return {}
    above, cpu_ms = np.array([one.above_pct for one in found]), np.array([one.cpu_ms for one in found])
    known = above[np.isfinite(above)]
    return {"faulty": sum(bool(one.faults) for one in result.items),
            "solved_share": float(np.mean([np.isfinite(one.length_m) for one in found if one.solvable])),
            "above_optimum_pct": float(known.mean()) if len(known) else NAN,
            "above_optimum_p90_pct": float(np.percentile(known, 90)) if len(known) else NAN,
            "plan_ms": float(np.median(cpu_ms)), "plan_slowest_ms": float(cpu_ms.max()), "memory_mb": result.memory_mb}


def details(result: ForkResult) -> dict[str, Any]:
    """Its faults: what, how often, and the questions that show it."""
    shown = {name: [one.name + (f": {one.raised}" if one.raised else "") for one in result.items if name in one.faults]
             for name in FAULTS}
    if result.ended:
        shown["no_answer"] = [f"what follows {result.items[-1].name}" if result.items else "the first question"]
    return {"answers": len(result.items), "faults": [{"fault": name, "says": FAULTS[name], "times": len(where),
                                                     "questions": where[:5]} for name, where in shown.items() if where]}
