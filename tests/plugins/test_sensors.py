"""The sensors rgbd and mono: noise of the stated size, a scan that says how far the walls are, refusals."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import erf, erfc

from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import Camera, camera_from_fov, exp_so3, se3
from rhs.api.records import Capture
from rhs.api.settings import make
from rhs_sensors.degrade import Encoders
from rhs_sensors.mono import Mono
from rhs_sensors.noise import chosen, normal
from rhs_sensors.rgbd import Rgbd

CAMERA = camera_from_fov(320, 240, 57.0, height_m=0.6, forward_m=0.1)


def build(settings, seed=0, camera=CAMERA):
    return settings.build(SimpleNamespace(rng=np.random.default_rng(seed), camera=camera))


def wall(depth_m: float, index: int = 0, travel=None, camera=CAMERA) -> Capture:
    shape = (camera.height, camera.width)
    image = np.full((*shape, 3), 128, np.uint8)
    return Capture(index, 0.1 * index, image, np.full(shape, depth_m, np.float32), travel=travel)


@pytest.mark.parametrize("depth_m", [1.0, 3.0, 6.0])
def test_depth_noise_has_the_stated_size(depth_m):
    """sigma_z = 0.0012 + 0.0019 (z - 0.4)^2, no bias; 76,800 pixels fix the standard deviation to 1 %."""
    error = build(Rgbd(disparity_step_px=0.0)).sense(wall(depth_m)).depth - depth_m
    expected = 0.0012 + 0.0019 * (depth_m - 0.4) ** 2
    assert np.std(error) == pytest.approx(expected, rel=0.02)
    assert abs(np.mean(error)) < 5 * expected / np.sqrt(error.size)


def test_depth_comes_in_steps_of_disparity():
    """At 4 m one step of an eighth of a pixel is 4^2 / 43.5 / 8 = 4.6 cm."""
    depth = build(Rgbd()).sense(wall(4.0)).depth
    steps = 43.5 / depth / 0.125
    assert np.abs(steps - np.rint(steps)).max() < 1e-4
    assert np.diff(np.unique(depth)).min() == pytest.approx(0.046, rel=0.1)


def test_a_depth_camera_worse_than_told_is_noticed_and_averaged():
    """Sixteen times a Kinect's noise: after averaging no more than a Kinect's is left, in the scan too; one as told is left
    alone."""
    told = 0.0012 + 0.0019 * (3.0 - 0.4) ** 2
    seen = build(Rgbd(depth_noise=16)).sense(wall(3.0))
    assert seen.depth_times < 1.3 and np.nanstd(seen.depth - 3.0) < 1.1 * told
    assert np.nanstd(seen.scan.ranges_m * np.cos(seen.scan.bearings_rad) - 2.9 - 0.1 * np.cos(seen.scan.bearings_rad)) < 0.1
    as_told = build(Rgbd()).sense(wall(3.0))
    assert as_told.depth_times == 1.0 and np.std(as_told.depth - 3.0) == pytest.approx(told, rel=0.2)
    worst = build(Rgbd(depth_noise=64)).sense(wall(3.0))
    assert worst.depth_times == pytest.approx(64 / 25, rel=0.3)


@pytest.mark.parametrize("roll_deg, pitch_deg", [(4.0, 0.0), (0.0, 5.0), (-3.0, -4.0)])
def test_the_scan_of_a_camera_that_sways_is_that_of_one_that_stands_firm(roll_deg, pitch_deg):
    """A corridor 3 m wide with a wall across it at 7 m: the middle beams of a camera pitched down by 5 degrees, taken for
    level, would meet the wall too low, and the camera, 0.9 m up, is 8 cm further ahead than told."""
    camera = camera_from_fov(320, 240, 57.0, height_m=0.9, pitch_deg=15.0)
    tilt = se3(exp_so3(np.radians([roll_deg, pitch_deg, 0.0])), np.zeros(3)) @ camera.body_from_camera
    v, u = np.indices((240, 320))
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float)) @ tilt[:3, :3].T
    with np.errstate(divide="ignore"):
        ways = [(at - tilt[axis, 3]) / rays[:, axis] for axis, at in ((2, 0.0), (0, 7.0), (1, 1.5), (1, -1.5))]
    depth = np.min([np.where(way > 0, way, np.inf) for way in ways], axis=0).reshape(240, 320).astype(np.float32)
    seen = build(Rgbd(noise=False), camera=camera).sense(Capture(0, 0.0, np.zeros((240, 320, 3), np.uint8), depth)).scan
    known = np.isfinite(seen.ranges_m)
    x, y = (np.outer((1, 0), np.cos(seen.bearings_rad)) + np.outer((0, 1), np.sin(seen.bearings_rad))) * seen.ranges_m
    x, y = x + seen.origin_xy_m[0], y + seen.origin_xy_m[1]
    off = np.minimum(np.abs(x - 7.0), np.abs(np.abs(y) - 1.5))
    assert known.mean() > 0.95 and np.max(off[known]) < 0.03


def test_depth_outside_the_range_is_unknown():
    for depth_m in (0.2, 20.0, np.nan, np.inf, 0.0, -1.0):
        observation = build(Rgbd()).sense(wall(depth_m))
        assert np.isnan(observation.depth).all()
        assert np.isnan(observation.scan.ranges_m).all()


def test_image_noise_has_the_stated_size():
    for settings in (Rgbd(image_sigma=5.0), Mono(image_sigma=5.0)):
        error = build(settings).sense(wall(2.0)).image.astype(float) - 128.0
        assert np.std(error) == pytest.approx(np.hypot(5.0, np.sqrt(1 / 12)), rel=0.02)


def test_without_noise_everything_within_range_passes_unchanged():
    capture = wall(2.0, travel=np.array([0.2, 0.0, 0.1]))
    observation = build(Rgbd(noise=False)).sense(capture)
    assert np.array_equal(observation.image, capture.image)
    assert np.array_equal(observation.depth, capture.depth)
    assert np.array_equal(observation.wheel, capture.travel)


def test_arrays_are_read_only_and_the_capture_is_untouched():
    capture = wall(2.0, travel=np.array([0.2, 0.0, 0.1]))
    observation = build(Rgbd()).sense(capture)
    for array in (observation.image, observation.depth, observation.wheel, observation.scan.ranges_m):
        assert not array.flags.writeable
    assert (capture.depth == 2.0).all()
    assert capture.image.flags.writeable


def test_what_stands_below_the_scan_is_reported_beside_it_where_the_height_of_the_camera_is_known():
    """Depth 3 m everywhere from 0.6 m up: the wall, in both scans. A camera at height 0 is one of nobody knows where."""
    seen = build(Rgbd(noise=False)).sense(wall(3.0)).obstacle
    assert len(seen.bearings_rad) == 160 and not seen.ranges_m.flags.writeable
    assert seen.ranges_m * np.cos(seen.bearings_rad) == pytest.approx(3.0, abs=0.02)
    nowhere = camera_from_fov(320, 240, 57.0, height_m=0.0)
    assert build(Rgbd(), camera=nowhere).sense(wall(3.0, camera=nowhere)).obstacle is None
    assert build(Mono()).sense(wall(3.0)).obstacle is None


def test_scan_of_a_flat_wall_ahead():
    """A wall 3 m ahead of the camera is 3 / cos(bearing) metres away along each beam; half the view is 28.5."""
    scan = build(Rgbd(noise=False)).sense(wall(3.0)).scan
    assert len(scan.bearings_rad) == 320
    assert (np.diff(scan.bearings_rad) > 0).all()
    assert np.degrees(scan.bearings_rad[-1]) == pytest.approx(28.5, abs=0.2)
    assert np.allclose(scan.ranges_m, 3.0 / np.cos(scan.bearings_rad))
    assert scan.origin_xy_m == (pytest.approx(0.1), 0.0)


def test_an_object_on_the_left_of_the_image_is_on_the_left_of_the_robot():
    capture = wall(3.0)
    capture.depth[:, :100] = 1.0
    scan = build(Rgbd(noise=False)).sense(capture).scan
    assert (scan.ranges_m[scan.bearings_rad > 0.3] < 1.5).all()
    assert (scan.ranges_m[scan.bearings_rad < 0.0] > 2.5).all()


def test_beams_is_the_number_of_beams():
    assert len(build(Rgbd(beams=64)).sense(wall(3.0)).scan.ranges_m) == 64


def test_scan_of_a_camera_that_looks_down_is_still_level():
    """Tilted down by 10 degrees, a wall 3 m ahead of the camera: level rays meet it at 3 / cos(bearing)."""
    tilt = exp_so3(np.array([0.0, np.radians(10.0), 0.0]))  # about the body's y axis, nose down
    extrinsics = se3(tilt @ CAMERA.body_from_camera[:3, :3], CAMERA.body_from_camera[:3, 3])
    camera = Camera(320, 240, CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, body_from_camera=extrinsics)
    v, u = np.mgrid[0:240, 0:320]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    forward = (rays @ extrinsics[:3, :3].T)[:, 0]
    capture = Capture(0, 0.0, np.zeros((240, 320, 3), np.uint8), (3.0 / forward).reshape(240, 320).astype(np.float32))
    scan = build(Rgbd(noise=False), camera=camera).sense(capture).scan
    assert np.allclose(scan.ranges_m, 3.0 / np.cos(scan.bearings_rad), atol=0.01)


def test_encoders_have_a_scale_error_per_run_and_noise_per_reading():
    travel, settings = np.array([0.2, 0.0, 0.1]), Mono()
    encoders = [Encoders(settings, np.random.default_rng(seed)) for seed in range(60)]
    runs = np.array([[one.read(travel) / [0.2, 1.0, 0.1] for _ in range(10)] for one in encoders])
    assert np.std(runs[:, :, 0].mean(axis=1)) == pytest.approx(np.hypot(0.02, 0.02 / np.sqrt(10)), rel=0.3)
    assert np.std(runs[:, :, 0] - runs[:, :, 0].mean(axis=1, keepdims=True)) == pytest.approx(0.02, rel=0.15)
    assert np.std(runs[:, :, 2] - runs[:, :, 2].mean(axis=1, keepdims=True)) == pytest.approx(0.03, rel=0.15)


def test_encoders_that_always_slip_count_too_much():
    settings = Mono(wheel_slip_chance=1.0, wheel_slip_share=0.5, wheel_scale_sigma=0.0, wheel_distance_share=0.0)
    assert build(settings).sense(wall(2.0, travel=np.array([0.2, 0.0, 0.0]))).wheel[0] == pytest.approx(0.3)


def test_mono_takes_depth_and_scan_away():
    observation = build(Mono()).sense(wall(2.0))
    assert observation.depth is None
    assert observation.scan is None
    assert observation.wheel is None


def test_same_seed_same_view_another_seed_another():
    views = [build(Rgbd(), seed).sense(wall(2.0)) for seed in (1, 1, 2)]
    assert np.array_equal(views[0].depth, views[1].depth)
    assert np.array_equal(views[0].image, views[1].image)
    assert not np.array_equal(views[0].depth, views[2].depth)


def test_one_noise_does_not_move_the_numbers_of_another():
    noisy, clean = (build(Rgbd(image_sigma=sigma)).sense(wall(2.0)) for sigma in (2.0, 0.0))
    assert np.array_equal(noisy.depth, clean.depth)


def test_depth_of_another_size_is_refused_naming_both():
    image = np.zeros((240, 320, 3), np.uint8)
    with pytest.raises(ContractError, match="depth is 160x120, image is 320x240"):
        build(Rgbd()).sense(Capture(0, 0.0, image, np.ones((120, 160), np.float32)))
    with pytest.raises(ContractError, match="has no depth"):
        build(Rgbd()).sense(Capture(0, 0.0, image))
    with pytest.raises(ContractError, match="has no image"):
        build(Mono()).sense(Capture(0, 0.0))
    with pytest.raises(ContractError, match="image is 100x50, the camera 320x240"):
        build(Mono()).sense(Capture(0, 0.0, np.zeros((50, 100, 3), np.uint8)))


@pytest.mark.parametrize("wrong", [{"max_range_m": 0.05}, {"image_sigma": float("nan")}, {"scan_rows": 2},
                                   {"beams": -1}, {"min_range_m": float("inf")}, {"wheel_slip_chance": 1.5}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(ConfigError, match=rf"^sensor\.{next(iter(wrong))}="):
        make(Rgbd, wrong, "sensor")


def test_noise_is_normal_out_to_four_deviations():
    """Of ten million draws the share beyond each of 0.5 to 4 deviations is the normal distribution's, on both sides; mean
    and deviation are 0 and 1."""
    drawn = normal()[chosen(np.random.default_rng(3), 10_000_000)].astype(float)
    assert abs(drawn.mean()) < 4 / np.sqrt(drawn.size) and drawn.std() == pytest.approx(1.0, abs=4 / np.sqrt(2 * drawn.size))
    for beyond in np.arange(0.5, 4.01, 0.5):
        tail = 0.5 * erfc(beyond / np.sqrt(2.0))
        for side in (drawn, -drawn):
            assert (side > beyond).mean() == pytest.approx(tail, abs=4 * np.sqrt(tail / drawn.size) + 1 / 65_536)


def test_noise_of_pixels_channels_views_and_depth_is_independent():
    """No two of a pixel's channels, neighbours, the same pixel of the next view, its depth go together beyond chance."""
    sensor = build(Rgbd(disparity_step_px=0.0, image_sigma=5.0))
    first, second = (sensor.sense(wall(2.0, index)) for index in range(2))
    image, depth = first.image.astype(float), first.depth
    red, green, blue = np.moveaxis(image, 2, 0)
    pairs = [(red, green), (green, blue), (red, blue), (image, second.image), (red, depth), (depth, second.depth),
             (image[:, 1:], image[:, :-1]), (image[1:], image[:-1]), (depth[:, 1:], depth[:, :-1]), (depth[1:], depth[:-1])]
    for a, b in pairs:
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 4.5 / np.sqrt(a.size)


@pytest.mark.parametrize("grey, sigma", [(128, 2.0), (1, 2.0), (254, 3.0), (128, 0.3)])
def test_a_noisy_picture_is_the_normal_distribution_rounded_and_cut_off_at_black_and_white(grey, sigma):
    """The share of each grey level, of 230,400, is the distribution's between half a level below and above."""
    capture = wall(2.0)
    capture.image[:] = grey
    seen = build(Rgbd(image_sigma=sigma)).sense(capture).image
    edges = np.concatenate([[-np.inf], np.arange(255) + 0.5, [np.inf]])
    share = np.diff(0.5 * (1.0 + erf((edges - grey) / (sigma * np.sqrt(2.0)))))
    counted = np.bincount(seen.ravel(), minlength=256) / seen.size
    assert np.abs(counted - share).max() < 5 * 0.5 / np.sqrt(seen.size)
