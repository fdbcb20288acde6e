"""Two cameras in a bag: which they are, and where the second sits, by CameraInfo or tf."""

from __future__ import annotations

import numpy as np
import pytest
from bags import HEIGHT, KINDS, WIDTH, BagFile, picture
from scipy.spatial.transform import Rotation

from rhs.api.errors import ConfigError
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_of
from rhs_sources.replay_config import Replay

BASELINE_M = 0.12
EYES = ("left", "right")


def views(path, **settings):
    source = Replay(path=str(path), **{"stereo": True, **settings}).build(None)
    seen = []
    while (capture := source.lead()) is not None:
        seen.append(capture)
    source.close()
    return source, seen


def told(bag, eye, shift_m, turn=None, f=50.0):
    """The CameraInfo of an eye whose axes `turn` turns into those of the rectified pair."""
    names = {"D": np.zeros(5), "K": np.array([f, 0, 31.5, 0, f, 23.5, 0, 0, 1.0]),
             "R": (np.eye(3) if turn is None else turn).ravel(),
             "P": np.array([40.0, 0, 31.5, -40.0 * shift_m, 0, 40.0, 23.5, 0, 0, 0, 1.0, 0])}
    names = names if bag.ros1 else {name.lower(): value for name, value in names.items()}
    roi = bag.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return bag.make("sensor_msgs/msg/CameraInfo", header=bag.header(1.0, eye), height=HEIGHT, width=WIDTH, binning_x=0,
                    distortion_model="plumb_bob", binning_y=0, roi=roi, **names)


def pair(folder, kind="ros2_mcap", *, name="image_raw", baseline_m=BASELINE_M, turns=(None, None), infos=EYES, more=None):
    with BagFile(folder, kind) as bag:
        for eye, shift_m, turn in zip(EYES, (0.0, baseline_m), turns, strict=True):
            if eye in infos:
                bag.put(f"/stereo/{eye}/camera_info", 1.0, told(bag, eye, shift_m, turn))
        if more:
            more(bag)
        for k in range(3):
            for eye in EYES:
                bag.image(f"/stereo/{eye}/{name}", 1.0 + 0.1 * k, picture(k + 100 * (eye == "right")), "rgb8", eye)
    return bag.path


def left_from_right(source, capture):
    right = camera_of(capture.extras[RIGHT_CAMERA])
    return np.linalg.inv(source.camera.body_from_camera) @ right.body_from_camera, right


@pytest.mark.parametrize("kind", KINDS)
def test_a_rectified_pair_stands_apart_by_what_its_projections_say(tmp_path, kind):
    source, seen = views(pair(tmp_path, kind, name="image_rect"))
    assert {RIGHT_IMAGE, RIGHT_CAMERA} <= source.provides and len(seen) == 3
    place, right = left_from_right(source, seen[0])
    np.testing.assert_allclose(place, [[1, 0, 0, BASELINE_M], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]], atol=1e-9)
    assert right.fx == source.camera.fx == 40.0  # of P: the lens was undone
    assert [int(one.image[0, 0, 0]) for one in seen] == [50, 51, 52]
    assert [int(one.extras[RIGHT_IMAGE][0, 0, 0]) for one in seen] == [150, 151, 152]


def test_raw_images_are_turned_as_their_rectification_says(tmp_path):
    turns = [Rotation.from_euler("xyz", angles).as_matrix() for angles in ([0.02, 0.05, -0.01], [-0.01, -0.03, 0.02])]
    source, seen = views(pair(tmp_path, turns=turns))
    place, right = left_from_right(source, seen[0])
    np.testing.assert_allclose(place[:3, :3], turns[0].T @ turns[1], atol=1e-9)
    np.testing.assert_allclose(place[:3, 3], turns[0].T @ [BASELINE_M, 0, 0], atol=1e-9)
    assert right.fx == 50.0  # of K


def test_where_projections_say_no_baseline_tf_does_and_without_either_it_is_refused(tmp_path):
    def joined(bag):
        bag.transform("/tf_static", 1.0, "left", "right", 0.3)

    source, seen = views(pair(tmp_path, baseline_m=0.0, more=joined))
    place, _ = left_from_right(source, seen[0])
    np.testing.assert_allclose(place[:3, 3], [0.3, 0, 0], atol=1e-9)
    (tmp_path / "b").mkdir()
    with pytest.raises(ConfigError, match=r"P\[3\] of its CameraInfo is 0 and tf does not join left and right;") as caught:
        views(pair(tmp_path / "b", baseline_m=0.0))
    assert "\n" not in str(caught.value) and str(caught.value).endswith("type sensor=mono for the first camera alone")


def test_a_pair_without_the_second_cameras_info_or_without_a_second_camera_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="no CameraInfo says which camera /stereo/right/image_raw is; record it"):
        views(pair(tmp_path, infos=("left",)))
    with BagFile(tmp_path, "ros1") as bag:
        bag.image("/camera/image", 1.0, picture(), "rgb8")
    with pytest.raises(ConfigError, match=r"no two cameras named alike .* type source\.color_topic=LEFT source"):
        views(bag.path)


def test_cameras_of_any_names_are_a_pair_when_they_are_typed(tmp_path):
    with BagFile(tmp_path, "ros2_mcap") as bag:
        for name, shift_m in (("port", 0.0), ("starboard", 0.2)):
            bag.put(f"/{name}/camera_info", 1.0, told(bag, name, shift_m))
            bag.image(f"/{name}/image_rect", 1.0, picture(), "rgb8", name)
    source, seen = views(bag.path, color_topic="/port/image_rect", right_topic="/starboard/image_rect")
    assert left_from_right(source, seen[0])[0][0, 3] == pytest.approx(0.2)
    with pytest.raises(ConfigError, match=r"source\.right_topic=/starbord/image_rect; did you mean /starboard/image_rect"):
        views(bag.path, color_topic="/port/image_rect", right_topic="/starbord/image_rect")


def test_a_bag_without_camera_info_takes_both_cameras_of_kalibrs_chain(tmp_path):
    """As EuRoC's and TUM VI's bags: /cam0/image_raw, /cam1/image_raw and nothing that says which cameras they are."""
    with BagFile(tmp_path, "ros1") as bag:
        for name in ("cam0", "cam1"):
            bag.image(f"/{name}/image_raw", 1.0, picture(), "rgb8", name)
    text = "".join(f"cam{k}:\n  camera_model: pinhole\n  distortion_model: radtan\n  distortion_coeffs: [0.1, 0, 0, 0]\n"
                   f"  intrinsics: [{50 + k}, 50, 31.5, 23.5]\n  resolution: [{WIDTH}, {HEIGHT}]\n" for k in range(2))
    chain = tmp_path / "camchain.yaml"
    chain.write_text(text + "  T_cn_cnm1:\n  - [1.0, 0.0, 0.0, -0.11]\n  - [0.0, 1.0, 0.0, 0.0]\n  - [0.0, 0.0, 1.0, 0.0]\n"
                     "  - [0.0, 0.0, 0.0, 1.0]\n")
    source, seen = views(bag.path, camera=str(chain))
    place, right = left_from_right(source, seen[0])
    assert (source.camera.fx, right.fx, right.distortion[0]) == (50.0, 51.0, 0.1) and place[0, 3] == pytest.approx(0.11)
    chain.write_text(text + "  T_cn_cnm1: [1, 2, 3]\n")
    with pytest.raises(ConfigError, match=r"camchain\.yaml: its cam1 cannot be read .* expected Kalibr's camchain\.yaml"):
        views(bag.path, camera=str(chain))
    with pytest.raises(ConfigError, match="holds no camera intrinsics; type source.camera="):
        views(bag.path)


def test_a_bag_of_two_cameras_alone_is_a_stereo_sensors(tmp_path):
    assert Replay(path=str(pair(tmp_path))).suited_sensor() == "stereo"


@pytest.mark.parametrize("drive", ["raw", "odometry"])
def test_kittis_bags_hold_rectified_images_whatever_k_says(tmp_path, drive):
    """kitti2bag calls them image_raw; K is that of the raw ones, of odometry it is left out."""
    with BagFile(tmp_path, "ros1") as bag:
        for eye, shift_m in (("left", -0.06), ("right", 0.47)):
            info = told(bag, eye, shift_m)
            info.K[:] = info.K if drive == "raw" else 0.0
            bag.put(f"/kitti/camera_color_{eye}/camera_info", 1.0, info)
            bag.image(f"/kitti/camera_color_{eye}/image_raw", 1.0, picture(), "rgb8", eye)
    source, seen = views(bag.path)
    place, right = left_from_right(source, seen[0])
    assert source.camera.fx == right.fx == 40.0 and place[0, 3] == pytest.approx(0.53)
