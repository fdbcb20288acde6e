"""What files of a camera say beside its focal length: the lens under any name, and the scale of depth."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_sources.folders.intrinsics import read_intrinsics
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

K = [[610.5, 0.0, 322.1], [0.0, 611.2, 241.3], [0.0, 0.0, 1.0]]
LENS = [0.1, -0.25, 0.001, -0.0005, 0.02]
ECHO = f"""header:
  frame_id: camera_color_optical_frame
height: 480
width: 640
distortion_model: plumb_bob
d:
- 0.1
- -0.25
- 0.001
- -0.0005
- 0.02
k: {[number for row in K for number in row]}
p: [610.5, 0.0, 322.1, 0.0, 0.0, 611.2, 241.3, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
---
"""  # ros2 topic echo --once /camera/color/camera_info
OPENCV = """%YAML:1.0
---
K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 610.5, 0., 322.1, 0., 611.2, 241.3, 0., 0., 1. ]
dist_coeffs: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, -0.25, 0.001, -0.0005, 0.02 ]
"""


def camera_in(folder, name, text):
    (folder / name).write_text(text if isinstance(text, str) else json.dumps(text))
    return read_intrinsics(folder / name, (640, 480))


@pytest.mark.parametrize("name", ["dist_coeff", "dist_coeffs", "dist", "D", "distCoeffs", "distortion_coeff", "coeffs",
                                  "distortion_coefficients", "distortion"])
@pytest.mark.parametrize("matrix", ["camera_matrix", "K", "mtx"])
def test_a_lens_is_read_under_any_name_that_people_give_it(tmp_path, matrix, name):
    camera = camera_in(tmp_path, "camera.json", {matrix: K, name: [LENS]})
    assert (camera.fx, camera.cy, camera.distortion) == (610.5, 241.3, tuple(LENS))


@pytest.mark.parametrize("text", [ECHO, ECHO.removesuffix("---\n"), 3 * ECHO, OPENCV])
def test_what_ros_echoes_of_a_camera_and_what_opencv_stores_is_read_with_its_lens(tmp_path, text):
    camera = camera_in(tmp_path, "camera.yaml", text)
    assert (camera.fy, camera.cx, camera.distortion) == (611.2, 322.1, tuple(LENS))


def test_opencv_s_fourteen_numbers_are_read_where_only_eight_say_something(tmp_path):
    lens = (0.4, 0.2, 0.001, -0.0005, 0.02, 0.5, 0.1, 0.01)
    assert camera_in(tmp_path, "camera.json", {"K": K, "dist": [*lens, *[0.0] * 6]}).distortion == lens


def test_numbers_of_a_lens_beyond_k3_count_and_a_word_for_a_device_is_no_model(tmp_path):
    plain = {"fx": 610.5, "fy": 611.2, "cx": 322.1, "cy": 241.3, "model": "iPhone 12"}
    assert camera_in(tmp_path, "a.json", plain | {"k1": 0.5, "k4": 0.6}).distortion == (0.5, 0, 0, 0, 0, 0.6, 0, 0)
    assert camera_in(tmp_path, "b.json", plain).distortion == ()
    angles = camera_in(tmp_path, "c.json", plain | {"model": "fisheye", "D": [0.1, 0.02, 0.003, 0.0004]})
    assert len(angles.distortion) == 8


@pytest.mark.parametrize(("plain", "said"), [
    ({"camera_matrix": K, "radial_distortion": [0.1, -0.2]}, "radial_distortion has 2 numbers"),
    ({"camera_matrix": K, "dist_coeffs": ["0,1", "0,2", "0", "0"]}, "dist_coeffs holds '0,1', expected numbers"),
    ({"camera_matrix": K, "dist_coeffs": 14 * [0.01]}, "14 numbers of a lens"),
    ({"cam0": {"camera_model": "omni", "intrinsics": [0.8, 600.0, 600.0, 320.0, 240.0]}}, "omni"),
    ({"cam0": {"intrinsics": [0.8, 600.0, 600.0, 320.0, 240.0]}}, "intrinsics has 5 numbers"),
])
def test_a_lens_that_is_not_understood_is_refused_not_left_out(tmp_path, plain, said):
    with pytest.raises(ConfigError, match=said):
        camera_in(tmp_path, "camera.json", plain)


def recorded(folder, steps, *files):
    """Three views of a wall at 2 m, depth of so many steps in a metre, numbered and as TUM's lists."""
    for k in range(3):
        for name, kind in (("rgb", np.uint8), ("depth", np.uint16)):
            (folder / name).mkdir(exist_ok=True)
            cv2.imwrite(str(folder / name / f"{k}.png"), np.full((48, 64), 2 * steps if name == "depth" else 90, kind))
    for name, text in files:
        (folder / name).write_text(text if isinstance(text, str) else json.dumps(text))


def depth_of(folder, **settings):
    capture, _ = next(open_recording(Replay(path=str(folder), **settings)).views)
    return float(np.median(capture.depth))


SMALL = {"width": 64, "height": 48, "fx": 50.0, "fy": 50.0, "cx": 31.5, "cy": 23.5}


@pytest.mark.parametrize(("steps", "told"), [
    (4000, {"intrinsic_matrix": [50, 0, 0, 0, 50, 0, 31.5, 23.5, 1], "width": 64, "height": 48, "depth_scale": 4000.0}),
    (4000, SMALL | {"depth_scale": 0.00025}),  # metres a step, RealSense
    (10000, SMALL | {"depth_scale": 0.1}), (1000, SMALL | {"depth_scale": 1.0}),  # millimetres a step, BOP
    (6553, {"cam": SMALL | {"png_depth_scale": 6553.0}}),  # NICE-SLAM
    (1000, SMALL),
])
def test_the_scale_of_depth_is_that_of_the_camera_s_file(tmp_path, caplog, steps, told):
    recorded(tmp_path, steps, ("camera.json", told))
    assert depth_of(tmp_path) == pytest.approx(2.0) == depth_of(tmp_path, camera=str(tmp_path / "camera.json"))
    assert ("steps of depth in a metre" in caplog.text) == (told is not SMALL)
    assert depth_of(tmp_path, depth_scale=float(steps) / 2) == pytest.approx(4.0)  # what is typed wins


@pytest.mark.parametrize("listed", [False, True])
def test_the_depth_factor_of_orb_slam_s_file_counts(tmp_path, listed):
    """2 m in 400 steps a metre: of TUM's lists 5000 were taken, of numbered images 1000."""
    lists = [(f"{name}.txt", "".join(f"{0.1 * k} {name}/{k}.png\n" for k in range(3))) for name in ("rgb", "depth")]
    own = "".join(f"Camera.{name}: {value}\n" for name, value in SMALL.items())
    recorded(tmp_path, 400, ("mine.yaml", f"%YAML:1.0\n{own}DepthMapFactor: 400.0\n"), *(lists if listed else ()))
    assert depth_of(tmp_path, camera=str(tmp_path / "mine.yaml")) == pytest.approx(2.0)


def test_depth_in_metres_stays_so_whatever_scale_its_camera_tells_of_images(tmp_path):
    recorded(tmp_path, 1000, ("camera.json", SMALL | {"depth_scale": 1000.0}))
    for k in range(3):
        (tmp_path / "depth" / f"{k}.png").unlink()
        np.save(tmp_path / "depth" / f"{k}.npy", np.full((48, 64), 2.0, np.float32))
    assert depth_of(tmp_path) == 2.0


@pytest.mark.parametrize("typed", [{"laser_fov_deg": 270.0}, {"max_laser_m": 5.0}, {"phase": "all"},
                                   {"wheel_topic": "/odom"}, {"depth_topic": "/depth"}, {"scan_topic": "/scan"}])
def test_what_a_recording_has_no_use_for_is_refused_not_ignored(tmp_path, typed):
    recorded(tmp_path, 1000, ("camera.json", SMALL))
    with pytest.raises(ConfigError, match=rf"source\.{next(iter(typed))}: a recording of the kind frames has no use for it"):
        depth_of(tmp_path, **typed)
    assert depth_of(tmp_path, scan_topic="none", wheel_topic="none") == 2.0  # it holds none


def test_a_laser_log_goes_without_its_wheels_and_has_no_scale_of_depth(tmp_path):
    """The advice for wheels that count right turns as left."""
    log = tmp_path / "a.log"
    log.write_text("".join(f"FLASER 3 1 2 3 {0.1 * k} 0 0 {0.1 * k} 0 0 {k} host {k}\n" for k in range(4)))
    recording = open_recording(Replay(path=str(log), wheel_topic="none"))
    assert [capture.travel for capture, _ in recording.views] == [None] * 4 and "wheel" not in recording.provides
    assert "wheel" in open_recording(Replay(path=str(log))).provides
    with pytest.raises(ConfigError, match=r"source\.depth_scale: a recording of the kind carmen has no use for it"):
        open_recording(Replay(path=str(log), depth_scale=1000.0))
