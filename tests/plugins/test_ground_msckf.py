"""One camera over a known floor: the free way is measured where two views differ, and unknown where they do not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov, inverse, se2, transform
from rhs.api.records import Features, Motion, Observation, Scan, Tracking, Twist
from rhs.estimation.scans.wall_rays import lift_on_scan
from rhs.patrol.control import Pace
from rhs.patrol.guard import Guard, GuardSettings
from rhs.patrol.mission import MissionSettings, turning
from rhs.testing.checks import check_plugin
from rhs.testing.room import FURNISHED, context, ranges
from rhs_odometry.ground.config import GroundMsckf, StixelSettings
from rhs_odometry.ground.odometry import drift, ground_filter, halted, standing
from rhs_odometry.ground.stixel_kernels import _over
from rhs_odometry.ground.stixels import Stixels
from rhs_odometry.tracks.track_frames import TrackFrame

CAMERA = camera_from_fov(160, 120, 57.0, height_m=1.0, pitch_deg=15.0)
FEW = StixelSettings(beams=40, rows=48)


def looked(poses: list[np.ndarray]) -> tuple[Stixels, np.ndarray]:
    stixels = Stixels(CAMERA, FEW)
    for pose in poses:
        stixels.add(observe(CAMERA, se2(*pose), paintings(), room=FURNISHED).image)
    return stixels, np.array(poses)


@pytest.mark.parametrize("heading", [0.3, -0.9, 2.0])
def test_the_scan_ends_where_the_walls_and_boxes_are(heading: float) -> None:
    step = 0.125 * np.array([np.cos(heading), np.sin(heading)])
    start = np.array([-1.0, -0.5])
    stixels, poses = looked([np.array([*(start + k * step), heading]) for k in range(7)])
    scan = stixels.scan(6, poses)
    assert scan is not None
    true = ranges(FURNISHED, se2(*poses[6]), scan.bearings_rad, height_m=0.3)
    known = np.isfinite(scan.ranges_m)
    off = np.abs(scan.ranges_m[known] / true[known] - 1.0)
    assert known.mean() > 0.3
    assert np.mean(off < 0.15) > 0.85


def test_a_distance_between_two_steps_is_found_there_and_one_at_the_end_of_them_is_left() -> None:
    """Costs that are a parabola in the inverse distance, least at 1.6 m, where steps are 15 cm apart; and others that are
    least at the nearest distance."""
    stixels = Stixels(CAMERA, FEW)
    inverse_m = 1.0 / stixels._ranges
    costs = np.stack([(inverse_m - 1.0 / 1.6) ** 2, -inverse_m])
    found = stixels._between(costs, costs.argmin(axis=1))
    assert np.abs(stixels._ranges - 1.6).min() > 0.02, "it is none of the steps"
    assert found == pytest.approx([1.6, FEW.nearest_m])


def test_without_way_between_the_views_nothing_is_known() -> None:
    stixels, poses = looked([np.array([0.0, 0.0, 0.1 * k]) for k in range(5)])
    scan = stixels.scan(4, poses)
    assert scan is not None and np.isnan(scan.ranges_m).all()


def test_a_view_without_a_picture_has_no_scan() -> None:
    stixels = Stixels(CAMERA, FEW)
    stixels.add(None)
    assert stixels.scan(0, np.zeros((1, 3))) is None


def frame(pixels: np.ndarray, forward_m: float) -> TrackFrame:
    return TrackFrame(0.0, np.arange(len(pixels)), pixels, np.array([forward_m, 0.0, 1.0]))


def test_identical_pictures_mean_no_motion_whatever_was_commanded() -> None:
    pixels = np.random.default_rng(0).uniform(10, 110, (40, 2))
    settings = GroundMsckf()
    assert standing(frame(pixels, 0.1), frame(pixels + 0.05, 0.1), CAMERA, settings.advanced)
    assert not standing(frame(pixels, 0.1), frame(pixels + 1.0, 0.1), CAMERA, settings.advanced)
    assert not standing(frame(pixels[:5], 0.1), frame(pixels[:5], 0.1), CAMERA, settings.advanced), "five points say nothing"
    core = ground_filter(settings, CAMERA, np.zeros(3))
    core.step(frame(pixels, 0.0))
    core.step(halted(frame(pixels, 0.1)))
    assert np.abs(core.state.clones[-1, :3]).max() < 1e-9


def turned(noise: int, others: int, views: int = 8) -> list[TrackFrame]:
    """A camera told to turn on the spot by 0.1 rad a view: far points that move as if it turned by a tenth more, and points
    of noise, which stay where they are in the picture."""
    rng, bearings = np.random.default_rng(0), np.linspace(0.0, 0.35, others)
    far = 100.0 * np.stack([np.cos(bearings), np.sin(bearings), np.linspace(0.04, 0.4, others)], axis=1)
    still, frames = rng.uniform((5, 5), (155, 60), (noise, 2)), []
    for view in range(views):
        seen = CAMERA.project(transform(inverse(se2(0.0, 0.0, 0.11 * view) @ CAMERA.body_from_camera), far))
        pixels = np.concatenate([seen, still + 0.1 * rng.standard_normal(still.shape)])
        frames.append(TrackFrame(0.25 * view, np.arange(len(pixels)), pixels, np.array([0.0, 0.1, 0.25])))
    return frames


def test_few_points_that_agree_among_many_that_do_not_tell_no_more_than_the_command() -> None:
    """Four among twenty of noise tell nothing: heading and covariance are those of nobody seen; four among none, or twelve
    among four, are believed."""
    core = {}
    for noise, others in ((0, 0), (20, 4), (0, 4), (4, 12)):
        core[noise, others] = ground_filter(GroundMsckf(), CAMERA, np.zeros(3))
        for view in turned(noise, others):
            core[noise, others].step(view)
    yaw = {points: filtered.state.clones[-1, 2] for points, filtered in core.items()}
    sigma = {points: np.sqrt(filtered.state.pose_covariance()[2, 2]) for points, filtered in core.items()}
    assert yaw[20, 4] == yaw[0, 0] == pytest.approx(0.7, abs=0.01) and sigma[20, 4] == pytest.approx(sigma[0, 0])
    assert min(yaw[0, 4], yaw[4, 12]) > 0.73 and max(sigma[0, 4], sigma[4, 12]) < 0.8 * sigma[0, 0]


def corridor(seed: int) -> list[TrackFrame]:
    """Four metres straight ahead, told exactly and driven to 3 %, between walls of points 2 m apart, seen to 0.5 pixels."""
    rng = np.random.default_rng(seed)
    along, across, up = rng.uniform(0.0, 9.0, 400), rng.uniform(-1.0, 1.0, 400), rng.uniform(0.1, 2.0, 400)
    floor = rng.random(400) < 0.3
    points = np.stack([along, np.where(floor, across, np.sign(across)), np.where(floor, 0.0, up)], axis=1)
    frames, way_m = [], np.cumsum([0.0, *0.125 * (1.0 + 0.03 * rng.standard_normal(32))])
    for view, x_m in enumerate(way_m):
        seen = transform(inverse(se2(x_m, 0.0, 0.0) @ CAMERA.body_from_camera), points)
        pixels = CAMERA.project(seen)
        inside = ((pixels > 0.0) & (pixels < (159.0, 119.0))).all(axis=1)
        ids = np.flatnonzero(inside & (seen[:, 2] > 0.5) & (seen[:, 2] < 5.0))
        noisy = pixels[ids] + 0.5 * rng.standard_normal((len(ids), 2))
        frames.append(TrackFrame(0.25 * view, ids, noisy, np.array([0.125 * (view > 0), 0.0, 0.25])))
    return frames


@pytest.mark.parametrize("seed", range(3))
def test_no_view_tells_the_heading_with_which_the_map_begins(seed: int) -> None:
    """Unknown by 3 degrees at the start, it is unknown by as much after a corridor, full of points."""
    core = ground_filter(GroundMsckf(), CAMERA, np.zeros(3))
    yaw = core.state.first_clone + 2
    core.state.covariance[yaw, yaw] = np.radians(3.0) ** 2
    for view in corridor(seed):
        core.step(view)
    assert np.degrees(np.sqrt(core.state.pose_covariance()[2, 2])) == pytest.approx(3.01, abs=0.02)


def test_a_robot_that_touched_something_did_not_go_as_far_as_it_was_told(tmp_path: Path) -> None:
    """Ten steps of 0.1 m as told, then one of 2 cm of 12 told, with and without a pressed bumper."""
    room, ways = paintings(), np.array([*0.1 * np.arange(10), 0.92])
    off_m = {}
    for contact in (False, True):
        odometry = GroundMsckf().build(replace(context(tmp_path), camera=CAMERA))
        for way_m, told_m in zip(ways, [0.0, *[0.1] * 9, 0.12], strict=True):
            seen = observe(CAMERA, se2(-1.2 + way_m, -0.5, 0.0), room, room=FURNISHED)
            ends = contact and way_m == ways[-1]
            motion = odometry.update(replace(seen, command=Twist(told_m / 0.25, 0.0, 0.25), contact=ends))
        off_m[contact] = abs(motion.previous_from_body[0, 3] - 0.02)
    assert off_m[True] < 0.5 * off_m[False] and off_m[True] < 0.02


def test_views_of_a_patrol_are_compared_with_none_of_the_survey(tmp_path: Path) -> None:
    """Something may have been put there since; 0.1 m from the last view of the survey, nothing is known yet."""
    known = []
    for surveyed in (False, True):
        odometry, room = GroundMsckf().build(replace(context(tmp_path), camera=CAMERA)), paintings()
        for k in range(8):
            if surveyed and k == 6:
                odometry.revise()
            motion = odometry.update(observe(CAMERA, se2(-1.2 + 0.1 * k, -0.5, 0.0), room, room=FURNISHED))
            known.append(np.isfinite(motion.scan.ranges_m).any())
    assert known[6:8] == [True, True] and known[14] == np.False_ and known[5] and known[13]


def test_what_is_lost_in_a_step_grows_with_way_and_turn_and_most_on_the_spot() -> None:
    settings = replace(GroundMsckf(), drift_rad_per_rad=0.0, drift_rad_per_m=0.01, drift_m_per_m=0.02, drift_spot=0.1)
    on, arc, spot = (drift(settings, se2(*motion)) for motion in ((0.1, 0, 0), (0.1, 0, 0.2), (0, 0, 0.2)))
    assert on[2, 2] == pytest.approx(0.01**2 * 0.1) and on[0, 0] == pytest.approx(0.02**2 * 0.1)
    assert arc[2, 2] == on[2, 2]
    assert spot[2, 2] == pytest.approx(0.1**2 * 0.2) and spot[0, 0] == 0.0


def test_a_step_is_no_surer_than_its_drift_however_sure_the_filter_becomes(tmp_path: Path) -> None:
    odometry = GroundMsckf().build(replace(context(tmp_path), camera=CAMERA))
    room, turned = paintings(), 0.11
    motions = [odometry.update(observe(CAMERA, se2(0.0, 0.0, turned * k), room, room=FURNISHED)) for k in range(12)]
    assert min(motion.covariance[5, 5] for motion in motions[2:]) > 0.5 * GroundMsckf().drift_spot**2 * turned


def test_a_camera_that_was_carried_off_says_so_though_it_has_new_points(tmp_path: Path) -> None:
    odometry = GroundMsckf().build(replace(context(tmp_path), camera=CAMERA))
    room, poses = paintings(), [(-1.0, -0.5, 0.3)] * 3 + [(0.5, 0.8, 2.6)]
    said = [odometry.update(observe(CAMERA, se2(*pose), room, room=FURNISHED)).status for pose in poses]
    assert said == [Tracking.OK] * 3 + [said[-1]] and said[-1] is not Tracking.OK


def test_a_low_thing_before_a_wall_is_nearer_than_the_wall() -> None:
    slopes, ranges_m = np.linspace(-1.0, 0.5, 16), np.array([1.0, 1.5, 2.5, 4.0])
    feet = np.searchsorted(slopes, -1.0 / ranges_m)
    upright = np.full((4, 16), 10.0)
    for z, foot in enumerate(feet):
        upright[z, :min(foot, feet[1])] = 0.0  # floor as far as the thing's foot
    top = feet[1] + 3
    upright[1, feet[1]:top] = 0.0  # the thing, 1.5 m off, and nothing but the wall behind it above
    upright[3, top:] = 0.0
    for once, nearest in ((1.0, 1), (1e6, 3)):
        costs, pairs = np.zeros(4), np.zeros(4)
        _over(upright, np.ones((4, 16)), feet, ranges_m, slopes, (once, 0.0, 0.1, 0.25), costs, pairs)
        assert np.argmin(costs) == nearest
        assert (pairs == 16.0).all()


def test_a_camera_of_unknown_height_is_refused(tmp_path: Path) -> None:
    given = replace(context(tmp_path), camera=camera_from_fov(160, 120, 57.0, height_m=0.0))
    with pytest.raises(ConfigError, match="camera_mount"):
        GroundMsckf().build(given)


def test_features_are_lifted_on_what_the_scan_measured() -> None:
    level = camera_from_fov(160, 120, 57.0, height_m=1.0)
    pixels = np.array([[level.cx, level.cy], [level.cx, level.cy + 0.5 * level.fy], [5.0, level.cy]], np.float32)
    features = Features(pixels, np.zeros((3, 4), np.float32), np.full((3, 3), np.nan, np.float32))
    scan = Scan(np.linspace(-0.5, 0.5, 5), np.array([np.nan, 3.0, 3.0, 3.0, np.nan]), 5.0)
    points = lift_on_scan(features, level, scan).points
    assert points[0] == pytest.approx([0.0, 0.0, 3.0], abs=1e-5), "straight ahead, on the wall"
    assert points[1] == pytest.approx([0.0, 1.0, 2.0], abs=1e-5), "on the floor 2 m ahead, before the wall"
    assert np.isnan(points[2]).all(), "nothing is known at the edge"


def test_all_pictures_of_a_survey_are_given_up_once_it_is_over() -> None:
    stixels = Stixels(CAMERA, FEW)
    for _ in range(6):
        stixels.add(np.zeros((120, 160, 3), np.uint8))
    stixels.forget(4)
    poses = np.array([[0.1 * k, 0.0, 0.0] for k in range(6)])
    assert [stixels.scan(view, poses) is None for view in range(6)] == [True] * 4 + [False] * 2


def seen(scan: Scan, *, measured: bool) -> Motion:
    return Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK, scan=scan, scan_measured=measured)


def test_the_guard_drives_by_a_measured_scan_and_by_no_believed_one() -> None:
    wall = Scan(np.linspace(-0.5, 0.5, 80), 0.7 / np.cos(np.linspace(-0.5, 0.5, 80)), 5.0)
    ahead = Twist(0.5, 0.0, 1.0)
    for measured, stops in ((True, True), (False, False)):
        guard = Guard(0.25, Pace(), GuardSettings())
        guard.observe(Observation(0, 1.0, CAMERA), seen(wall, measured=measured))
        allowed, _ = guard.allow(ahead)
        way_m = allowed.forward_mps * allowed.duration_s if allowed else 0.0
        assert (way_m < 0.45) == stops


def test_a_patrol_takes_short_steps_and_turns_on_the_spot(tmp_path: Path) -> None:
    settings = turning(MissionSettings(), GroundMsckf().build(replace(context(tmp_path), camera=CAMERA)))
    assert (settings.turn, settings.step_m, settings.turn_step_deg) == ("pivot", 0.125, 6.5)


def test_it_is_an_odometry() -> None:
    check_plugin("odometry", GroundMsckf())
