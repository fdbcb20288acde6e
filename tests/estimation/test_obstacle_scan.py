"""What of a depth image is an obstacle: boxes and tables are, lamps and the floor are not, however the camera sways."""

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, exp_so3, log_so3, se3
from rhs.estimation.scans.obstacle_scan import ObstacleScanner, levelled
from rhs.estimation.scans.settings import BandSettings

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.2)
ROOM = [((6.0, -9.0, 0.0), (6.2, 9.0, 2.6))]  # the wall ahead, x y z metres


def depth_of(boxes, *, pitch_deg=0.0, roll_deg=0.0, lift_m=0.0, camera=CAMERA):
    """(H, W) ideal depth of boxes (low corner, high corner) on the floor z = 0, seen by a camera that hangs askew."""
    tilt = exp_so3(np.radians([roll_deg, pitch_deg, 0.0]))
    world_from_camera = se3(tilt, np.array([0.0, 0.0, lift_m])) @ camera.body_from_camera
    v, u = np.indices((camera.height, camera.width))
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float)) @ world_from_camera[:3, :3].T
    eye = world_from_camera[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[:, 2] < 0, -eye[2] / rays[:, 2], np.inf)
        for low, high in boxes:
            near, far = (np.asarray(low) - eye) / rays, (np.asarray(high) - eye) / rays
            enter, leave = np.minimum(near, far).max(axis=1), np.maximum(near, far).min(axis=1)
            depth = np.where((enter < leave) & (enter > 0) & (enter < depth), enter, depth)
    depth[depth > 8.0] = np.nan
    return depth.reshape(camera.height, camera.width).astype(np.float32)


def ahead(scan, within_rad=0.1):
    """Ranges of the beams that run straight ahead."""
    return scan.ranges_m[np.abs(scan.bearings_rad) < within_rad]


def look(boxes, settings=None, **camera):
    return ObstacleScanner(CAMERA, settings or BandSettings(), max_range_m=8.0).scan(depth_of([*ROOM, *boxes], **camera))


@pytest.mark.parametrize("name, box, range_m", [
    ("a box 0.3 m high", ((3.5, -0.5, 0.0), (4.0, 0.5, 0.3)), 3.5),
    ("a box 0.1 m high", ((3.5, -0.5, 0.0), (4.0, 0.5, 0.12)), 3.5),
    ("a table top 0.7 m high, on legs that are not in the picture", ((3.0, -0.8, 0.65), (4.0, 0.8, 0.7)), 3.0),
    ("a shelf at the height of the camera", ((2.5, -0.8, 1.1), (3.0, 0.8, 1.4)), 2.5),
])
def test_what_stands_between_the_floor_and_the_robots_height_is_an_obstacle_where_it_stands(name, box, range_m):
    assert ahead(look([box])) == pytest.approx(range_m, abs=0.03), name


@pytest.mark.parametrize("name, box", [
    ("a lamp at 2.2 m", ((3.0, -0.5, 2.2), (3.5, 0.5, 2.4))),
    ("the lintel of a door at 2 m", ((2.0, -0.5, 2.0), (2.2, 0.5, 2.6))),
    ("a sill of 2 cm", ((3.4, -2.0, 0.0), (3.6, 2.0, 0.02))),
])
def test_what_the_robot_passes_under_or_over_is_none(name, box):
    assert np.isinf(ahead(look([box]))).all(), name  # the wall is 6 m away, further than obstacles are looked for


@pytest.mark.parametrize("pitch_deg, roll_deg, lift_m",
                         [(3, 0, 0), (-3, 0, 0), (5, 2, 0), (0, 4, 0), (0, 0, 0.08), (2, -2, -0.06)])
def test_a_camera_that_sways_or_sits_higher_than_told_makes_no_obstacle_of_the_floor_and_still_sees_the_box(
        pitch_deg, roll_deg, lift_m):
    sway = {"pitch_deg": pitch_deg, "roll_deg": roll_deg, "lift_m": lift_m}
    assert np.isinf(look([], **sway).ranges_m).all()
    assert ahead(look([((3.5, -0.5, 0.0), (4.0, 0.5, 0.3))], **sway)).min() == pytest.approx(3.5, abs=0.1)


@pytest.mark.parametrize("pitch_deg, roll_deg", [(3, 0), (-4, 0), (0, 5), (4, -3)])
def test_how_the_camera_hangs_is_read_off_the_floor_to_a_tenth_of_a_degree(pitch_deg, roll_deg):
    scanner = ObstacleScanner(CAMERA, BandSettings(), max_range_m=8.0)
    floor, seen = scanner.floor(scanner.thinned(depth_of(ROOM, pitch_deg=pitch_deg, roll_deg=roll_deg)))
    true = exp_so3(np.radians([roll_deg, pitch_deg, 0.0])) @ CAMERA.body_from_camera[:3, :3]
    off = log_so3(true.T @ levelled(CAMERA, floor).body_from_camera[:3, :3])
    assert seen and np.degrees(np.linalg.norm(off)) < 0.1


def test_the_robots_height_is_its_cameras_and_a_little_or_what_is_said():
    lamp = ((3.0, -0.5, 1.6), (3.5, 0.5, 1.8))
    assert np.isinf(ahead(look([lamp]))).all()
    assert ahead(look([lamp], BandSettings(robot_height_m=1.7))) == pytest.approx(3.0, abs=0.03)


def test_the_scan_says_from_where_on_it_sees_the_floor():
    """The lowest ray of a camera at 1.2 m dips by 22.2 degrees in the middle, 19.7 at the sides: 1.16 m / tan(19.7)."""
    assert look([]).blind_m == pytest.approx(1.16 / np.tan(np.radians(19.7)), rel=0.02)
    upward = replace(CAMERA, body_from_camera=se3(exp_so3(np.radians([0, -40.0, 0])) @ CAMERA.body_from_camera[:3, :3],
                                                  CAMERA.body_from_camera[:3, 3]))
    assert ObstacleScanner(upward, BandSettings(), max_range_m=8.0).scan(
        np.full((240, 320), 2.0, np.float32)).blind_m == 5.0, "it never sees the floor"


def test_unknown_depth_is_unknown_and_a_single_wrong_pixel_is_no_obstacle():
    scanner = ObstacleScanner(CAMERA, BandSettings(), max_range_m=8.0)
    assert np.isnan(scanner.scan(np.full((240, 320), np.nan, np.float32)).ranges_m).all()
    speck = depth_of(ROOM)
    speck[101, 161] = 1.5
    assert np.isinf(ahead(scanner.scan(speck))).all()
