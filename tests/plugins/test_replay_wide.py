"""Lenses that see nearly all that is ahead (TUM VI): their images are made a pinhole camera's."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_of
from rhs_sources.lens_models import Flattened, with_lens
from rhs_sources.replay_config import Replay

SIZE, F = 256, 95.5  # a corner lies 108 degrees from the middle
K1 = [0.0035, 0.0007, -0.0021, 0.0002]
CHAIN = """  T_cam_imu:
  - [1.0, 0.0, 0.0, {x}]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: {k}
  intrinsics: [{f}, {f}, {c}, 128.0]
  resolution: [256, 256]
"""


def dot(aside_deg, f, c, k):
    """An image of 16 bits, as TUM VI's, of a light so far to the right."""
    angle = np.radians(aside_deg)
    at = c + f * angle * (1.0 + sum(one * angle ** (2 * i) for i, one in enumerate(k, start=1)))
    x, y = np.meshgrid(np.arange(SIZE), np.arange(SIZE))
    return (60000 * np.exp(-0.5 * ((x - at) ** 2 + (y - 128.0) ** 2) / 2.0**2)).astype(np.uint16)


def tum_vi(folder, k=K1):
    chain = ""
    for name, f, c, x in (("cam0", F, 127.0, 0.0), ("cam1", F + 1.0, 126.0, -0.1)):
        (folder / f"mav0/{name}/data").mkdir(parents=True)
        cv2.imwrite(str(folder / f"mav0/{name}/data/1520530308199447626.png"), dot(50.0, f, c, k))
        (folder / f"mav0/{name}/data.csv").write_text("1520530308199447626,1520530308199447626.png\n")
        chain += f"{name}:\n" + CHAIN.format(f=f, c=c, k=list(k), x=x)
    (folder / "dso").mkdir()
    (folder / "dso/camchain.yaml").write_text(chain)
    return folder


def middle(image):
    """The place of the light, pixels."""
    weights = image[:, :, 0].astype(float)
    return float((weights.sum(axis=0) * np.arange(SIZE)).sum() / weights.sum())


def test_a_light_far_aside_is_where_a_pinhole_camera_sees_it_by_both_eyes(tmp_path, caplog):
    source = Replay(path=str(tum_vi(tmp_path)), stereo=True).build(None)
    capture = source.lead()
    right = camera_of(capture.extras[RIGHT_CAMERA])
    source.close()
    for camera, image in ((source.camera, capture.image), (right, capture.extras[RIGHT_IMAGE])):
        assert not isinstance(camera, Flattened) and camera.distortion == ()
        ray = camera.rays(np.array([[middle(image), camera.cy]]))[0]
        assert np.degrees(np.arctan(ray[0])) == pytest.approx(50.0, abs=0.3)
    np.testing.assert_allclose((np.linalg.inv(source.camera.body_from_camera) @ right.body_from_camera)[:3, 3], [0.1, 0, 0])
    assert "sees further aside than is followed: images are flattened to a pinhole's, 60 degrees to each side" in caplog.text


def test_numbers_that_fold_the_image_over_itself_are_refused_in_one_line(tmp_path):
    with pytest.raises(ConfigError, match="equidistant whose numbers fold the image over itself within 75 deg") as caught:
        Replay(path=str(tum_vi(tmp_path, k=[-0.9, 0.0, 0.0, 0.0]))).build(None)
    assert "\n" not in str(caught.value)


def test_a_lens_whose_edges_are_nearer_than_sixty_degrees_keeps_what_it_sees():
    """DSO's FOV model over 70 degrees is followed by OpenCV's; beyond, the flat view ends where the image does."""
    from rhs.api.geometry import Camera

    narrow = with_lens(Camera(640, 480, 320.0, 320.0, 319.5, 239.5), "equidistant", [0.0] * 4)
    assert not isinstance(narrow, Flattened) and any(narrow.distortion)
    wide = with_lens(Camera(640, 200, 200.0, 200.0, 319.5, 99.5), "equidistant", [0.0] * 4)
    assert isinstance(wide, Flattened)  # its corner lies 96 degrees from the middle, its upper edge 28
    top = wide.rays(np.array([[wide.cx, 0.0]]))[0]
    assert np.degrees(np.arctan(abs(top[1]))) < 28.6
    assert np.degrees(np.arctan(0.5 * wide.width / wide.fx)) > 50.0  # across it is as wide as it may be
