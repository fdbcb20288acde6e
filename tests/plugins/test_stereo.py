"""Two cameras: depth is focal length times baseline over disparity, unknown where nothing matches; refusals; a run."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import rhs
from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import Camera, exp_so3, inverse, se2, se3
from rhs.api.records import Capture
from rhs.api.stereo import camera_numbers, camera_of
from rhs.testing.room import CAMERA, paintings, see
from rhs_sensors.stereo import Stereo
from rhs_sensors.stereo_coarse import CoarsePair
from rhs_sensors.stereo_matching import StereoPair

TURNED = se3(exp_so3(np.array([0.01, -0.02, 0.015])), np.array([0.2, 0.004, -0.003]))  # left_from_right of a real rig
LENS = (-0.2, 0.05, 0.001, -0.0005, 0.0)


def beside(left: Camera, left_from_right: np.ndarray, **changes) -> Camera:
    return replace(left, body_from_camera=left.body_from_camera @ left_from_right, **changes)


def right_by(metres: float) -> np.ndarray:
    return se3(np.eye(3), np.array([metres, 0.0, 0.0]))


def speckled(shape, seed=0):
    grey = cv2.GaussianBlur(np.random.default_rng(seed).integers(0, 255, shape).astype(np.uint8), (0, 0), 1.0)
    return np.repeat(cv2.normalize(grey, None, 0, 255, cv2.NORM_MINMAX)[:, :, None], 3, axis=2)


def test_depth_is_focal_length_times_baseline_over_disparity():
    """300 px and 0.1 m: what moves by 10 px is 3 m away. The ten columns that the right camera does not see are unknown."""
    left = Camera(160, 120, 300.0, 300.0, 79.5, 59.5)
    picture = speckled((120, 200))
    pair = StereoPair(left, beside(left, right_by(0.1)), Stereo())
    depth = pair.depth(picture[:, 10:170], picture[:, 20:180])
    assert pair.focal_m_px == pytest.approx(30.0) and pair.max_range_m == pytest.approx(10.0)  # 30 m px / (0.3 px / 0.1)
    assert np.isnan(depth[:, :10]).all()
    known = np.isfinite(depth[:, 12:-4])
    assert known.mean() > 0.95
    np.testing.assert_allclose(depth[:, 12:-4][known], 3.0, rtol=0.02)  # a fifth of a pixel


def test_principal_points_that_differ_shift_the_disparity():
    left = Camera(160, 120, 300.0, 300.0, 79.5, 59.5)
    picture = speckled((120, 200))
    pair = StereoPair(left, beside(left, right_by(0.1), cx=84.5), Stereo())  # what moves by 5 px has a disparity of 10
    depth = pair.depth(picture[:, 10:170], picture[:, 15:175])
    assert np.nanmedian(depth) == pytest.approx(3.0, rel=0.01)


def test_a_wall_without_texture_has_no_depth():
    left = Camera(160, 120, 300.0, 300.0, 79.5, 59.5)
    pair = StereoPair(left, beside(left, right_by(0.1)), Stereo())
    noise = np.random.default_rng(0).normal(128, 1.3, (2, 120, 160, 1)).round().astype(np.uint8).repeat(3, axis=3)
    assert np.isnan(pair.depth(noise[0], noise[1])).mean() > 0.999


@pytest.mark.parametrize(("left", "right"), [
    (CAMERA, beside(CAMERA, right_by(0.12))),
    (replace(CAMERA, distortion=LENS, skew=0.5), beside(CAMERA, TURNED, distortion=(-0.15, 0.03, 0.0, 0.0, 0.0))),
])
def test_depth_of_a_room_belongs_to_the_pixels_of_the_left_image(left, right):
    """Cameras turned by a degree against each other behind lenses that bend: the depth is still along the left axis."""
    pose = se2(1.0, 1.6, 0.4)
    seen, there = see(left, pose, paintings()), see(right, pose, paintings()).image
    pair = StereoPair(left, right, Stereo())
    depth = pair.depth(seen.image, there)
    off_px = pair.focal_m_px * (1.0 / depth - 1.0 / seen.depth)[np.isfinite(depth)]
    assert len(off_px) > 0.5 * depth.size
    assert abs(np.median(off_px)) < 0.05 and np.mean(np.abs(off_px) < 3 * Stereo().disparity_sigma_px) > 0.99


def test_a_camera_survives_as_numbers():
    camera = replace(beside(CAMERA, TURNED), distortion=LENS, skew=0.25)
    again = camera_of(camera_numbers(camera))
    np.testing.assert_array_equal(again.body_from_camera, camera.body_from_camera)
    assert again == camera and hash(again) == hash(camera) and again != beside(camera, TURNED) and again != "a camera"
    with pytest.raises(ValueError, match="expected"):
        camera_of(np.zeros(5))


@pytest.mark.parametrize(("right", "words"), [
    (beside(CAMERA, right_by(-0.1)), "expected a place to its right"),
    (beside(CAMERA, se3(np.eye(3), np.array([0.0, 0.1, 0.0]))), "expected a place to its right"),
    (beside(CAMERA, right_by(0.1), width=10), "expected one size"),
])
def test_pairs_that_are_none_are_refused_in_one_line(right, words):
    with pytest.raises(ConfigError, match=words) as error:
        StereoPair(CAMERA, right, Stereo())
    assert "\n" not in str(error.value)


def test_a_capture_of_one_camera_is_refused():
    sensor = Stereo().build(SimpleNamespace(rng=np.random.default_rng(0), camera=CAMERA))
    with pytest.raises(ContractError, match="has no right_image; sensor=stereo needs a source with two cameras"):
        sensor.sense(Capture(0, 0.0, np.zeros((CAMERA.height, CAMERA.width, 3), np.uint8)))


@pytest.mark.parametrize("words", [
    ["source=simulator", "world=square_small", "source.baseline_m=0"],
    ["source=tube"],
])
def test_a_source_with_one_camera_is_refused_before_anything_runs(tmp_path, words):
    with pytest.raises(rhs.RhsError, match="sensor=stereo needs right_image, which source=") as error:
        rhs.run(["task=survey", "sensor=stereo", f"output={tmp_path / 'run'}", *words], quiet=True)
    assert "\n" not in str(error.value)


def euroc(folder, poses):
    """A made EuRoC recording of the room: both lenses bend, cam1 sits 12 cm beside cam0 and turned."""
    left = replace(CAMERA, distortion=LENS[:4])
    turned = se3(TURNED[:3, :3], np.array([0.12, 0.001, 0.002]))
    right = beside(left, turned)
    for name, camera, place in (("cam0", left, np.eye(4)), ("cam1", right, turned)):
        data = folder / "mav0" / name / "data"
        data.mkdir(parents=True)
        lines = []
        for k, pose in enumerate(poses):
            file = f"{10**18 + k * 10**8}.png"
            cv2.imwrite(str(data / file), see(camera, pose, paintings()).image)
            lines.append(f"{file[:-4]},{file}\n")
        (data.parent / "data.csv").write_text("#timestamp,filename\n" + "".join(lines))
        (data.parent / "sensor.yaml").write_text(
            f"T_BS:\n  cols: 4\n  rows: 4\n  data: {place.ravel().tolist()}\nresolution: [{camera.width}, {camera.height}]\n"
            f"intrinsics: [{camera.fx}, {camera.fy}, {camera.cx}, {camera.cy}]\ndistortion_model: radial-tangential\n"
            f"distortion_coefficients: {list(camera.distortion)}\n")
    return folder / "mav0"


def test_a_euroc_recording_runs_from_end_to_end(tmp_path):
    """Six views, 0.25 m ahead and 10 degrees to the left: the way comes out in metres though no depth was recorded."""
    poses = [se2(1.0 + 0.05 * k, 1.5, 0.2 + np.radians(2 * k)) for k in range(6)]
    eyes = [inverse(poses[0] @ CAMERA.body_from_camera) @ pose @ CAMERA.body_from_camera for pose in poses]
    path = euroc(tmp_path / "made", poses)
    truth = tmp_path / "truth.txt"
    quaternion = [cv2.Rodrigues(eye[:3, :3])[0].ravel() for eye in eyes]
    lines = []
    for k, (eye, v) in enumerate(zip(eyes, quaternion, strict=True)):
        angle = np.linalg.norm(v)
        q = np.append(v / angle * np.sin(angle / 2), np.cos(angle / 2)) if angle else np.array([0, 0, 0, 1.0])
        lines.append(f"{10**9 + 0.1 * k} " + " ".join(f"{n:.9f}" for n in (*eye[:3, 3], *q)) + "\n")
    truth.write_text("".join(lines))
    row = rhs.run(["task=survey", "source=replay", f"source.path={path}", "sensor=stereo", f"source.truth={truth}",
                   "loop_closer=none", f"output={tmp_path / 'run'}", "pictures=off"], quiet=True)
    assert row["status"] == "ok" and row["views"] == 6 and row["tracked_share"] == 1.0
    assert row["ate_rmse_m"] < 0.01


def faint(left, right_by_px, noise, seed=0):
    """Two images of a board 200 px wide with blotches of a grey level, the right one further along, each with its noise."""
    rng = np.random.default_rng(seed)
    board = cv2.GaussianBlur(rng.standard_normal((left.height, left.width + right_by_px)), (0, 0), 8.0)
    board *= 3.0 / board.std()
    cuts = board[:, :left.width], board[:, right_by_px:]
    return [np.clip(128.0 + cut[..., None] + rng.normal(0.0, noise, (*cut.shape, 3)), 0, 255).round().astype(np.uint8)
            for cut in cuts]


def test_a_faint_board_has_a_depth_in_smaller_images():
    left = Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
    right = beside(left, right_by(0.1))
    images = faint(left, 32, noise=2.0)
    assert np.isnan(StereoPair(left, right, Stereo()).depth(*images)).mean() > 0.9
    coarse, known = CoarsePair(left, right, Stereo()), np.zeros((240, 320), bool)
    depth = coarse.depth(*images, known)
    assert depth.shape == (240, 320) and np.isfinite(depth[:, 100:]).mean() > 0.5
    assert np.nanmedian(depth) == pytest.approx(30.0 / 32.0, rel=0.02)
    known[100:110, 200:210] = True
    assert np.isnan(coarse.depth(*images, known)[100:110, 190:220]).all(), "beside what is known it is not asked"


@pytest.mark.parametrize("sigma", [2.0, 5.0, 8.0])
def test_noise_alone_has_none_there_either(sigma):
    left = Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
    rng = np.random.default_rng(0)
    noise = rng.normal(128, sigma, (2, 240, 320, 3)).round().astype(np.uint8)
    coarse = CoarsePair(left, beside(left, right_by(0.1)), Stereo())
    assert np.isnan(coarse.depth(*noise, np.zeros((240, 320), bool))).mean() > 0.999
