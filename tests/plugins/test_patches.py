"""Finding patches again: sub-pixel shifts, warps and brightness of known pictures."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rhs_odometry.keyframe.patches import USUAL, find_patches

IDENTITY = np.eye(3)[:2]


rng = np.random.default_rng(3)
WAVES = rng.normal(0, 0.25, (40, 2))  # radians per pixel
PHASES = rng.uniform(0, 2 * np.pi, 40)


def picture(matrix=IDENTITY, gain=1.0, offset=0.0):
    """A sum of waves as an image in which the wave pattern's pixel p lies on matrix p: exact, not interpolated."""
    v, u = np.mgrid[0:240, 0:320]
    back = np.linalg.inv(np.vstack([matrix, [0, 0, 1]]))
    at = np.stack([u, v], axis=-1) @ back[:2, :2].T + back[:2, 2]
    value = 128 + 8 * np.sin(at @ WAVES.T + PHASES).sum(axis=2)
    return np.clip(np.rint(gain * value + offset), 0, 255).astype(np.uint8)


def pyramid(image):
    return [image, cv2.pyrDown(image)]


POINTS = np.stack(np.meshgrid(np.arange(60.0, 261.0, 40), np.arange(60.0, 181.0, 40)), axis=-1).reshape(-1, 2)


def check(matrix, guess_error=(2.0, -1.5), s=USUAL, **light):
    now = picture(matrix, **light)
    goal = POINTS @ matrix[:, :2].T + matrix[:, 2]
    warps = np.tile(np.linalg.inv(matrix[:, :2]), (len(POINTS), 1, 1))
    where, found = find_patches(pyramid(picture()), pyramid(now), pixels=POINTS, warps=warps, guess=goal + guess_error,
                                s=s)
    return np.hypot(*(where - goal)[found].T), found


def test_a_shift_is_found_to_a_twentieth_of_a_pixel():
    errors, found = check(np.array([[1.0, 0, 3.3], [0, 1.0, -2.7]]))
    assert found.all() and errors.max() < 0.05


@pytest.mark.parametrize("half_px", [4, 8])
def test_patches_of_other_sizes_find_the_shift_too(half_px):
    """Loops are compiled for the size of a patch: nine and seventeen pixels, of rows sixteen and twenty-four wide."""
    errors, found = check(np.array([[1.0, 0, 3.3], [0, 1.0, -2.7]]), s=replace(USUAL, half_px=half_px))
    assert found.mean() > 0.9 and np.median(errors) < 0.05


def test_brightness_may_change_by_gain_and_offset():
    errors, found = check(np.array([[1.0, 0, 3.3], [0, 1.0, -2.7]]), gain=0.6, offset=40.0)
    assert found.all() and errors.max() < 0.05


def test_a_patch_turned_by_thirty_degrees_and_grown_is_found_with_its_warp():
    turn = cv2.getRotationMatrix2D((160, 120), 30.0, 1.2)
    errors, found = check(turn)
    assert found.mean() > 0.7  # the corners turn out of the picture
    assert np.median(errors) < 0.1


def test_another_picture_or_a_blank_one_is_not_found():
    warps = np.tile(np.eye(2), (len(POINTS), 1, 1))
    noise = cv2.GaussianBlur(np.random.default_rng(7).integers(0, 255, (240, 320)).astype(np.uint8), (0, 0), 1.0)
    for other in (noise, np.full((240, 320), 90, np.uint8)):
        _, found = find_patches(pyramid(picture()), pyramid(other), pixels=POINTS, warps=warps, guess=POINTS)
        assert found.mean() < 0.1


def test_guesses_outside_or_unknown_are_not_found():
    guess = np.array([[-50.0, 20.0], [np.nan, 5.0], [319.0, 239.0]])
    where, found = find_patches(
        pyramid(picture()), pyramid(picture()), pixels=POINTS[:3], warps=np.tile(np.eye(2), (3, 1, 1)), guess=guess
    )
    assert not found.any() and where.shape == (3, 2)
