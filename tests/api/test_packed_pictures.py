"""The file of a picture goes with its very pixels, and with them alone."""

import gc

import cv2
import numpy as np

from rhs.api import packed_pictures
from rhs.api.packed_pictures import hand_on_png, keep_png, png_of


def _png(image):
    return cv2.imencode(".png", image)[1].tobytes()


def test_a_copy_has_the_file_and_a_changed_picture_has_none():
    image = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    keep_png(image, _png(image))
    same, darker = image.copy(), image // 2
    for seen in (same, darker):
        hand_on_png(image, seen)
    assert png_of(image) == png_of(same) == _png(image)
    assert png_of(darker) is None


def test_a_grey_file_and_one_that_is_no_png_are_not_kept():
    image = np.zeros((4, 5, 3), np.uint8)
    for data in (_png(image[..., 0]), b"\xff\xd8\xff" + bytes(30), b""):
        keep_png(image, data)
        assert png_of(image) is None


def test_it_is_forgotten_with_the_picture():
    held = len(packed_pictures._of)
    image = np.zeros((4, 5, 3), np.uint8)
    keep_png(image, _png(image))
    assert len(packed_pictures._of) == held + 1
    del image
    gc.collect()
    assert len(packed_pictures._of) == held
