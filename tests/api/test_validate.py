"""The boundary round parts: what keeps the contract passes and is frozen, what breaks it is refused in one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.errors import ContractError
from rhs.api.geometry import camera_from_fov, se2, se3
from rhs.api.grid import OccupancyGrid
from rhs.api.records import (
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
    Twist,
    View,
    Wall,
    WorldFacts,
)
from rhs.api.segments import first_blocked
from rhs.api.validate import (
    FAR_M,
    check_belief,
    check_capture,
    check_closure,
    check_grid,
    check_motion,
    check_observation,
    check_path,
    check_revision,
    check_scan,
    reach_of,
)
from rhs.metrics.path_judge import path_valid

WHO = "odometry=mine (my-package 1.0)"
SPREAD = np.diag([1e-4] * 6)
CAMERA = camera_from_fov(8, 6, 60.0, height_m=1.0)
MOTION = Motion(se2(0.1, 0.0, 0.05), SPREAD, Tracking.OK, details={"inliers": 12.0}, observability=np.ones(6))
BELIEF = Belief(se2(1.0, 2.0, 3.0), SPREAD)
SCAN = Scan(np.array([-0.1, 0.0, 0.1]), np.array([1.0, np.nan, np.inf]), 6.0)
IMAGE, DEPTH = np.zeros((6, 8, 3), np.uint8), np.ones((6, 8), np.float32)
CAPTURE = Capture(3, 1.5, IMAGE, DEPTH, Twist(0.1, 0.0, 0.2), np.zeros(3), SCAN)
OBSERVATION = Observation(3, 1.5, CAMERA, IMAGE, DEPTH, SCAN, CAPTURE.command, np.zeros(3))
GRID = OccupancyGrid(np.array([[0.0, 1.0], [np.nan, 0.5]], np.float32), 0.1, (0.0, 0.0))
VIEWS = tuple(View(k, 0.1 * k, CAMERA, MOTION, se2(0.1 * k, 0.0, 0.0), SPREAD, None, None) for k in range(3))
CLOSURE = Closure(np.stack([view.map_from_body for view in VIEWS]), (LoopEdge(0, 2, np.eye(4), SPREAD, 20),))
REVISION = Revision(CLOSURE.poses, (None, SCAN, None), (Wall(np.zeros(2), np.ones(2)),), SPREAD)


def pose(**entries):
    out = se2(0.1, 0.2, 0.3)
    for key, value in entries.items():
        out[int(key[1]), int(key[2])] = value
    return out


def lopsided():
    out = SPREAD.copy()
    out[0, 1] = 5e-5
    return out


def correlated(share):
    out = SPREAD.copy()
    out[0, 1] = out[1, 0] = share * 1e-4
    return out


def refused(check, *arguments, **keywords) -> str:
    with pytest.raises(ContractError) as caught:
        check(*arguments, who=WHO, **keywords)
    text = str(caught.value)
    assert text.startswith(WHO) and len(text.splitlines()) == 1 and len(text) < 400
    return text


def test_what_keeps_the_contract_passes_and_its_arrays_are_frozen_copies():
    motion, belief = check_motion(MOTION, who=WHO), check_belief(BELIEF, who=WHO)
    scan, grid = check_scan(SCAN, who=WHO), check_grid(GRID, who=WHO)
    said = replace(CLOSURE, covariances=np.stack([SPREAD, np.full((6, 6), np.nan), SPREAD]))
    np.testing.assert_array_equal(check_closure(said, VIEWS, who=WHO).covariances, said.covariances)
    closure, revision = check_closure(CLOSURE, VIEWS, who=WHO), check_revision(REVISION, 3, who=WHO)
    pairs = [(motion.previous_from_body, MOTION.previous_from_body), (motion.covariance, MOTION.covariance),
             (belief.map_from_body, BELIEF.map_from_body), (scan.ranges_m, SCAN.ranges_m),
             (grid.probability, GRID.probability), (closure.poses, CLOSURE.poses), (revision.poses, REVISION.poses)]
    for copy, original in pairs:
        np.testing.assert_array_equal(copy, original)
        assert copy is not original and not copy.flags.writeable and original.flags.writeable


def test_images_are_frozen_in_place_and_not_copied():
    image = np.zeros((6, 8, 3), np.uint8)
    assert check_capture(replace(CAPTURE, image=image), who=WHO).image is image
    assert not image.flags.writeable


@pytest.mark.parametrize(("change", "says"), [
    ({"previous_from_body": pose(a03=np.nan)}, "previous_from_body is not finite"),
    ({"previous_from_body": np.eye(3)}, "expected finite 4x4 numbers"),
    ({"previous_from_body": None}, "expected finite 4x4 numbers"),
    ({"previous_from_body": [["a"] * 4] * 4}, "expected finite 4x4 numbers"),
    ({"previous_from_body": pose().astype(complex)}, "expected finite 4x4 numbers"),
    ({"previous_from_body": pose(a30=1.0, a31=2.0, a32=3.0, a33=4.0)}, "last row [1. 2. 3. 4.]"),
    ({"previous_from_body": se3(1.001 * np.eye(3), np.zeros(3))}, "no rotation"),
    ({"previous_from_body": np.diag([1.0, 1.0, -1.0, 1.0])}, "reflection"),
    ({"previous_from_body": pose(a03=1e7)}, "diverged"),
    ({"covariance": -SPREAD}, "variances"),
    ({"covariance": 0.0 * SPREAD}, "variances"),
    ({"covariance": 1e13 * np.eye(6)}, "variances"),
    ({"covariance": lopsided()}, "not symmetric"),
    ({"covariance": correlated(1.5)}, "not positive definite"),
    ({"covariance": correlated(1.0)}, "not positive definite"),
    ({"covariance": np.full((6, 6), np.inf)}, "covariance is not finite"),
    ({"covariance": SPREAD[:3, :3]}, "expected finite 6x6 numbers"),
    ({"status": "fine"}, "expected a Tracking: ok, degenerate, lost"),
    ({"status": None}, "expected a Tracking"),
    ({"status": BeliefStatus.LOST}, "expected a Tracking"),
    ({"reason": "x" * 131_073}, "131073 characters; expected a text of at most 2000"),
    ({"reason": None}, "reason is of type NoneType"),
    ({"details": {"how": "well"}}, "details['how'] is 'well'"),
    ({"details": {3: 1.0}}, "details[3]"),
    ({"details": None}, "details is of type NoneType"),
    ({"details": {str(k): 0.0 for k in range(1001)}}, "at most 1000"),
    ({"observability": np.ones(5)}, "observability"),
    ({"observability": -np.ones(6)}, "none negative"),
    ({"scan": replace(SCAN, ranges_m=np.ones(2))}, "3 bearings and 2 ranges"),
])
def test_a_bad_motion_is_refused(change, says):
    assert says in refused(check_motion, replace(MOTION, **change))


def test_something_else_than_a_record_is_refused():
    assert "of type tuple; expected a Motion" in refused(check_motion, (np.eye(4), SPREAD))
    assert "of type NoneType; expected a Belief" in refused(check_belief, None)
    assert "expected an OccupancyGrid" in refused(check_grid, GRID.probability)


@pytest.mark.parametrize(("change", "says"), [
    ({"probability": 7.0}, "probability is 7.0; expected a chance in [0, 1]"),
    ({"probability": float("nan")}, "probability is nan"),
    ({"probability": "sure"}, "probability is 'sure'"),
    ({"status": "tracking"}, "expected a BeliefStatus"),
    ({"map_from_body": pose(a33=2.0)}, "last row"),
    ({"covariance": correlated(-1.0)}, "not positive definite"),
])
def test_a_bad_belief_is_refused(change, says):
    assert says in refused(check_belief, replace(BELIEF, **change))


def test_tolerances_are_those_of_float32_and_no_wider():
    check_motion(replace(MOTION, previous_from_body=pose().astype(np.float32)), who=WHO)
    check_motion(replace(MOTION, covariance=correlated(0.999999)), who=WHO)
    tilted = pose(a01=pose()[0, 1] + 1e-4)
    assert "no rotation" in refused(check_motion, replace(MOTION, previous_from_body=tilted))
    tiny = np.diag([1e-4, 1e-4, 1e-12, 1e-12, 1e-12, 1e-6])  # of very different sizes, yet positive definite
    check_motion(replace(MOTION, covariance=tiny), who=WHO)


@pytest.mark.parametrize(("change", "says"), [
    ({"ranges_m": np.array([1.0, 0.0, 2.0])}, "scan.ranges_m is 0"),
    ({"ranges_m": np.array([1.0, -np.inf, 2.0])}, "scan.ranges_m is -inf"),
    ({"ranges_m": np.array([1.0, 1825.2, 2.0])}, "scan.ranges_m is 1825.2"),
    ({"bearings_rad": np.array([0.0, np.nan, 1.0])}, "scan.bearings_rad is not finite"),
    ({"max_range_m": 0.0}, "max_range_m"),
    ({"origin_xy_m": (0.0, np.inf)}, "origin_xy_m"),
    ({"origin_xy_m": (0.0, 0.0, 0.0)}, "origin_xy_m"),
])
def test_a_bad_scan_is_refused(change, says):
    assert says in refused(check_scan, replace(SCAN, **change))


@pytest.mark.parametrize(("change", "says"), [
    ({"stamp_s": float("nan")}, "finite seconds"),
    ({"image": np.zeros((6, 8), np.uint8)}, "(H, W, 3) uint8 RGB"),
    ({"image": np.zeros((6, 8, 3))}, "(H, W, 3) uint8 RGB"),
    ({"depth": np.ones((6, 8), np.uint16)}, "(H, W) float32 metres"),
    ({"depth": np.ones((5, 8), np.float32)}, "8 x 5 pixels; expected 8 x 6"),
    ({"travel": np.zeros(2)}, "travel"),
    ({"command": (0.1, 0.2, 0.3)}, "command"),
    ({"command": Twist(np.nan, 0.0, 0.1)}, "command"),
])
def test_a_bad_capture_is_refused(change, says):
    assert says in refused(check_capture, replace(CAPTURE, **change))


def test_stamps_increase_strictly():
    check_capture(CAPTURE, who=WHO, after_s=1.4)
    assert "1.5 after 1.5; expected stamps that increase" in refused(check_capture, CAPTURE, after_s=1.5)
    assert "1.5 after 9" in refused(check_capture, CAPTURE, after_s=9.0)


@pytest.mark.parametrize(("change", "says"), [
    ({"index": 4}, "those of the capture: 3, 1.5"),
    ({"stamp_s": 0.0}, "those of the capture: 3, 1.5"),
    ({"image": np.zeros((3, 4, 3), np.uint8)}, "4 x 3 pixels; expected 8 x 6"),
    ({"wheel": np.zeros(6)}, "wheel"),
    ({"depth_times": float("nan")}, "depth_times"),
])
def test_a_bad_observation_is_refused(change, says):
    check_observation(OBSERVATION, CAPTURE, who=WHO)
    assert says in refused(check_observation, replace(OBSERVATION, **change), CAPTURE)


@pytest.mark.parametrize(("change", "says"), [
    ({"probability": np.full((2, 2), 7.0)}, "7 in 4 cells; expected chances in [0, 1] or NaN"),
    ({"probability": np.array([[0.5, -0.1]])}, "-0.1 in 1 cells"),
    ({"probability": np.array([[0.5, np.inf]])}, "inf in 1 cells"),
    ({"probability": np.zeros(4)}, "shape (4,)"),
    ({"probability": np.zeros((0, 4))}, "shape (0, 4)"),
    ({"probability": np.broadcast_to(np.float32(0.5), (10_000, 10_000))}, "with 1 to 50000000 cells"),
    ({"resolution_m": 0.0}, "resolution_m is 0.0"),
    ({"resolution_m": float("nan")}, "resolution_m is nan"),
    ({"origin_m": (0.0, float("inf"))}, "origin_m"),
])
def test_a_bad_grid_is_refused(change, says):
    assert says in refused(check_grid, replace(GRID, **change))


@pytest.mark.parametrize(("change", "says"), [
    ({"poses": CLOSURE.poses[:2]}, "expected finite 3x4x4 numbers"),
    ({"poses": se2(5.0, 0.0, 0.0) @ CLOSURE.poses}, "the first view's own pose"),
    ({"poses": CLOSURE.poses * np.array([1.0, 1.0, 2.0])[:, None, None]}, "poses[2] is a pose with last row"),
    ({"poses": np.stack([CLOSURE.poses[0], se2(1e6, 0.0, 0.0), CLOSURE.poses[2]])}, "poses[1] is 1e+06 m away: diverged"),
    ({"edges": (LoopEdge(2, 0, np.eye(4), SPREAD, 20),)}, "earlier < later < 3"),
    ({"edges": (LoopEdge(0, 3, np.eye(4), SPREAD, 20),)}, "earlier < later < 3"),
    ({"edges": (LoopEdge(0, 2, np.zeros((4, 4)), SPREAD, 20),)}, "earlier_from_later"),
    ({"details": {"loops": None}}, "details['loops']"),
    ({"covariances": np.zeros((2, 6, 6))}, "covariances"),
    ({"covariances": np.stack([SPREAD, SPREAD, -SPREAD])}, "variances"),
    ({"covariances": np.stack([SPREAD, SPREAD, np.where(np.eye(6) > 0, SPREAD, np.nan)])}, "covariance"),
])
def test_a_bad_closure_is_refused(change, says):
    assert says in refused(check_closure, replace(CLOSURE, **change), VIEWS)


@pytest.mark.parametrize(("change", "says"), [
    ({"poses": CLOSURE.poses[:2]}, "revise().poses"),
    ({"scans": (None, None)}, "2 scans; expected one, or None, for each of the 3 views"),
    ({"walls": (Wall(np.zeros(2), np.array([0.0, np.nan])),)}, "walls is not finite"),
    ({"walls": (Wall(np.zeros(2), np.array([0.0, 1e9])),)}, "walls is an end at"),
    ({"covariance": -SPREAD}, "variances"),
])
def test_a_bad_revision_is_refused(change, says):
    assert says in refused(check_revision, replace(REVISION, **change), 3)


def test_how_far_a_pose_may_be_follows_from_the_world():
    flat = WorldFacts("flat", (1.0, 1.0, 0.0), (("door", 2.0, 2.0),), (0.0, 0.0, 6.0, 8.0), 0.2)
    assert reach_of(flat) == pytest.approx(10 * 10.0 + 10.0)  # ten diagonals from its far corner
    assert reach_of(replace(flat, places=())) == FAR_M  # a recording, whose bounds are a guess
    assert reach_of(replace(flat, bounds_m=(0.0, 0.0, np.nan, 1.0))) == FAR_M
    far = Belief(se2(0.0, -120.0, 0.0), SPREAD)
    check_belief(far, who=WHO)
    assert "120 m away: diverged; expected at most 110 m" in refused(check_belief, far, reach_m=reach_of(flat))


# --- paths ------------------------------------------------------------------------------------------------------------


def problem(blocked: np.ndarray, start=(0.05, 0.05), goal=(0.95, 0.95)) -> PlanningProblem:
    return PlanningProblem(blocked, 0.1, (0.0, 0.0), np.array(start), np.array(goal))


def path(*points, reason=PlanReason.OK, **fields) -> Path:
    points = np.array(points, float).reshape(-1, 2)
    return Path(reason, points, points, **fields)


FREE = np.zeros((10, 10), bool)
WALL = FREE.copy()
WALL[5, :9] = True
THROUGH_THE_GAP = path((0.05, 0.05), (0.95, 0.45), (0.95, 0.95))


def test_a_path_over_free_cells_passes():
    check_path(path((0.05, 0.05), (0.95, 0.95)), problem(FREE), who=WHO)
    check_path(THROUGH_THE_GAP, problem(WALL), who=WHO)
    check_path(path(reason=PlanReason.DISCONNECTED), problem(WALL), who=WHO)
    check_path(path((0.05, 0.05)), problem(FREE, goal=(0.05, 0.05)), who=WHO)


@pytest.mark.parametrize(("made", "says"), [
    (path((0.05, 0.05), (0.1, 0.05)), "the path's last point is [0.1 0.05]; expected exactly [0.95 0.95]"),
    (path((0.05, 0.05), (0.95, 0.95 - 1e-5)), "last point"),
    (path((0.06, 0.05), (0.95, 0.95)), "first point"),
    (path((0.05, 0.05), (np.nan, 0.5), (0.95, 0.95)), "points_m is not finite"),
    (path((0.05, 0.05), (0.95, 0.95)), "the path is blocked near [0.55 0.55] m"),
    (path((0.05, 0.05), (1.5, 0.5), (0.95, 0.95)), "the path is blocked near [1.5 0.5] m"),
    (path(), "0 points; expected some: the reason is ok"),
    (path((0.05, 0.05), (0.95, 0.95), reason=PlanReason.BUDGET_SPENT), "2 points; expected none"),
    (replace(THROUGH_THE_GAP, reason="ok"), "expected a PlanReason"),
    (replace(THROUGH_THE_GAP, points_m=np.zeros((2, 3))), "expected finite Nx2 numbers"),
    (replace(THROUGH_THE_GAP, points_m=[(0.0, 0.0), (1.0,)]), "expected finite Nx2 numbers"),
    (replace(THROUGH_THE_GAP, raw_m=np.full((2, 2), np.nan)), "raw_m"),
    (replace(THROUGH_THE_GAP, points_m=np.zeros((3_000_000, 2))), "3000000 long; expected at most 100000"),
    (replace(THROUGH_THE_GAP, plan_ms=-5.0), "plan_ms is -5.0"),
    (replace(THROUGH_THE_GAP, learn_ms=np.nan), "learn_ms is nan"),
    (replace(THROUGH_THE_GAP, details={"how": "A*"}), "details['how']"),
    (None, "expected a Path"),
])
def test_a_bad_path_is_refused(made, says):
    assert says in refused(check_path, made, problem(WALL))


def test_a_path_may_run_along_a_wall_and_round_its_corner_but_not_between_two():
    frame = 0.1, (0.0, 0.0)
    along = np.array([(0.05, 0.5), (0.9, 0.5), (0.9, 0.6), (0.05, 0.6)])  # round the end of the wall, on its border
    assert first_blocked(along, WALL, *frame) is None
    two = WALL.copy()
    two[6, :9] = True
    between = np.array([(0.05, 0.6), (0.8, 0.6)])
    assert first_blocked(between, two, *frame) is not None
    pinch = FREE.copy()
    pinch[4, 4] = pinch[5, 5] = True
    assert first_blocked(np.array([(0.42, 0.58), (0.58, 0.42)]), pinch, *frame) is not None  # exactly through the corner
    assert first_blocked(np.array([(0.35, 0.58), (0.58, 0.35)]), pinch, *frame) is not None
    corner = FREE.copy()
    corner[4, 4] = True
    assert first_blocked(np.array([(0.42, 0.58), (0.58, 0.42)]), corner, *frame) is None  # touches one corner
    assert first_blocked(np.array([(0.4, 0.58), (0.58, 0.4)]), corner, *frame) is not None  # cuts it by 7 mm


def test_a_blocked_start_may_be_left_by_a_short_way_and_only_at_the_beginning():
    frame = 0.1, (0.0, 0.0)
    block = FREE.copy()
    block[:, :3] = True
    start, out, goal = (0.15, 0.55), (0.35, 0.55), (0.95, 0.95)
    assert first_blocked(np.array([start, out, goal]), block, *frame) is None
    back = np.array([start, out, (0.25, 0.75), goal])  # into the obstacle again
    assert first_blocked(back, block, *frame) is not None
    long_way = np.array([start, (0.15, 0.95), (0.05, 0.05), (0.35, 0.05), goal])
    assert first_blocked(long_way, block, *frame) is not None
    assert first_blocked(np.array([goal, out, start]), block, *frame) is not None  # a goal may not be blocked


def test_the_judge_that_shares_no_line_of_code_agrees_on_random_paths():
    """Random polylines, half of them on lattice points and cell borders, where it is decided by touch."""
    rng = np.random.default_rng(0)
    found = {True: 0, False: 0}
    for _ in range(10_000):
        blocked = rng.random((7, 9)) < 0.2
        points = rng.uniform((0.0, 0.0), (9.0, 7.0), (rng.integers(2, 5), 2))
        if rng.random() < 0.5:
            points = np.round(2 * points) / 2
        resolution, origin = 0.1, (-0.3, 0.2)
        metres = points * resolution + origin
        row, column = np.floor(np.clip(points[0][::-1], 0, (6.999, 8.999))).astype(int)
        if blocked[row, column]:
            continue  # the judge knows no way out of a blocked start
        ours = first_blocked(metres, blocked, resolution, origin) is None
        assert ours == path_valid(metres, blocked, resolution, origin), (blocked, points)
        found[ours] += 1
    assert min(found.values()) > 1000


def test_a_way_longer_than_any_is_refused_without_much_memory():
    zigzag = np.tile([(0.05, 0.05), (99.95, 0.05)], (40_000, 1))
    assert first_blocked(zigzag, np.zeros((10, 1000), bool), 0.1, (0.0, 0.0)) is not None
