"""The one validator of everything parts hand to one another: a bad value never reaches another part or a table.

Every check takes a record and `who`, the part that made it as a person types it ("odometry=mine (my-package 1.0)"), and
returns the record with frozen copies of its arrays (images, depth and extra modalities, which are large, are frozen in
place unless they are views of a buffer that somebody may fill again). What breaks the contract
raises ContractError in one line: who, which field, what was found, what is expected.

Frames and perturbations are those of rhs.api.geometry. Tolerances: rotations are orthonormal to 1e-5, covariances symmetric
to 1e-6 of the variances, their correlations positive definite to rounding; a path may touch blocked cells to 1e-7 of a cell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .contracts import Blocked
from .frozen import freeze
from .grid import MOST_CELLS, OccupancyGrid
from .records import (
    Belief,
    BeliefStatus,
    Capture,
    Closure,
    LoopEdge,
    Motion,
    Observation,
    Path,
    PlanningProblem,
    PlanReason,
    Revision,
    Scan,
    Tracking,
    View,
    Wall,
    WorldFacts,
)
from .segments import first_blocked, mistaken_ends, with_exact_ends
from .validate_fields import (
    _NUMBER,
    _array,
    _command,
    _contact,
    _det,
    _details,
    _extras,
    _flag,
    _images,
    _known,
    _member,
    _named,
    _number,
    _record,
    _refuse,
    _short,
    _text,
)

FAR_M = 1000.0  # no pose of a building is further from its origin, where nobody says how large it is
DIAGONALS = 10.0  # ... and nowhere further than so many diagonals of the world's bounds
ORTHONORMAL = 1e-5  # greatest entry of R R^T - I: float32 poses pass, scaled ones do not
SYMMETRIC = 1e-6  # greatest asymmetry of a covariance's correlations
MOST_VARIANCE = 1e12  # m^2 or rad^2
MOST_BEAMS = 1_000_000
MOST_POINTS = 100_000  # of a path
LEAST_CELL_M = 1e-3  # a path over smaller ones is cut into more pieces than there is time for

_LAST_ROW = np.array([0.0, 0.0, 0.0, 1.0])
_EYE = np.eye(3)


def reach_of(facts: WorldFacts) -> float:
    """Metres from the origin beyond which a pose has diverged: DIAGONALS of the world's bounds; FAR_M at least where no
    place is named (a recording, whose bounds are a guess) and where the bounds are not known."""
    x0, y0, x1, y1 = facts.bounds_m
    reach = DIAGONALS * math.hypot(x1 - x0, y1 - y0) + math.hypot(max(abs(x0), abs(x1)), max(abs(y0), abs(y1)))
    if not math.isfinite(reach):
        return FAR_M
    return reach if facts.places else max(FAR_M, reach)


@_named
def check_motion(motion: Motion, *, who: str, reach_m: float = FAR_M, gated: bool = False) -> Motion:
    """A Motion: pose, covariance, a Tracking, bounded texts, a scan that is one. reach_m: longest way between two views.
    gated: it comes from the gate, which alone may have replaced it."""
    motion = _record(motion, Motion, who)
    _member(motion.status, Tracking, who, "status")
    _text(motion.reason, who, "reason")
    _flag(motion.scan_measured, who, "scan_measured")
    _flag(motion.replaced, who, "replaced")
    if motion.replaced and not gated:
        _refuse(who, "replaced", "True", "False: the gate alone replaces motions")
    _details(motion.details, who, own=("status", "reason", "replaced"))
    observability = motion.observability
    if observability is not None:
        observability = _array(observability, who, "observability", (6,))
        if observability.min() < 0:
            _refuse(who, "observability", _short(observability), "six square roots of information, none negative")
    return replace(motion, previous_from_body=check_pose(motion.previous_from_body, who=who, field="previous_from_body",
                                                         reach_m=reach_m),
                   covariance=check_covariance(motion.covariance, who=who), observability=observability,
                   scan=None if motion.scan is None else check_scan(motion.scan, who=who))


@_named
def check_belief(belief: Belief, *, who: str, reach_m: float = FAR_M) -> Belief:
    """A Belief: pose within reach_m, covariance, a BeliefStatus, a chance."""
    belief = _record(belief, Belief, who)
    _member(belief.status, BeliefStatus, who, "status")
    if not isinstance(belief.probability, _NUMBER) or not 0.0 <= belief.probability <= 1.0:
        _refuse(who, "probability", _short(belief.probability), "a chance in [0, 1]")
    _details(belief.details, who, own=("status", "probability"))
    return replace(belief, map_from_body=check_pose(belief.map_from_body, who=who, field="map_from_body", reach_m=reach_m),
                   covariance=check_covariance(belief.covariance, who=who))


@_named
def check_scan(scan: Scan, *, who: str) -> Scan:
    """A Scan: finite bearings, as many ranges: positive, NaN (unknown) or +inf (nothing there), none finite beyond FAR_M."""
    scan = _record(scan, Scan, who)
    bearings = _known(_array(scan.bearings_rad, who, "scan.bearings_rad", (None,)))
    ranges = _array(scan.ranges_m, who, "scan.ranges_m", (None,), finite=False)
    if len(bearings) and np.abs(bearings[[0, -1]]).max() > 4.0 * math.pi:
        _refuse(who, "scan.bearings_rad", _short(bearings), "radians")
    if len(bearings) != len(ranges) or len(ranges) > MOST_BEAMS:
        _refuse(who, "scan", f"{len(bearings)} bearings and {len(ranges)} ranges", f"as many, at most {MOST_BEAMS}")
    if (ranges <= 0.0).any() or ((ranges > FAR_M) & (ranges < np.inf)).any():
        worst = ranges[(ranges <= 0.0) | ((ranges > FAR_M) & (ranges < np.inf))][0]
        _refuse(who, "scan.ranges_m", f"{worst:.6g}", f"metres in (0, {FAR_M:g}], NaN (unknown) or inf (nothing there)")
    if not _number(scan.max_range_m) or not 0.0 < scan.max_range_m < np.inf:
        _refuse(who, "scan.max_range_m", _short(scan.max_range_m), "finite metres above 0")
    if len(scan.origin_xy_m) != 2 or not all(_number(v) and abs(v) <= FAR_M for v in scan.origin_xy_m):
        _refuse(who, "scan.origin_xy_m", _short(scan.origin_xy_m), "x and y in metres")
    if not _number(scan.blind_m) or not 0.0 <= scan.blind_m <= FAR_M:
        _refuse(who, "scan.blind_m", _short(scan.blind_m), f"metres in [0, {FAR_M:g}]")
    return replace(scan, bearings_rad=bearings, ranges_m=ranges)


@_named
def check_capture(capture: Capture, *, who: str, after_s: float = -math.inf) -> Capture:
    """A Capture: its stamp later than `after_s` (of the capture before), shapes and types of what it holds."""
    capture = _record(capture, Capture, who)
    if not isinstance(capture.index, int | np.integer) or capture.index < 0:
        _refuse(who, "index", _short(capture.index), "the number of the view, 0 or more")
    if not _number(capture.stamp_s) or not math.isfinite(capture.stamp_s):
        _refuse(who, "stamp_s", _short(capture.stamp_s), "finite seconds")
    if capture.stamp_s <= after_s:
        _refuse(who, "stamp_s", f"{capture.stamp_s:.9g} after {after_s:.9g}", "stamps that increase from view to view")
    image, depth = _images(capture.image, capture.depth, None, who)
    _command(capture.command, who)
    travel = None if capture.travel is None else _array(capture.travel, who, "travel", (3,))
    scan = None if capture.scan is None else check_scan(capture.scan, who=who)
    _contact(capture.contact, who)
    return replace(capture, image=image, depth=depth, travel=travel, scan=scan, extras=_extras(capture.extras, who))


@_named
def check_observation(observation: Observation, capture: Capture, *, who: str) -> Observation:
    """An Observation of this capture: the same index and stamp, images of its camera's size, a scan that is one."""
    observation = _record(observation, Observation, who)
    if (observation.index, observation.stamp_s) != (capture.index, capture.stamp_s):
        _refuse(who, "index and stamp_s", f"{observation.index}, {observation.stamp_s}",
                f"those of the capture: {capture.index}, {capture.stamp_s}")
    camera = observation.camera
    image, depth = _images(observation.image, observation.depth, (camera.height, camera.width), who)
    freeze(camera.body_from_camera)
    _command(observation.command, who)
    wheel = None if observation.wheel is None else _array(observation.wheel, who, "wheel", (3,), finite=False)
    if wheel is not None and np.isinf(wheel).any():
        _refuse(who, "wheel", _short(wheel), "metres and radians, NaN where unknown")
    scan = None if observation.scan is None else check_scan(observation.scan, who=who)
    obstacle = None if observation.obstacle is None else check_scan(observation.obstacle, who=who)
    _contact(observation.contact, who)
    if not _number(observation.depth_times) or not 0.0 < observation.depth_times < math.inf:
        _refuse(who, "depth_times", _short(observation.depth_times), "a number above 0")
    return replace(observation, image=image, depth=depth, wheel=wheel, scan=scan, obstacle=obstacle,
                   extras=_extras(observation.extras, who))


@_named
def check_grid(grid: OccupancyGrid, *, who: str) -> OccupancyGrid:
    """An OccupancyGrid: chances in [0, 1] or NaN, a resolution, a corner, at most MOST_CELLS cells."""
    grid = _record(grid, OccupancyGrid, who)
    if not _number(grid.resolution_m) or not LEAST_CELL_M <= grid.resolution_m <= FAR_M:
        _refuse(who, "resolution_m", _short(grid.resolution_m), f"metres above 0: {LEAST_CELL_M:g} to {FAR_M:g}")
    if len(grid.origin_m) != 2 or not all(_number(v) and math.isfinite(v) for v in grid.origin_m):
        _refuse(who, "origin_m", _short(grid.origin_m), "x and y of the corner in metres")
    shape = np.shape(grid.probability)
    if len(shape) != 2 or not 0 < shape[0] * shape[1] <= MOST_CELLS:
        _refuse(who, "probability", f"of shape {shape}", f"(rows, columns) with 1 to {MOST_CELLS} cells")
    probability = _array(grid.probability, who, "probability", (None, None), finite=False, dtype=None)
    wrong = (probability < 0.0) | (probability > 1.0)
    if wrong.any():
        _refuse(who, "probability", f"{probability[wrong][0]:.6g} in {int(wrong.sum())} cells", "chances in [0, 1] or NaN")
    return replace(grid, probability=probability)


@_named
def check_closure(closure: Closure, views: Sequence[View], *, who: str, reach_m: float = FAR_M) -> Closure:
    """A Closure of these views: a pose for each, the first where it was (to 1e-9 m), edges between views there are."""
    closure = _record(closure, Closure, who)
    poses = check_poses(closure.poses, len(views), who=who, reach_m=reach_m)
    if len(views) and np.abs(poses[0] - views[0].map_from_body).max() > 1e-9:
        own = _short(views[0].map_from_body[:3, 3])
        _refuse(who, "poses[0]", _short(poses[0][:3, 3]), f"the first view's own pose, {own}")
    if not isinstance(closure.edges, tuple | list):
        _refuse(who, "edges", f"of type {type(closure.edges).__name__}", "a tuple of LoopEdge, empty where there is none")
    for edge in closure.edges:
        edge = _record(edge, LoopEdge, who)
        ends = edge.earlier, edge.later
        if not all(isinstance(end, int | np.integer) for end in ends) or not 0 <= ends[0] < ends[1] < len(views):
            _refuse(who, "edges", f"views {_short(ends[0])} and {_short(ends[1])}", f"earlier < later < {len(views)}")
        if not isinstance(edge.inliers, int | np.integer):
            _refuse(who, "edges.inliers", _short(edge.inliers), "a whole number")
        _flag(edge.accepted, who, "edges.accepted")
        _text(edge.reason, who, "edges.reason")
        check_pose(edge.earlier_from_later, who=who, field="earlier_from_later", reach_m=reach_m)
        if edge.accepted:
            check_covariance(edge.covariance, who=who, field="edges.covariance")
    _details(closure.details, who)
    return replace(closure, poses=poses, edges=tuple(closure.edges), covariances=_spread_of(closure, len(views), who))


def _spread_of(closure: Closure, count: int, who: str) -> np.ndarray | None:
    """The covariances of a closure's poses: of each view, or NaN in all entries of those of which nothing is said."""
    if closure.covariances is None:
        return None
    covariances = _array(closure.covariances, who, "covariances", (count, 6, 6), finite=False)
    for covariance in covariances[~np.isnan(covariances).all(axis=(1, 2))]:
        check_covariance(covariance, who=who)
    return covariances


@_named
def check_revision(revision: Revision, count: int, *, who: str, reach_m: float = FAR_M) -> Revision:
    """A Revision of `count` views: a pose for each, a scan (or None) for each or no scans at all, finite
    walls, a covariance or none."""
    revision = _record(revision, Revision, who)
    if revision.scans is not None and len(revision.scans) != count:
        _refuse(who, "revise().scans", f"{len(revision.scans)} scans", f"one, or None, for each of the {count} views")
    for wall in revision.walls:
        wall = _record(wall, Wall, who)
        for end in (wall.start_xy_m, wall.end_xy_m):
            if np.abs(_array(end, who, "walls", (2,))).max() > reach_m:
                _refuse(who, "walls", f"an end at {_short(end)}", f"metres within {reach_m:g} m")
        if not (_number(wall.floor_m) and _number(wall.ceiling_m) and wall.floor_m < wall.ceiling_m):
            _refuse(who, "walls", f"from {_short(wall.floor_m)} to {_short(wall.ceiling_m)} m", "a floor below a ceiling")
    return replace(revision, poses=check_poses(revision.poses, count, who=who, field="revise().poses", reach_m=reach_m),
                   scans=None if revision.scans is None else tuple(
                       None if scan is None else check_scan(scan, who=who) for scan in revision.scans),
                   covariance=None if revision.covariance is None else check_covariance(revision.covariance, who=who))


@_named
def check_path(path: Path, problem: PlanningProblem, *, who: str) -> Path:
    """A Path that answers this problem: points from its start to its goal (what a float32 rounds is put right) that touch
    nothing blocked, or no points and why. A start inside blocked cells (an obstacle grown too late) may be left by a short
    way (rhs.api.segments)."""
    path = _record(path, Path, who)
    _member(path.reason, PlanReason, who, "reason")
    _details(path.details, who)
    for name in ("learn_ms", "plan_ms"):
        if not _number(getattr(path, name)) or not 0.0 <= getattr(path, name) < np.inf:
            _refuse(who, name, _short(getattr(path, name)), "finite milliseconds, not negative")
    points, raw = (_array(getattr(path, name), who, name, (None, 2), most=MOST_POINTS) for name in ("points_m", "raw_m"))
    if path.found != (len(points) > 0):
        _refuse(who, "points_m", f"{len(points)} points", f"{'some' if path.found else 'none'}: the reason is {path.reason}")
    if path.found:
        points = freeze(with_exact_ends(points, problem.start_m, problem.goal_m))
        for where, end, wanted in (("first", points[0], problem.start_m), ("last", points[-1], problem.goal_m)):
            if not np.array_equal(end, wanted):
                fits = mistaken_ends(points, problem.start_m, problem.goal_m, problem.resolution_m, problem.origin_m)
                _refuse(who, f"the path's {where} point", _short(end), f"exactly {_short(wanted)}{fits}")
        grid = problem.blocked, problem.resolution_m, problem.origin_m
        if (at := first_blocked(points, *grid)) is not None:
            turned = first_blocked(np.vstack([points[:1], points[1:-1, ::-1], points[-1:]]), *grid) is None
            fits = "; between its ends x and y are exchanged" if turned else ""
            _refuse(who, "the path", f"blocked near {_short(at)} m", f"a path over free cells of the map{fits}")
    return replace(path, points_m=points, raw_m=raw)


def check_pose(pose: Any, *, who: str, field: str, reach_m: float = math.inf) -> np.ndarray:
    """(4, 4) float64, read-only: finite, a rotation, last row 0 0 0 1, within reach_m of the origin along each axis."""
    array = _array(pose, who, field, (4, 4))
    if (array[3] != _LAST_ROW).any():
        _refuse(who, field, f"a pose with last row {_short(array[3])}", "0 0 0 1")
    rotation = array[:3, :3]
    off = float(np.abs(rotation @ rotation.T - _EYE).max())
    if off > ORTHONORMAL:
        _refuse(who, field, f"no rotation: R R^T is {off:.3g} off the identity (determinant {_det(rotation):.4g})",
                f"at most {ORTHONORMAL:g}")
    if _det(rotation) < 0.0:
        _refuse(who, field, "a reflection (determinant -1)", "a rotation")
    if (far := float(np.abs(array[:3, 3]).max())) > reach_m:
        _refuse(who, field, f"{far:.4g} m away: diverged", f"at most {reach_m:.4g} m, by the size of the world")
    return array


def check_poses(poses: Any, count: int, *, who: str, field: str = "poses", reach_m: float = math.inf) -> np.ndarray:
    """(count, 4, 4) float64, read-only: every one of them a pose."""
    array = _array(poses, who, field, (count, 4, 4))
    for k in range(count):
        check_pose(array[k], who=who, field=f"{field}[{k}]", reach_m=reach_m)
    return array


def check_covariance(covariance: Any, *, who: str, field: str = "covariance") -> np.ndarray:
    """(6, 6) float64, read-only: finite, symmetric, positive definite."""
    array = _array(covariance, who, field, (6, 6))
    variance = array.diagonal()
    if not 0.0 < variance.min() <= variance.max() <= MOST_VARIANCE:
        _refuse(who, field, f"variances {_short(variance)}", f"all above 0 (exact: 1e-12) and at most {MOST_VARIANCE:g}")
    scale = 1.0 / np.sqrt(variance)
    correlation = array * scale * scale[:, None]
    if np.abs(correlation - correlation.T).max() > SYMMETRIC:
        _refuse(who, field, "not symmetric", f"symmetric to {SYMMETRIC:g} of its variances")
    try:
        np.linalg.cholesky(0.5 * (correlation + correlation.T))
    except np.linalg.LinAlgError:
        _refuse(who, field, f"not positive definite (variances {_short(variance)})", "positive definite")
    return array


def check_blocked(answer: Any, *, who: str) -> Blocked:
    """What a replan part answered. Raises ContractError."""
    return _record(answer, Blocked, who)
