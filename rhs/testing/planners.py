"""What planners and mappers must do (see rhs.testing)."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.geometry import se2
from rhs.api.records import Path, PlanningProblem, PlanReason, Scan

from .room import context

RESOLUTION_M = 0.1
SIZE = 40


def problem(blocked: np.ndarray, start=(0.55, 0.55), goal=(3.45, 3.45)) -> PlanningProblem:
    """A problem on a grid whose corner is not the origin, with arrays that cannot be written to."""
    origin = np.array([-1.0, 2.0])
    arrays = [blocked.copy(), np.asarray(start, float) + origin, np.asarray(goal, float) + origin]
    for array in arrays:
        array.setflags(write=False)
    return PlanningProblem(arrays[0], RESOLUTION_M, (-1.0, 2.0), arrays[1], arrays[2])


def empty() -> np.ndarray:
    return np.zeros((SIZE, SIZE), bool)


def gate() -> np.ndarray:
    """A wall across the middle with an opening of one metre at the side."""
    blocked = empty()
    blocked[SIZE // 2, 10:] = True
    return blocked


def sealed() -> np.ndarray:
    """A wall across the middle without an opening."""
    blocked = empty()
    blocked[SIZE // 2] = True
    return blocked


def check_path(path: Path, task: PlanningProblem) -> None:
    """Ends exactly at start and goal and touches nothing in between, or is empty with a reason."""
    assert isinstance(path, Path), f"plan() returned {type(path).__name__}, expected a Path"
    assert isinstance(path.reason, PlanReason), f"reason is {path.reason!r}, expected a PlanReason"
    if not path.found:
        assert len(path.points_m) == 0, f"{path.reason}: a plan that was not found must have no points"
        return
    points = np.asarray(path.points_m)
    assert points.ndim == 2 and points.shape[1] == 2 and len(points) >= 1, f"points_m has shape {points.shape}"
    assert np.array_equal(points[0], task.start_m), f"begins at {points[0]}, not at the start {task.start_m}"
    assert np.array_equal(points[-1], task.goal_m), f"ends at {points[-1]}, not at the goal {task.goal_m}"
    for a, b in zip(points[:-1], points[1:], strict=True):
        along = np.linspace(a, b, int(np.linalg.norm(b - a) / (RESOLUTION_M / 10)) + 2)
        cells = np.floor((along - task.origin_m) / RESOLUTION_M).astype(int)[:, ::-1]
        inside = np.all((cells >= 0) & (cells < task.blocked.shape), axis=1)
        assert inside.all(), f"leaves the map between {a} and {b}"
        assert not task.blocked[tuple(cells.T)].any(), f"runs through a blocked cell between {a} and {b}"


def _plan(settings: Any, folder: FilePath, task: PlanningProblem, seed: int = 0) -> Path:
    path = settings.build(context(folder, seed)).plan(task)
    check_path(path, task)
    return path


def crosses_an_empty_room(settings: Any, folder: FilePath) -> None:
    path = _plan(settings, folder, problem(empty()))
    assert path.found, f"no plan across an empty room: {path.reason}"


def plans_end_exactly_and_touch_nothing(settings: Any, folder: FilePath) -> None:
    for seed in range(2):
        _plan(settings, folder, problem(gate()), seed)


def gives_up_an_unreachable_goal_with_a_reason(settings: Any, folder: FilePath) -> None:
    path = _plan(settings, folder, problem(sealed()))
    assert path.reason in (PlanReason.DISCONNECTED, PlanReason.BUDGET_SPENT), f"reason is {path.reason}"


def names_a_blocked_start_and_goal(settings: Any, folder: FilePath) -> None:
    """Deep inside an obstacle: a planner may first step out of one that it touches."""
    block, middle = empty(), (2.05, 2.05)
    block[10:31, 10:31] = True
    assert (got := _plan(settings, folder, problem(block, start=middle)).reason) is PlanReason.START_BLOCKED, got
    assert (got := _plan(settings, folder, problem(block, goal=middle)).reason) is PlanReason.GOAL_BLOCKED, got


def names_a_start_or_goal_outside_the_map(settings: Any, folder: FilePath) -> None:
    for out in ((-0.5, 1.0), (9.0, 1.0)):
        assert (got := _plan(settings, folder, problem(empty(), goal=out)).reason) is PlanReason.OUTSIDE, got
        assert (got := _plan(settings, folder, problem(empty(), start=out)).reason) is PlanReason.OUTSIDE, got


def start_at_the_goal_is_a_plan(settings: Any, folder: FilePath) -> None:
    path = _plan(settings, folder, problem(empty(), goal=(0.55, 0.55)))
    assert path.found, f"start and goal are one point, reason {path.reason}"


def same_seed_same_plan(settings: Any, folder: FilePath) -> None:
    plans = [_plan(settings, folder, problem(gate()), seed=7).points_m for _ in range(2)]
    assert np.array_equal(plans[0], plans[1]), "two builds with one seed planned differently; draw from context.rng only"


PLANNER = (crosses_an_empty_room, plans_end_exactly_and_touch_nothing, gives_up_an_unreachable_goal_with_a_reason,
           names_a_blocked_start_and_goal, names_a_start_or_goal_outside_the_map, start_at_the_goal_is_a_plan,
           same_seed_same_plan)

BEARINGS = np.linspace(-0.4, 0.4, 81)


def wall_ahead(distance_m: float = 2.0) -> Scan:
    """A wall across the way."""
    return Scan(BEARINGS.copy(), distance_m / np.cos(BEARINGS), 6.0)


def _drawn(settings: Any, folder: FilePath, *scans: Scan) -> Any:
    mapper = settings.build(context(folder))
    for scan in scans:
        mapper.update(se2(-1.0, 0.05, 0.0), scan)
    return mapper


def _at(grid: Any, x_m: float, y_m: float) -> float:
    row, column = grid.cells(np.array([[x_m, y_m]]))[0]
    return float(grid.probability[row, column])


def covers_the_world(settings: Any, folder: FilePath) -> None:
    x0, y0, x1, y1 = context(folder).world.bounds_m
    corners = np.array([[x0, y0], [x0, y1], [x1, y0], [x1, y1]])
    grid = _drawn(settings, folder).grid()
    assert grid.inside(corners).all(), f"grid at {grid.origin_m} of shape {grid.shape} does not hold the world's corners"


def a_wall_is_occupied_and_the_way_to_it_free(settings: Any, folder: FilePath) -> None:
    grid = _drawn(settings, folder, *[wall_ahead()] * 8).grid()
    probability = grid.probability[~np.isnan(grid.probability)]
    assert np.all((probability >= 0) & (probability <= 1)), "probabilities must lie in [0, 1]"
    assert _at(grid, 0.0, 0.05) < 0.25, f"a metre ahead, seen through: {_at(grid, 0.0, 0.05):.2f}"
    near = max(_at(grid, 1.0 + d, 0.05) for d in (-RESOLUTION_M, 0.0, RESOLUTION_M))
    assert near > 0.65, f"the wall two metres ahead: {near:.2f}"


def unknown_ranges_change_nothing(settings: Any, folder: FilePath) -> None:
    blind = Scan(BEARINGS.copy(), np.full(len(BEARINGS), np.nan), 6.0)
    before, after = _drawn(settings, folder, wall_ahead()).grid(), _drawn(settings, folder, wall_ahead(), blind).grid()
    assert np.array_equal(before.probability, after.probability, equal_nan=True), "a scan of NaN changed the map"


def reset_forgets_everything(settings: Any, folder: FilePath) -> None:
    mapper, fresh = _drawn(settings, folder, wall_ahead()), _drawn(settings, folder)
    mapper.reset()
    assert np.array_equal(mapper.grid().probability, fresh.grid().probability, equal_nan=True)


def keeps_no_hold_of_what_it_was_given(settings: Any, folder: FilePath) -> None:
    mapper, scan, pose = settings.build(context(folder)), wall_ahead(), se2(-1.0, 0.05, 0.0)
    mapper.update(pose, scan)
    before = mapper.grid().probability.copy()
    scan.ranges_m[:] = 0.5
    pose[:] = np.eye(4)
    assert np.array_equal(before, mapper.grid().probability, equal_nan=True), "the map moved with its arguments"


MAPPER = (covers_the_world, a_wall_is_occupied_and_the_way_to_it_free, unknown_ranges_change_nothing,
          reset_forgets_everything, keeps_no_hold_of_what_it_was_given)
