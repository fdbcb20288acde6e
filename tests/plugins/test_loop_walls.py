"""Walls that hold a survey straight between its loops: a depth camera in simulated corridors, a drifting odometry."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, inverse, planar, se2
from rhs.api.records import FeatureSettings, Motion, Scan, Tracking, View
from rhs_loop_closers.config import PoseGraph
from rhs_loop_closers.walls import WallSettings, crooked, followed, wall_graph

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0)
BEARINGS = np.radians(np.linspace(-28.4, 28.4, 320))
BOX = np.array([[0, 0], [12, 0], [12, 12], [0, 12], [0, 0]], float)
INNER = np.array([[2, 2], [10, 2], [10, 10], [2, 10], [2, 2]], float)


def _segments(*chains):
    return np.concatenate([np.stack([chain[:-1], chain[1:]], axis=1) for chain in chains])


SQUARE = _segments(BOX, INNER)


def _seen(pose, segments, rng):
    """A scan of wall segments (S, 2, 2), up to 8 m, with the noise of a Kinect in the inverse range."""
    x, y, yaw = planar(pose)
    u = np.stack([np.cos(BEARINGS + yaw), np.sin(BEARINGS + yaw)])
    start, way = segments[:, 0] - [x, y], segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        det = way[:, :1] * u[1] - way[:, 1:] * u[0]
        reach = (way[:, :1] * start[:, 1:] - way[:, 1:] * start[:, :1]) / det
        share = (u[0] * start[:, 1:] - u[1] * start[:, :1]) / det
        near = np.max(np.where((reach > 0) & (share >= 0) & (share <= 1), 1.0 / reach, 0.0), axis=0)
    near = near + rng.normal(0.0, 0.002, len(near))
    return Scan(BEARINGS, np.where(near > 0.125, 1.0 / np.maximum(near, 1e-3), np.nan), 8.0)


def _lap():
    """Once round between the two squares: 0.2 m and 15 degrees from view to view."""
    out = [se2(1.0, 1.0, 0.0)]
    for _ in range(4):
        out += [out[-1] @ se2(0.2 * k, 0.0, 0.0) for k in range(1, 51)]
        out += [out[-1] @ se2(0.0, 0.0, np.radians(15.0 * k)) for k in range(1, 7)]
    return np.stack(out)


def _views(truth, segments, *, longer=1.0, drift=(0.0, 0.0, 0.0)):
    """Views believed where steps lead whose metres are `longer` and which drift by (x m, y m, yaw rad) each, with noise."""
    rng, believed, out = np.random.default_rng(0), truth[0], []
    for k, pose in enumerate(truth):
        if k:
            step = inverse(truth[k - 1]) @ pose
            step[:2, 3] *= longer
            believed = believed @ step @ se2(*(drift + rng.normal(0.0, [0.002, 0.002, 0.001])))
        motion = Motion(np.eye(4), np.diag([1e-5] * 3 + [1e-6] * 3), Tracking.OK)
        out.append(View(k, 0.1 * k, CAMERA, motion, believed, np.eye(6), _seen(pose, segments, rng), None))
    return out


def _closed(views, **settings):
    context = SimpleNamespace(rng=np.random.default_rng(0), features=FeatureSettings())
    return PoseGraph(**settings).build(context).close(views)


def _ate_m(poses, truth):
    return float(np.sqrt(((np.asarray(poses)[:, :2, 3] - truth[:, :2, 3]) ** 2).sum(axis=1).mean()))


@pytest.fixture(scope="module")
def lap():
    truth = _lap()
    return truth, _views(truth, SQUARE, longer=0.97, drift=(0.0, 0.0, 0.001))


def test_without_any_loop_walls_take_out_drift_and_find_that_metres_are_too_short(lap):
    truth, views = lap
    closure = _closed(views)
    before = _ate_m([view.map_from_body for view in views], truth)
    assert before > 0.3
    assert _ate_m(closure.poses, truth) < 0.15 * before
    assert closure.details["odometry_short_share"] == pytest.approx(1 / 0.97 - 1.0, abs=0.005)
    assert closure.details["closures"] == 0.0 and closure.edges == ()  # a wall is no loop
    assert 8.0 <= closure.details["walls"] <= 14.0
    assert closure.details["edges_between"] > 100.0
    np.testing.assert_array_equal(closure.poses[0], views[0].map_from_body)


def test_walls_can_be_left_out(lap):
    _, views = lap
    closure = _closed(views, walls_every_m=0.0)
    np.testing.assert_array_equal(closure.poses, [view.map_from_body for view in views])
    assert closure.details["edges_between"] == 0.0 and "odometry_short_share" not in closure.details


def test_only_a_measured_scan_of_a_robot_on_a_floor_shows_walls(lap):
    _, views = lap
    carried = [replace(view, camera=camera_from_fov(320, 240, 57.0, height_m=0.0)) for view in views]
    one_eye = [replace(view, motion=replace(view.motion, scan=view.scan)) for view in views]
    blind = [replace(view, scan=None) for view in views]
    for others in (carried, one_eye, blind):
        np.testing.assert_array_equal(_closed(others).poses, [view.map_from_body for view in views])


@pytest.mark.parametrize("radius_m", [4.0, 20.0, 60.0, 200.0])
def test_a_bent_corridor_is_not_straightened(radius_m):
    """Walls 1 m to both sides of an arc of 20 m, drawn in chords of 0.1 m."""
    angles = np.arange(0.0, min(20.0 / radius_m, 2 * np.pi), 0.2 / radius_m)
    truth = np.stack([se2(radius_m * np.cos(a), radius_m * np.sin(a), a + np.pi / 2) for a in angles])
    corners = np.arange(-10.0, 35.0, 0.1) / radius_m
    both = [r * np.stack([np.cos(corners), np.sin(corners)], axis=1) for r in (radius_m - 1.0, radius_m + 1.0)]
    views = _views(truth, _segments(*both))
    believed = np.stack([view.map_from_body for view in views])
    assert _ate_m(_closed(views).poses, truth) < 1.2 * _ate_m(believed, truth) + 0.01


def test_a_wall_set_back_by_a_hand_is_another_wall():
    """Along a wall that is 0.1 m further away from x = 10 m on; the right one goes on straight."""
    walls = _segments(np.array([[0, 1], [10, 1], [10, 1.1], [30, 1.1]], float), np.array([[0, -1], [30, -1]], float))
    truth = np.stack([se2(x, 0.0, 0.0) for x in np.arange(0.0, 20.0, 0.2)])
    found = followed(_views(truth, walls), truth, WallSettings())
    left = sorted(wall.state[1] for wall in found if wall.state[1] > 0)
    assert left == pytest.approx([1.0, 1.1], abs=0.01)
    assert [wall.state[1] for wall in found if wall.state[1] < 0] == pytest.approx([-1.0], abs=0.01)


def test_a_wall_lost_from_sight_is_not_recognised():
    """The same stretch of wall seen before and after 12 m of a way that leads elsewhere: two walls."""
    walls = _segments(np.array([[0, 1], [12, 1]], float))
    stretch = [se2(x, 0.0, 0.0) for x in np.arange(0.0, 4.0, 0.2)]
    away = [se2(4.0, -0.2 * k, -np.pi / 2) for k in range(30)]
    truth = np.stack([*stretch, *away, *away[::-1], *stretch])
    found = followed(_views(truth, walls), truth, WallSettings())
    assert len(found) == 2
    assert max(k for k, _ in found[0].sightings) < 25 and min(k for k, _ in found[1].sightings) > 75


def test_a_wall_whose_sightings_fit_no_line_is_named():
    truth = np.stack([se2(x, 0.0, 0.0) for x in np.arange(0.0, 4.0, 0.2)])
    views = _views(truth, _segments(np.array([[0, 1], [12, 1]], float), np.array([[0, -1], [12, -1]], float)))
    graph = wall_graph(followed(views, truth, WallSettings()), truth, WallSettings())
    assert len(graph.first) == 2
    chi2 = np.where(graph.wall_of == 1, 30.0, 1.0)
    assert crooked(graph, chi2, WallSettings()).tolist() == [False, True]
    assert set(graph.without(np.array([False, True])).wall_of.tolist()) == {0}
    assert wall_graph([], truth, WallSettings()) is None
