"""The columns of the planning task: pure functions of one path and the problem it answers.

Names end in their unit. What is undefined (the length of a path that is not there) is NaN, never 0. Validity and the
optimum come from rhs.judge, which shares nothing with the planners.
"""

from __future__ import annotations

import numpy as np

from rhs.api.metric import Metric, RunFiles, columns_of
from rhs.api.records import Path, PlanningProblem
from rhs.worlds.plan_files import read_plan
from rhs.worlds.planning_question import class_of

from .path_judge import Optimum, path_valid, polyline_length

NAN = float("nan")
Values = dict[str, float | int | str]


def path_values(path: Path, problem: PlanningProblem, *, optimum: Optimum,
                classes: tuple[tuple[str, np.ndarray], ...] = ()) -> Values:
    """All columns that follow from the path: success, validity, lengths, clearance, smoothness, class."""
    points, raw = np.asarray(path.points_m, float), np.asarray(path.raw_m, float)
    begin = 1 if path.details.get("start_moved_m", 0.0) > 0.0 else 0  # the step out of a blocked cell is not judged
    length, shortest = _length(points), optimum.length_m([points[begin] if path.found else problem.start_m, problem.goal_m])
    judged = _length(points[begin:])
    return {
        "plan_success": int(path.found),
        "plan_valid": _validity(points, raw, begin, problem),
        "plan_reason": str(path.reason),
        "plan_steps": steps_8(points, problem.resolution_m),
        "plan_steps_raw": steps_8(raw, problem.resolution_m),
        "plan_length_m": length,
        "plan_length_raw_m": _length(raw),
        "plan_optimal_m": shortest,
        "plan_above_optimum_pct": _above(judged, shortest),
        "plan_above_optimum_raw_pct": _above(_length(raw[begin:]), shortest),
        "plan_clearance_min_m": clearance_min_m(points[begin:], problem),
        "plan_clearance_raw_min_m": clearance_min_m(raw[begin:], problem),
        "plan_smoothness": smoothness(points),
        "plan_bends": max(len(points) - 2, 0) if path.found else NAN,
        "homotopy": class_of(points, classes),
    }


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
    """Least distance from the polyline to a blocked cell, a square, exact; inf without any. NaN for no path.

    The least distance between a segment and a square that do not cross is at an end of the one or a corner of the other.
    """
    if len(points_m) == 0:
        return NAN
    squares = _edge_cells(problem.blocked)[:, ::-1] * problem.resolution_m + np.asarray(problem.origin_m)
    least = np.inf
    for a, b in zip(points_m[:-1], points_m[1:], strict=True) if len(points_m) > 1 else [(points_m[0], points_m[0])]:
        if len(squares):
            least = min(least, _segment_to_squares(a, b, squares, problem.resolution_m))
    return float(least)


def _segment_to_squares(a: np.ndarray, b: np.ndarray, low: np.ndarray, side: float) -> float:
    best = np.inf
    for end in (a, b):
        gap = np.maximum(np.maximum(low - end, end - low - side), 0.0)
        best = min(best, float(np.hypot(*gap.T).min()))
    along, length2 = b - a, float(((b - a) ** 2).sum())
    for corner in ((0.0, 0.0), (side, 0.0), (0.0, side), (side, side)):
        away = low + np.array(corner) - a
        t = np.clip(away @ along / length2, 0.0, 1.0) if length2 > 0 else np.zeros(len(low))
        best = min(best, float(np.hypot(*(away - t[:, None] * along).T).min()))
    return best


def _edge_cells(blocked: np.ndarray) -> np.ndarray:
    """(N, 2) blocked (row, column) cells that have a free neighbour: only they can be nearest."""
    framed = np.pad(blocked, 1, constant_values=True)
    inner = framed[:-2, 1:-1] & framed[2:, 1:-1] & framed[1:-1, :-2] & framed[1:-1, 2:]
    return np.argwhere(blocked & ~inner)


def _validity(points: np.ndarray, raw: np.ndarray, begin: int, problem: PlanningProblem) -> float:
    """1 if the path and the raw path are free and the path joins start and goal exactly; NaN for no path."""
    if len(points) == 0:
        return NAN
    joins = np.array_equal(points[0], problem.start_m) and np.array_equal(points[-1], problem.goal_m)
    frame = problem.blocked, problem.resolution_m, problem.origin_m
    return float(joins and path_valid(points[begin:], *frame) and path_valid(raw[begin:], *frame))


def _length(points: np.ndarray) -> float:
    return polyline_length(points) if len(points) else NAN


def _above(length: float, optimum: float) -> float:
    """Percent above the optimum; 0 where both are 0."""
    if optimum == 0.0:
        return 0.0 if length == 0.0 else NAN
    return 100.0 * (length / optimum - 1.0)


def planning_values(run: RunFiles) -> Values:
    """All columns that follow from map.yaml and plan.json."""
    if run.json("plan") is None:
        return {metric.name: metric.unknown for metric in PLANNING}
    path, problem, content = read_plan(run.folder)
    optimum = Optimum(problem.blocked, problem.resolution_m, problem.origin_m)
    classes = tuple((name, np.array(gate)) for name, gate in content["classes"].items())
    values = path_values(path, problem, optimum=optimum, classes=classes)
    octile = NAN if content["octile_m"] is None else content["octile_m"]
    rows, columns = problem.blocked.shape
    return values | {"octile_claimed_m": octile, "map_resolution_m": problem.resolution_m, "map_cells": rows * columns}


PLANNING: tuple[Metric, ...] = columns_of(
    planning_values,
    ("plan_success", "", "1: a path was found", "plan.json"),
    ("plan_valid", "", "1: path and raw path stay free and join start and goal exactly; unknown without a path",
     "rhs.metrics.path_judge"),
    ("plan_reason", "", "why there is, or is no, path", "rhs.api.records.PlanReason"),
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
    tasks=("planning",), words=("plan_reason", "homotopy"),
)
