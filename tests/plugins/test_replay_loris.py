"""OpenLORIS-Scene: its true poses and wheels are those of the robot's base, on which trans_matrix.yaml puts the camera."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers import replayed
from scipy.spatial.transform import Rotation

from rhs.api.errors import ConfigError
from rhs.api.geometry import se2

CAMERA = [50.0, 50.0, 31.5, 23.5]
PLACE = np.vstack([np.column_stack([Rotation.from_quat([-0.497, 0.5, -0.495, 0.508]).as_matrix(), [0.23, -0.05, 0.92]]),
                   [0, 0, 0, 1.0]])  # of the colour camera on base_link
MATRIX = ("%YAML:1.0\n---\ntrans_matrix:\n   -\n      parent_frame: base_link\n      child_frame: {child}\n"
          "      matrix: !!opencv-matrix\n         rows: 4\n         cols: 4\n         dt: d\n         data: [ {data} ]\n")


def loris(folder, child="d400_color_optical_frame", data=PLACE):
    lines = {"color": [], "aligned_depth": [], "groundtruth": [], "odom": []}
    for k in range(3):
        stamp, pose = 1_560_000_028.0 + 0.1 * k, se2(0.2 * k, 0.0, 0.1 * k)
        turn = " ".join(map(str, Rotation.from_matrix(pose[:3, :3]).as_quat()))
        for name, pixels in (("color", np.full((48, 64, 3), 90, np.uint8)),
                             ("aligned_depth", np.full((48, 64), 2000, np.uint16))):
            (folder / name).mkdir(exist_ok=True)
            cv2.imwrite(str(folder / name / f"{stamp:.6f}.png"), pixels)
            lines[name].append(f"{stamp:.6f} {name}/{stamp:.6f}.png")
        lines["groundtruth"].append(f"{stamp:.6f} {0.2 * k} 0 0 {turn}")
        lines["odom"].append(f"{stamp:.6f} {19 + 0.21 * k} 22 0 0 0 0 1 0.2 0 0 0 0 0.1")
    for name, text in lines.items():
        (folder / f"{name}.txt").write_text("#Time\n" + "\n".join(text) + "\n")
    (folder / "trans_matrix.yaml").write_text(MATRIX.format(child=child, data=", ".join(map(str, np.ravel(data)))))
    return folder


def views(path, **settings):
    return replayed.views(path, camera=CAMERA, **settings)


def test_the_body_is_the_base_with_the_camera_on_it_and_its_wheels_are_read(tmp_path):
    source, seen = views(loris(tmp_path))
    np.testing.assert_allclose(source.camera.body_from_camera, PLACE, atol=1e-9)
    np.testing.assert_allclose(seen[2][1], se2(0.4, 0.0, 0.2), atol=1e-6)
    assert "wheel" in source.provides and seen[0][0].travel is None
    np.testing.assert_allclose(seen[1][0].travel, [0.21, 0.0, 0.0], atol=1e-6)
    assert float(np.median(seen[0][0].depth)) == 2.0


def test_without_wheels_or_with_a_mount_that_is_typed(tmp_path):
    source, seen = views(loris(tmp_path), wheel_topic="none", camera_mount=[0.0, 0.0, 1.5, 0.0, 0.0, 0.0])
    assert "wheel" not in source.provides and seen[1][0].travel is None and source.camera.height_m == 1.5


@pytest.mark.parametrize(("child", "data", "said"), [
    ("t265_fisheye1_optical_frame", PLACE, "nothing joins base_link and d400_color_optical_frame; found t265_fisheye1"),
    ("d400_color_optical_frame", np.eye(4)[:3], r"trans_matrix\.yaml: cannot be read .* expected a list trans_matrix of"),
    ("d400_color_optical_frame", 2 * np.eye(4), r"trans_matrix\.yaml: d400_color_optical_frame: the last row"),
])
def test_a_broken_trans_matrix_is_refused_in_one_line(tmp_path, child, data, said):
    with pytest.raises(ConfigError, match=said) as caught:
        views(loris(tmp_path, child, data))
    assert "\n" not in str(caught.value)


def test_a_broken_odom_is_refused_with_its_line(tmp_path):
    loris(tmp_path)
    (tmp_path / "odom.txt").write_text("#Time\n1560000028.0 1 2 3\n")
    with pytest.raises(ConfigError, match=r"odom\.txt:2: found 4 columns; expected stamp, x y z, qx qy qz qw and speeds"):
        views(tmp_path)
