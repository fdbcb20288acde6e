"""What planners must do (see rhs.testing)."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.contracts import complete
from rhs.api.frozen import freeze
from rhs.api.records import Path, PlanningProblem, PlanReason
from rhs.api.validate import check_path

from .room import context
from .shared_state import untouched

RESOLUTION_M, ORIGIN_M = 0.1, (-1.0, 2.0)
ROWS, COLUMNS = 30, 40
START_M = (0.53, 0.56)  # not in the middle of a cell, nor is any goal
UNREACHABLE = (PlanReason.DISCONNECTED, PlanReason.BUDGET_SPENT)


def problem(blocked: np.ndarray, start: tuple[float, float] = START_M, goal: tuple[float, float] | None = None, *,
            resolution_m: float = RESOLUTION_M) -> PlanningProblem:
    """A problem on a grid whose corner is not the origin, with arrays that cannot be written to. start and goal are given
    for cells of RESOLUTION_M from that corner; the goal is in the corner across if not given."""
    rows, columns = blocked.shape
    end = (0.1 * columns - 0.57, 0.1 * rows - 0.54) if goal is None else goal
    scale = resolution_m / RESOLUTION_M
    points = [scale * np.array(point) + ORIGIN_M for point in (start, end)]
    return freeze(PlanningProblem(blocked.copy(), resolution_m, ORIGIN_M, *points))


def empty() -> np.ndarray:
    """(ROWS, COLUMNS) bool: nothing blocked."""
    return np.zeros((ROWS, COLUMNS), bool)


def gates() -> list[PlanningProblem]:
    """A wall across with an opening of one metre at one end, start and goal at the other: turned to all four sides."""
    wall = empty()
    wall[ROWS // 2, 10:] = True
    side = [problem(np.ascontiguousarray(np.rot90(wall, turns))) for turns in range(4)]
    width, height = 0.1 * COLUMNS, 0.1 * ROWS
    near = [((width - 0.36, 0.36), (width - 0.36, height - 0.36)), ((0.36, 0.36), (height - 0.36, 0.36)),
            ((0.36, 0.36), (0.36, height - 0.36)), ((0.36, width - 0.36), (height - 0.36, width - 0.36))]
    return [problem(task.blocked, *ends) for task, ends in zip(side, near, strict=True)] + [
        problem(wall, resolution_m=0.05)]


def walls() -> dict[str, np.ndarray]:
    """Walls without an opening: along rows, along columns, and cells that meet at their corners only."""
    row, column, diagonal = empty(), empty(), empty()
    row[ROWS // 2] = True
    column[:, COLUMNS // 2] = True
    diagonal[np.arange(ROWS), ROWS + 4 - np.arange(ROWS)] = True
    return {"along a row": row, "along a column": column, "of cells corner to corner": diagonal}


def _ask(part: Any, task: PlanningProblem) -> Path:
    with untouched(task):
        return check_path(part.plan(task), task, who="plan()")


def _plan(settings: Any, folder: FilePath, task: PlanningProblem, seed: int = 0) -> Path:
    return _ask(complete("planner", settings.build(context(folder, seed))), task)


def crosses_an_empty_room(settings: Any, folder: FilePath) -> None:
    path = _plan(settings, folder, problem(empty()))
    assert path.found, f"no plan across an empty room: {path.reason}"


def goes_round_walls_from_start_to_goal(settings: Any, folder: FilePath) -> None:
    paths = [_plan(settings, folder, task, seed) for seed, task in enumerate(gates())]
    found = sum(path.found for path in paths)
    assert found >= len(paths) // 2, f"finds {found} of {len(paths)} ways through an opening of a metre"


def goes_through_no_wall(settings: Any, folder: FilePath) -> None:
    for name, blocked in walls().items():
        path = _plan(settings, folder, problem(blocked))
        assert path.reason in UNREACHABLE, (
            f"behind a wall {name} the reason is {path.reason}, expected {' or '.join(UNREACHABLE)}")


def names_a_blocked_start_and_goal(settings: Any, folder: FilePath) -> None:
    """Deep inside an obstacle: a planner may first step out of one that it touches."""
    block, middle = empty(), (2.05, 1.55)
    block[6:26, 10:31] = True
    for wanted, task in ((PlanReason.START_BLOCKED, problem(block, start=middle)),
                         (PlanReason.GOAL_BLOCKED, problem(block, goal=middle))):
        got = _plan(settings, folder, task).reason
        assert got is wanted, f"reason is {got}, expected {wanted}"


def steps_out_of_an_obstacle_or_says_so(settings: Any, folder: FilePath) -> None:
    block = empty()
    block[:, :6] = True
    path = _plan(settings, folder, problem(block))
    assert path.found or path.reason is PlanReason.START_BLOCKED, f"reason is {path.reason}, expected start_blocked"


def names_a_start_or_goal_outside_the_map(settings: Any, folder: FilePath) -> None:
    for out in ((-0.5, 1.0), (9.0, 1.0), (1.0, -0.2), (1.0, 3.4)):
        for task in (problem(empty(), goal=out), problem(empty(), start=out)):
            got = _plan(settings, folder, task).reason
            assert got is PlanReason.OUTSIDE, f"reason is {got}, expected {PlanReason.OUTSIDE}"


def start_at_the_goal_is_a_plan(settings: Any, folder: FilePath) -> None:
    path = _plan(settings, folder, problem(empty(), goal=START_M))
    assert path.found, f"start and goal are one point, reason {path.reason}"


def same_seed_same_plan(settings: Any, folder: FilePath) -> None:
    first, second = (_plan(settings, folder, gates()[0], seed=7).points_m for _ in range(2))
    assert np.array_equal(first, second), "two builds with one seed planned differently; draw from context.rng only"


def takes_no_problem_for_another(settings: Any, folder: FilePath) -> None:
    """One planner, many problems: open and closed ones in turn, of the same and of another size."""
    part = complete("planner", settings.build(context(folder)))
    path = part.plan(problem(empty()))
    kept = np.array(path.points_m)
    for blocked in walls().values():
        got = _ask(part, problem(blocked)).reason
        assert got in UNREACHABLE, f"after another problem, behind a wall, the reason is {got}"
    _ask(part, gates()[0])
    ends = problem(empty(), start=(3.44, 0.57), goal=(0.52, 2.47))
    assert (got := _ask(part, ends).reason) is PlanReason.OK, f"after other problems no way across an empty room: {got}"
    assert np.array_equal(kept, path.points_m), "a path it returned changed when it planned again"


PLANNER = (crosses_an_empty_room, goes_round_walls_from_start_to_goal, goes_through_no_wall, names_a_blocked_start_and_goal,
           steps_out_of_an_obstacle_or_says_so, names_a_start_or_goal_outside_the_map, start_at_the_goal_is_a_plan,
           same_seed_same_plan, takes_no_problem_for_another)
