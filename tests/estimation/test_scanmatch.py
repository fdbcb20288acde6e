"""Laying a scan onto a map: what it can see it finds, what it cannot see it leaves to the prior and says so."""

from types import SimpleNamespace

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, inverse, planar, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import FeatureSettings, Motion, Scan, Tracking, View
from rhs.estimation.scans.rays import cast
from rhs.estimation.scans.scan_loops import ScanLoopSettings, scan_edges
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.scans.settings import MatchSettings
from rhs.estimation.views.loops import travelled_m
from rhs_loop_closers.config import PoseGraph

PRIOR = np.diag([0.2**2, 0.2**2, 0.06**2])


def _corridor(end_wall: bool) -> OccupancyGrid:
    """A corridor along x, 20 m long and 2 m wide between wall centres (y = 0.05 and 2.05), closed at x = 19.95 or open."""
    probability = np.full((25, 205), 0.02, np.float32)
    probability[[0, 20]] = 0.98
    if end_wall:
        probability[:21, 199] = 0.98
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


def _scan(grid, state, noise_m=0.0):
    bearings = np.linspace(-0.5, 0.5, 161)
    ranges = cast(grid.occupied(), grid, state[:2], bearings + state[2], 8.0) + 0.05
    ranges += noise_m * np.random.default_rng(int(100 * state[0])).standard_normal(len(ranges))
    return Scan(bearings, np.where(np.isfinite(ranges), ranges, np.inf), 8.0)


def _wrong(truth, state):
    return planar(inverse(se2(*truth)) @ se2(*state))


@pytest.mark.parametrize("offset", [(0.15, 0.12, 0.04), (-0.2, -0.15, -0.05), (0.0, 0.1, 0.0)])
def test_before_an_end_wall_the_whole_pose_is_found(offset):
    grid, truth = _corridor(end_wall=True), (16.0, 1.0, 0.05)
    found = ScanMatcher(grid).match(_scan(grid, truth), planar(se2(*truth) @ se2(*offset)), PRIOR)
    wrong = _wrong(truth, found.state)
    assert np.hypot(*wrong[:2]) < 0.06 and abs(wrong[2]) < 0.02
    assert found.seen == 3 and np.sqrt(found.covariance[0, 0]) < 0.07


def test_along_a_plain_corridor_the_prior_stays_and_the_covariance_is_long():
    grid, truth = _corridor(end_wall=False), (8.0, 1.0, 0.0)
    found = ScanMatcher(grid).match(_scan(grid, truth), np.array([8.18, 1.15, 0.04]), PRIOR)
    wrong = _wrong(truth, found.state)
    assert abs(wrong[1]) < 0.05 and abs(wrong[2]) < 0.015  # the walls are beside the robot
    assert wrong[0] == pytest.approx(0.18, abs=0.02)  # nothing says where along them it is
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(0.2, abs=0.01)
    assert np.sqrt(found.covariance[1, 1]) < 0.1


def test_a_scan_that_fits_nowhere_near_is_refused():
    grid = _corridor(end_wall=True)
    elsewhere = Scan(np.linspace(-0.5, 0.5, 161), np.full(161, 0.6), 8.0)  # something stands before the camera
    assert ScanMatcher(grid).match(elsewhere, np.array([8.0, 1.0, 0.0]), PRIOR) is None
    assert ScanMatcher(grid).match(Scan(np.zeros(3), np.full(3, np.nan), 8.0), np.array([8.0, 1.0, 0.0]), PRIOR) is None


SURE = np.diag([0.05**2, 0.05**2, np.radians(1.0) ** 2])


def test_a_box_before_a_wall_is_not_laid_on_the_wall():
    """A quarter of a metre before the end wall and as wide as the corridor; the robot is where it believes, to 5 cm."""
    bare, truth = _corridor(end_wall=True), np.array([16.0, 1.0, 0.0])
    boxed = np.array(bare.probability)
    boxed[1:20, 196:198] = 0.98
    scan = _scan(OccupancyGrid(boxed, 0.1, (0.0, 0.0)), truth)
    found = ScanMatcher(bare).match(scan, truth, SURE)
    assert abs(_wrong(truth, found.state)[0]) < 0.02
    assert found.covariance[0, 0] > 0.9 * SURE[0, 0] and found.covariance[1, 1] < 0.7 * SURE[1, 1]
    taken = ScanMatcher(bare, MatchSettings(unmapped=0.0)).match(scan, truth, SURE)
    assert _wrong(truth, taken.state)[0] > 0.08  # every end believed to be of the map


def test_a_wall_found_nearer_by_the_error_of_the_belief_pulls_it_there():
    grid, truth = _corridor(end_wall=True), (16.0, 1.0, 0.0)
    found = ScanMatcher(grid).match(_scan(grid, truth), np.array([15.92, 1.0, 0.0]), SURE)
    assert abs(_wrong(truth, found.state)[0]) < 0.05


def test_an_empty_map_and_no_motion_beyond_the_prior():
    empty = OccupancyGrid(np.full((20, 20), 0.02, np.float32), 0.1, (0.0, 0.0))
    assert ScanMatcher(empty).match(_scan(_corridor(True), (8.0, 1.0, 0.0)), np.array([1.0, 1.0, 0.0]), PRIOR) is None
    sure = np.diag([0.01**2, 0.01**2, 0.002**2])
    grid = _corridor(end_wall=True)
    found = ScanMatcher(grid).match(_scan(grid, (16.0, 1.0, 0.0)), np.array([16.0, 1.0, 0.0]), sure)
    np.testing.assert_allclose(found.state, [16.0, 1.0, 0.0], atol=0.01)


def _slab(seen_from_both_sides: bool) -> OccupancyGrid:
    """A wall 3 m long of one row of cells, y 2.0 to 2.1 m; the robot has looked at it from below, or from both sides."""
    probability = np.full((50, 50), np.nan, np.float32)
    probability[5:20, 5:45] = 0.02
    probability[20, 10:40] = 0.98
    if seen_from_both_sides:
        probability[21:45, 5:45] = 0.02
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


@pytest.mark.parametrize(("both", "laid"), [(False, False), (True, True)])
def test_the_unseen_back_of_a_thick_wall_is_not_laid_on_its_front(both, laid):
    """The wall is 0.3 m thick in truth: its back lies 0.25 m behind the mapped front, within the matcher's reach."""
    bearings = np.linspace(-0.5, 0.5, 161)
    ranges = (3.5 - 2.3) / np.cos(bearings)  # from y = 3.5 m looking down on the back face at y = 2.3 m
    found = ScanMatcher(_slab(both)).match(Scan(bearings, ranges, 8.0), np.array([2.5, 3.5, -np.pi / 2]), PRIOR)
    assert (found is not None) == laid  # where the map was seen from above too, what is seen can only be that wall


def test_the_front_of_the_same_wall_is_laid_on_it():
    bearings = np.linspace(-0.5, 0.5, 161)
    scan = Scan(bearings, (2.05 - 0.9) / np.cos(bearings), 8.0)
    found = ScanMatcher(_slab(False)).match(scan, np.array([2.5, 0.78, np.pi / 2]), PRIOR)
    assert found.state[1] == pytest.approx(0.9, abs=0.04)


CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0)


def _there_and_back(heading_drift: float):
    """Views along the corridor and back; on the way back the believed heading and side are off by what was drifted."""
    grid = _corridor(end_wall=True)
    way = [se2(x, 1.0, 0.0) for x in np.arange(3.0, 15.0, 0.25)] + [se2(x, 1.1, np.pi) for x in np.arange(15.0, 5.0, -0.25)]
    turning = se2(15.0, 1.0, 0.0)
    off = turning @ se2(0.0, 0.1, heading_drift) @ inverse(turning)
    views = []
    for k, pose in enumerate(way):
        believed = off @ pose if k >= 48 else pose
        views.append(View(k, 0.1 * k, CAMERA, Motion(np.eye(4), np.eye(6), Tracking.OK), believed, np.eye(6),
                          _scan(grid, planar(pose), 0.02), None))
    return way, views


def test_a_corridor_walked_back_the_other_way_is_recognised_by_its_walls():
    way, views = _there_and_back(0.04)
    poses = np.stack([view.map_from_body for view in views])
    edges = scan_edges(views, poses, travelled_m(poses), ScanLoopSettings())
    assert len(edges) >= 5
    along_m = []
    for edge in edges:
        true = inverse(way[edge.earlier]) @ way[edge.later]
        wrong = planar(inverse(true) @ edge.earlier_from_later)
        sigma = np.sqrt(np.diag(edge.covariance)[[0, 1, 5]])
        assert np.all(np.abs(wrong) < 3.0 * sigma + 0.01)  # right as far as it says it knows
        assert abs(planar(edge.earlier_from_later)[2]) > np.radians(120)
        along_m.append(sigma[0])
    assert np.median(along_m) > 1.0  # along a plain corridor nothing is known


def test_pose_graph_straightens_the_way_back_by_the_walls_alone():
    way, views = _there_and_back(0.04)
    context = SimpleNamespace(rng=np.random.default_rng(0), features=FeatureSettings())
    closure = PoseGraph(walls_every_m=0.0).build(context).close(views)
    untouched = PoseGraph(walls_every_m=0.0, scan_every_m=0.0).build(context).close(views)
    assert closure.details["closures_by_scan"] >= 3 and untouched.details["closures"] == 0

    def sideways_m(poses):
        return np.sqrt(np.mean([planar(inverse(t) @ p)[1] ** 2 for p, t in zip(poses[48:], way[48:], strict=True)]))

    assert sideways_m(closure.poses) < 0.5 * sideways_m(untouched.poses)


def test_the_other_face_of_a_partition_is_not_laid_on_the_one_seen_before():
    """A hall with a wall 0.2 m thick that ends in the open: along it on one side, round its end, and back on the other."""
    probability = np.full((62, 142), 0.02, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.98
    probability[30:32, 1:100] = 0.98  # y 3.0 to 3.2 m
    grid = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    out = [se2(x, 2.5, np.radians(15.0)) for x in np.arange(3.0, 11.0, 0.25)]
    back = [se2(x, 3.7, np.radians(195.0)) for x in np.arange(11.0, 3.0, -0.25)]
    way = [*out, se2(11.5, 3.0, np.radians(90.0)), *back]
    views = [View(k, 0.1 * k, CAMERA, Motion(np.eye(4), np.eye(6), Tracking.OK), pose, np.eye(6),
                  _scan(grid, planar(pose), 0.01), None) for k, pose in enumerate(way)]
    poses = np.stack(way)
    edges = scan_edges(views, poses, travelled_m(poses), ScanLoopSettings())
    assert len(edges) >= 3
    for edge in edges:  # the belief is right: each face laid on itself moves nothing, the back on the front 8 cm and more
        wrong = planar(inverse(edge.earlier_from_later) @ inverse(way[edge.earlier]) @ way[edge.later])
        assert np.hypot(*wrong[:2]) < 0.03


def test_views_that_look_the_same_way_are_left_to_the_camera():
    way, views = _there_and_back(0.0)
    poses = np.stack([view.map_from_body for view in views[:48]])
    assert scan_edges(views[:48], poses, travelled_m(poses), ScanLoopSettings()) == []
