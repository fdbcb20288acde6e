"""The columns of the planning task: functions of the files of a run folder (map.yaml, plan.json) and of nothing else.

Names end in their unit. What is undefined (the length of a path that is not there, or not valid) is NaN, never 0.
Validity and the optimum come from the judge (path_judge), which shares nothing with the planners and takes nothing from
them but the points: a start in a blocked cell is its own finding, and so is the way out (`opened`).
"""

from __future__ import annotations

import numpy as np

from rhs.api.metric import Metric, RunFiles, columns_of
from rhs.api.records import Path, PlanningProblem
from rhs.base.errors import RhsError
from rhs.worlds.plan_files import read_plan
from rhs.worlds.planning_question import class_of

from .path_judge import Optimum, opened, path_valid, polyline_length
from .survey import NAN, Values

_ROUNDING_CELLS = 4e-7  # at every bend a path may be shorter by what the judge still calls touching, 1e-7 a side
INVALID = "invalid"  # the plan_reason of a path that was found and is none


def planning_values(run: RunFiles) -> Values:
    """All columns that follow from map.yaml and plan.json. Raises RhsError where the judge contradicts itself."""
    if run.json("plan") is None:
        return {metric.name: metric.unknown for metric in PLANNING} | {"plan_success": 0}
    path, problem, content = read_plan(run.folder)
    classes = tuple((name, np.array(gate)) for name, gate in content["classes"].items())
    values = path_values(path, problem, classes=classes, start_radius_m=content.get("start_radius_m", 0.0))
    octile = NAN if content["octile_m"] is None else content["octile_m"]
    rows, columns = problem.blocked.shape
    return values | {"octile_claimed_m": octile, "map_resolution_m": problem.resolution_m, "map_cells": rows * columns}


def path_values(path: Path, problem: PlanningProblem, *, classes: tuple[tuple[str, np.ndarray], ...] = (),
                start_radius_m: float = 0.0, optimum: Optimum | None = None) -> Values:
    """The columns of one path: success, validity, lengths, clearance, smoothness, class, and why not.

    optimum: of the same problem, to spare finding its corners again.
    """
    judged = opened(problem, start_radius_m)
    if optimum is None or judged is not problem:
        optimum = Optimum(judged.blocked, judged.resolution_m, judged.origin_m)
    points, raw = np.asarray(path.points_m, float), np.asarray(path.raw_m, float)
    fault = fault_of(raw, judged) or fault_of(points, judged) if path.found else ""
    success = path.found and not fault
    optimal_m = optimum.length_m([problem.start_m, problem.goal_m])
    values: Values = {
        "plan_found": int(path.found),
        "plan_valid": float(not fault) if path.found else NAN,
        "plan_success": int(success),
        "plan_reason": INVALID if fault else str(path.reason),
        "plan_failure": _failure(path, fault),
        "plan_optimal_m": optimal_m,
    }
    if not success:
        points = raw = np.empty((0, 2))
    return values | _measures(points, raw, judged, optimal_m) | {"homotopy": class_of(points, classes)}


def _measures(points: np.ndarray, raw: np.ndarray, problem: PlanningProblem, optimal_m: float) -> Values:
    """What is measured of a valid path; NaN without one."""
    return {
        "plan_steps": steps_8(points, problem.resolution_m),
        "plan_steps_raw": steps_8(raw, problem.resolution_m),
        "plan_length_m": polyline_length(points) if len(points) else NAN,
        "plan_length_raw_m": polyline_length(raw) if len(raw) else NAN,
        "plan_above_optimum_pct": above_optimum_pct(points, optimal_m, problem.resolution_m),
        "plan_above_optimum_raw_pct": above_optimum_pct(raw, optimal_m, problem.resolution_m),
        "plan_clearance_min_m": clearance_min_m(points, problem),
        "plan_clearance_raw_min_m": clearance_min_m(raw, problem),
        "plan_smoothness": smoothness(points),
        "plan_bends": max(len(points) - 2, 0) if len(points) else NAN,
    }


def fault_of(points: np.ndarray, problem: PlanningProblem) -> str:
    """Why a path is not valid: it does not join start and goal exactly, or a piece of it is not free; empty if valid."""
    if not len(points) or not np.isfinite(points).all():
        return "the path has no points or some that are not finite"
    ends = ("begin at the start", points[0], problem.start_m), ("end at the goal", points[-1], problem.goal_m)
    for word, point, end in ends:
        if not np.array_equal(point, end):
            return f"the path does not {word} ({end[0]:.3f}, {end[1]:.3f}) m but at ({point[0]:.3f}, {point[1]:.3f}) m"
    frame = problem.blocked, problem.resolution_m, problem.origin_m
    if path_valid(points, *frame):
        return ""
    bad = next((k for k in range(len(points) - 1) if not path_valid(points[k: k + 2], *frame)), 0)
    (ax, ay), (bx, by) = points[bad], points[min(bad + 1, len(points) - 1)]
    return f"the path is not free between ({ax:.3f}, {ay:.3f}) and ({bx:.3f}, {by:.3f}) m"


def above_optimum_pct(points: np.ndarray, optimal_m: float, resolution_m: float) -> float:
    """Percent by which a valid path is longer than the optimum; 0 where both are 0, NaN for no path.

    Raises RhsError for a path shorter than the optimum, or where the optimum found no way: the judge is at fault then.
    """
    if not len(points):
        return NAN
    length_m = polyline_length(points)
    rounding_m = _ROUNDING_CELLS * resolution_m * len(points) + 1e-9 * length_m
    if not length_m >= optimal_m - rounding_m:
        raise RhsError(f"the judge contradicts itself: a valid path of {length_m!r} m, and an optimum of {optimal_m!r} m; "
                       "please report it with the run folder")
    return 100.0 * max(length_m / optimal_m - 1.0, 0.0) if optimal_m > 0.0 else 0.0 if length_m <= rounding_m else NAN


def _failure(path: Path, fault: str) -> str:
    """Why there is no valid path and what to type, in words; empty for a success."""
    if fault:
        return f"{INVALID}: {fault}"
    if path.found:
        return ""
    return f"{path.reason}: {path.advice}" if path.advice else str(path.reason)


def steps_8(points_m: np.ndarray, resolution_m: float) -> float:
    """Steps between neighbouring cells (8-connected) that follow the polyline: its length in the maximum norm, in cells.

    A path through cell centres has exactly as many steps as moves. NaN for no path.
    """
    if len(points_m) == 0:
        return NAN
    return float(np.rint(np.abs(np.diff(points_m, axis=0)).max(axis=1, initial=0.0).sum() / resolution_m))


def smoothness(points_m: np.ndarray) -> float:
    """Sum over bends of (2 * turning angle / (length before + length after))^2, in 1/m^2: 0 for a straight line.

    OMPL's PathGeometric::smoothness, so that both can be compared. NaN for no path.
    """
    if len(points_m) == 0:
        return NAN
    sides = np.diff(points_m, axis=0)
    lengths = np.hypot(*sides.T)
    sides, lengths = sides[lengths > 0], lengths[lengths > 0]
    cosine = (sides[:-1] * sides[1:]).sum(axis=1) / (lengths[:-1] * lengths[1:])
    turning = np.arccos(np.clip(cosine, -1.0, 1.0))
    return float(((2.0 * turning / (lengths[:-1] + lengths[1:])) ** 2).sum())


def clearance_min_m(points_m: np.ndarray, problem: PlanningProblem) -> float:
    """Least distance from the polyline to a blocked cell, a square, exact; inf without any. NaN for no path."""
    from .judge_kernels import least_gap

    if len(points_m) == 0:
        return NAN
    squares = _edge_cells(problem.blocked)[:, ::-1] * problem.resolution_m + np.asarray(problem.origin_m)
    return float(least_gap(np.ascontiguousarray(points_m, float), np.ascontiguousarray(squares), problem.resolution_m))


def _edge_cells(blocked: np.ndarray) -> np.ndarray:
    """(N, 2) blocked (row, column) cells that have a free neighbour: only they can be nearest."""
    framed = np.pad(blocked, 1, constant_values=True)
    inner = framed[:-2, 1:-1] & framed[2:, 1:-1] & framed[1:-1, :-2] & framed[1:-1, 2:]
    return np.argwhere(blocked & ~inner)


PLANNING: tuple[Metric, ...] = columns_of(
    planning_values,
    ("plan_success", "", "1: a path was found, and the judge holds it valid", "rhs.metrics.path_judge"),
    ("plan_found", "", "1: the planner says that it found a path", "plan.json"),
    ("plan_valid", "", "1: path and raw path stay free and join start and goal exactly; unknown without a path",
     "rhs.metrics.path_judge"),
    ("plan_reason", "", "why there is a path or none; invalid: a path was found that is not valid",
     "rhs.api.records.PlanReason"),
    ("plan_failure", "", "the same in words, with what to type", "plan.json, rhs.metrics.planning"),
    ("plan_steps", "", "steps between neighbouring cells (8-connected) along the path", "thesis table 3.1"),
    ("plan_steps_raw", "", "the same before shortening", "thesis table 3.1"),
    ("plan_length_m", "m", "length of the path", "plan.json"),
    ("plan_length_raw_m", "m", "length before shortening", "plan.json"),
    ("plan_optimal_m", "m", "length of the true shortest path (Euclidean, exact)", "rhs.metrics.path_judge"),
    ("plan_above_optimum_pct", "%", "length above the optimum", "rhs.metrics.path_judge"),
    ("plan_above_optimum_raw_pct", "%", "length before shortening above the optimum", "rhs.metrics.path_judge"),
    ("plan_clearance_min_m", "m", "least distance from the path to a blocked cell", "rhs.metrics.planning"),
    ("plan_clearance_raw_min_m", "m", "the same before shortening", "rhs.metrics.planning"),
    ("plan_smoothness", "1/m^2", "sum over bends of (2 turning / (length before + after))^2",
     "OMPL PathGeometric::smoothness"),
    ("plan_bends", "", "corners of the path", "plan.json"),
    ("homotopy", "", "gates of the map that the path crosses, in the order of the file", "map YAML, planning.classes"),
    ("octile_claimed_m", "m", "shortest 8-connected length that the scenario file claims", "MovingAI .scen"),
    ("map_resolution_m", "m", "side of a cell", "map.yaml"),
    ("map_cells", "", "cells of the map", "map.yaml"),
    tasks=("planning",), words=("plan_reason", "plan_failure", "homotopy"),
    more_is_better=("plan_success", "plan_found", "plan_valid", "plan_clearance_min_m", "plan_clearance_raw_min_m"),
)
