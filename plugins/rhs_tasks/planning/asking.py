"""Ask a planner and believe nothing it says of itself: times are taken here, points are copied, words stand aside.

A planner gets a copy of the problem; whatever it does to it, or to the files of its folder, changes nothing that is judged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter, process_time  # bound here: nobody can put another clock into the module time
from typing import Any

import numpy as np

from rhs.api.contracts import Planner
from rhs.api.errors import ContractError
from rhs.api.records import Path, PlanningProblem, PlanReason

NAN = float("nan")
POINTS_PER_CELL = 4  # a path has no use for more points; fast marching takes two
_MOST_DETAILS = 100
_LONGEST_ADVICE = 300


@dataclass(frozen=True, eq=False)
class Answer:
    """A path, checked and copied; CPU and wall time round the call that gave it; the lines of its picture (E, 2, 2)."""

    path: Path
    cpu_ms: float
    wall_ms: float
    sketch: np.ndarray | None


def ask_twice(build: Callable[[np.random.Generator], Planner], problem: PlanningProblem,
              new_rng: Callable[[], np.random.Generator], *, who: str = "planner") -> tuple[Answer, Answer]:
    """The same question with the same random numbers, to a new planner and again to the planner that now knows the map:
    the first call costs learning and planning, the second planning alone.

    What numba compiled during a call would count as planning: then both are asked of another new planner, once.
    """
    for _ in range(2):
        rng = new_rng()
        planner = build(rng)
        began = rng.bit_generator.state
        with Compiling() as compiling:
            first = ask(planner, problem, who)
            rng.bit_generator.state = began
            again = ask(planner, problem, who)
        if not compiling.happened:
            break
    return first, again


def ask(planner: Planner, problem: PlanningProblem, who: str) -> Answer:
    """One question, timed until its points are there as plain numbers."""
    wall, cpu = perf_counter(), process_time()
    answer = planner.plan(problem)
    path = checked(answer, who, most_points=POINTS_PER_CELL * (problem.blocked.size + 100))
    cpu_ms, wall_ms = 1e3 * (process_time() - cpu), 1e3 * (perf_counter() - wall)
    return Answer(path, cpu_ms, wall_ms, _lines(answer.sketch))


def times(first: Answer, again: Answer) -> dict[str, float]:
    """The columns of time, measured, beside what the planner says of itself."""
    return {
        "plan_ms": first.cpu_ms, "plan_wall_ms": first.wall_ms, "plan_claimed_ms": first.path.plan_ms,
        "plan_again_ms": again.cpu_ms, "plan_again_wall_ms": again.wall_ms, "plan_again_claimed_ms": again.path.plan_ms,
        "plan_learn_ms": max(first.cpu_ms - again.cpu_ms, 0.0), "plan_learn_claimed_ms": first.path.learn_ms,
        "plan_learn_wall_ms": max(first.wall_ms - again.wall_ms, 0.0),
    }


def checked(answer: Any, who: str, *, most_points: int) -> Path:
    """A plain copy of the path, or ContractError: a success needs points, a failure has none, numbers are finite."""
    if not isinstance(answer, Path):
        raise ContractError(f"{who}: plan() returned {type(answer).__name__}; expected a Path (rhs.api.records)")
    if not isinstance(answer.reason, PlanReason):
        raise ContractError(f"{who}: reason is {str(answer.reason)[:60]!r}; expected a PlanReason, PlanReason.OK for a path")
    points = np.asarray(answer.points_m) if len(answer.points_m) else np.empty((0, 2))
    if points.dtype.kind not in "fiu" or points.ndim != 2 or points.shape[1] != 2 or len(points) > most_points:
        raise ContractError(f"{who}: points_m has shape {points.shape} and type {points.dtype}; expected (N, 2) numbers, "
                            f"N at most {most_points}")
    points = np.array(points, float)
    if not np.isfinite(points).all():
        raise ContractError(f"{who}: points_m holds numbers that are not finite; expected metres")
    if (answer.reason is PlanReason.OK) != (len(points) > 0):
        raise ContractError(f"{who}: reason {answer.reason} with {len(points)} points")
    advice = " ".join(str(answer.advice).split())[:_LONGEST_ADVICE]
    return Path(answer.reason, points, points, _number(answer.learn_ms), _number(answer.plan_ms), None,
                _details(answer.details, who), bool(answer.keep_shape), advice)


def _details(given: Any, who: str) -> dict[str, float]:
    details = {str(key): _number(value) for key, value in dict(given).items()}
    wrong = next((key for key in details if not key.isidentifier() or len(key) > 60), None)
    if wrong is not None or len(details) > _MOST_DETAILS:
        raise ContractError(f"{who}: details has {len(details)} entries, one is named {str(wrong)[:60]!r}; "
                            f"expected at most {_MOST_DETAILS} plain words")
    return details


def _number(given: Any) -> float:
    """A number of the planner's own, NaN if it is none."""
    try:
        value = float(given)
    except (TypeError, ValueError):
        return NAN
    return value if math.isfinite(value) else NAN


def _lines(sketch: Any) -> np.ndarray | None:
    """(E, 2, 2) finite metres of a sketch, which may be a function; None where it gives something else."""
    lines = sketch() if callable(sketch) else sketch
    if lines is None:
        return None
    lines = np.array(lines, float)
    return lines if lines.ndim == 3 and lines.shape[1:] == (2, 2) and np.isfinite(lines).all() else None


class Compiling:
    """Whether numba compiled something within the block."""

    def __enter__(self) -> Compiling:
        from numba.core import event

        self._event, self._listener = event, event.RecordingListener()
        event.register("numba:compile", self._listener)
        return self

    @property
    def happened(self) -> bool:
        return bool(self._listener.buffer)

    def __exit__(self, *_: object) -> None:
        self._event.unregister("numba:compile", self._listener)
