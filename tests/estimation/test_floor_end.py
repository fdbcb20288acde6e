"""Where the floor ends before a wall that has no depth: at the wall; nowhere else is an end made up."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov
from rhs.api.records import Scan
from rhs.estimation.scans.floor_end import FloorEnds, filled
from rhs.estimation.scans.obstacle_scan import ObstacleScanner
from rhs.estimation.scans.settings import BandSettings, FloorEndSettings
from tests.estimation.test_obstacle_scan import depth_of

CAMERA = camera_from_fov(320, 240, 57.0, height_m=0.6)  # sees the floor from 1.5 m on
WALL = [((2.2, -9.0, 0.0), (2.4, 9.0, 2.6))]


def ends_of(depth):
    """(bearings, ends) of a depth image."""
    scanner = ObstacleScanner(CAMERA, BandSettings(), max_range_m=8.0)
    z = scanner.thinned(depth)
    ends = FloorEnds(scanner, FloorEndSettings(), sure_m=6.0)
    return scanner.bearings_rad, ends.ranges(z, scanner.floor(z))


def floor_alone(boxes):
    """Depth of the floor, all above it being blank, as two eyes see plain walls."""
    depth = depth_of(boxes, camera=CAMERA)
    rows, columns = np.indices(depth.shape)
    rays = CAMERA.rays(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float)) @ CAMERA.body_from_camera[:3, :3].T
    height = CAMERA.height_m + depth.ravel() * rays[:, 2]
    return np.where(height.reshape(depth.shape) > 0.02, np.nan, depth)


def test_the_floor_ends_at_the_foot_of_a_plain_wall():
    bearings, ends = ends_of(floor_alone(WALL))
    assert np.isfinite(ends).mean() > 0.9
    wall = 2.2 / np.cos(bearings)  # the camera stands over the body's origin and looks along x
    np.testing.assert_allclose(ends[np.isfinite(ends)], wall[np.isfinite(ends)], atol=0.12)  # a row of floor is 0.1 m there


def test_a_box_whose_front_has_depth_is_left_to_the_obstacle_scan():
    _, ends = ends_of(depth_of(WALL, camera=CAMERA))
    assert np.isnan(ends).all()


def test_floor_that_is_seen_further_than_the_reach_is_free_to_there():
    _, ends = ends_of(floor_alone([((5.0, -9.0, 0.0), (5.2, 9.0, 2.6))]))
    assert np.isinf(ends).mean() > 0.9  # 5 m is beyond range_m


def test_floor_with_holes_ends_nowhere():
    depth = floor_alone(WALL)
    depth[np.random.default_rng(0).random(depth.shape) < 0.9] = np.nan
    assert np.isfinite(ends_of(depth)[1]).mean() < 0.02


def test_no_floor_no_end():
    assert np.isnan(ends_of(np.full((CAMERA.height, CAMERA.width), np.nan, np.float32))[1]).all()


def test_what_a_scan_knows_stays_and_what_it_does_not_comes_from_the_nearest_bearing():
    scan = Scan(np.array([-0.2, 0.0, 0.2]), np.array([1.0, np.nan, np.nan]), 8.0)
    got = filled(scan, np.array([-0.2, 0.01, 0.21]), np.array([9.0, 2.0, np.nan]))
    np.testing.assert_array_equal(got.ranges_m, [1.0, 2.0, np.nan])
    assert got.max_range_m == 8.0


@pytest.mark.parametrize("wrong", [{"floor_below": 1.5}, {"range_m": 0.0}, {"least_rows": 0}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        FloorEndSettings(**wrong)
