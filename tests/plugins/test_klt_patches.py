"""The patch kept from a point's first view: found again exactly where Lucas-Kanade from view to view strays."""

from __future__ import annotations

import cv2
import numpy as np

from rhs.api.geometry import Camera
from rhs.api.records import Observation
from rhs_odometry.tracks.klt import KltTracker
from rhs_odometry.tracks.klt_patches import Patches
from rhs_odometry.tracks.settings import FollowOnly, KltSettings, PatchRules

SHAPE = (120, 160)
CAMERA = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)


def texture(seed: int = 0, size: int = 800) -> np.ndarray:
    rough = np.random.default_rng(seed).uniform(0.0, 255.0, (size, size)).astype(np.float32)
    soft = cv2.GaussianBlur(rough, (0, 0), 3.0)
    return np.clip(128.0 + 6.0 * (soft - soft.mean()), 0, 255).astype(np.float32)


def view(scene: np.ndarray, scale: float, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """The scene about its middle, `scale` times as large, its middle `shift` px from the middle of the picture."""
    half = 0.5 * scene.shape[0]
    middle = np.array([SHAPE[1] / 2.0, SHAPE[0] / 2.0]) + shift
    warp = np.array([[scale, 0.0, middle[0] - scale * half], [0.0, scale, middle[1] - scale * half]])
    picture = cv2.warpAffine(scene, warp, (SHAPE[1], SHAPE[0]), flags=cv2.INTER_CUBIC)
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def moved(pixels: np.ndarray, scale: float, shift: tuple[float, float]) -> np.ndarray:
    middle = np.array([SHAPE[1] / 2.0, SHAPE[0] / 2.0])
    return middle + shift + scale * (pixels - middle)


def grid() -> np.ndarray:
    return np.stack(np.meshgrid(np.arange(30.0, 131.0, 20.0), np.arange(30.0, 91.0, 20.0)), axis=-1).reshape(-1, 2)


def test_a_patch_is_found_to_a_twentieth_of_a_pixel_though_it_grew_and_brightened():
    scene, pixels, shift = texture(), grid(), (1.3, -0.7)
    patches = Patches(PatchRules(iterations=10))
    patches.add(view(scene, 1.0), pixels)
    later = np.clip(view(scene, 1.15, shift).astype(int) + 20, 0, 255).astype(np.uint8)
    true = moved(pixels, 1.15, shift)
    guess = true + np.random.default_rng(1).uniform(-0.7, 0.7, true.shape)
    at, found = patches.find(later, guess)
    assert found.mean() > 0.9
    assert np.median(np.abs(at - true)[found]) < 0.05


def test_a_patch_that_is_no_longer_there_is_not_found_and_stays_where_it_was_guessed():
    patches = Patches(PatchRules())
    patches.add(view(texture(0), 1.0), grid())
    at, found = patches.find(view(texture(5), 1.0), grid())
    assert found.mean() < 0.1
    np.testing.assert_array_equal(at[~found], grid()[~found])


def test_a_patch_is_looked_at_afresh_once_it_has_grown_by_half():
    scene, pixels = texture(), np.array([[80.0, 60.0]])
    patches = Patches(PatchRules(stretch=1.5, views=100))
    patches.add(view(scene, 1.0), pixels)
    sizes = []
    for scale in np.linspace(1.05, 1.6, 12):
        picture = view(scene, float(scale))
        _, found = patches.find(picture, pixels)
        assert found.all()
        sizes.append(float(np.sqrt(np.linalg.det(patches._warps[0, :, :2]))))
        patches.refresh(picture, found)
    assert max(sizes) > 1.4  # the first look was kept while it served
    assert sizes[-1] < 1.2  # and was replaced behind a factor of 1.5


def test_only_points_with_a_whole_patch_are_whole():
    image = np.zeros(SHAPE, np.uint8)
    inside = Patches(PatchRules()).whole(np.array([[7.9, 60.0], [8.0, 60.0], [80.0, 111.0], [80.0, 111.1]]), image)
    assert inside.tolist() == [False, True, True, False]


def test_ten_views_on_points_have_not_strayed():
    """Approaching a wall, 2 % nearer each view: after ten views the median point is within 0.15 px of the truth."""
    scene, tracker, steps = texture(3), KltTracker(KltSettings(floor_points=20), points=60), 11
    frames = []
    for k in range(steps):
        gray = view(scene, 1.02**k, (0.37 * k, 0.21 * k))
        frames.append(tracker.track(Observation(k, 0.1 * k, CAMERA, image=np.repeat(gray[..., None], 3, axis=2))))
    names, first, last = np.intersect1d(frames[0].ids, frames[-1].ids, return_indices=True)
    true = moved(frames[0].pixels[first], 1.02 ** (steps - 1), (0.37 * (steps - 1), 0.21 * (steps - 1)))
    assert len(names) > 20
    assert np.median(np.abs(frames[-1].pixels[last] - true)) < 0.15


def test_without_patches_points_are_followed_there_and_back_and_stray():
    """The same approach: what the patches hold to 0.15 px strays further, so the two ways are not one."""
    scene, frames = texture(3), []
    tracker = KltTracker(FollowOnly(floor_points=20), points=60)
    for k in range(11):
        gray = view(scene, 1.02**k, (0.37 * k, 0.21 * k))
        frames.append(tracker.track(Observation(k, 0.1 * k, CAMERA, image=np.repeat(gray[..., None], 3, axis=2))))
    _, first, last = np.intersect1d(frames[0].ids, frames[-1].ids, return_indices=True)
    true = moved(frames[0].pixels[first], 1.02**10, (3.7, 2.1))
    error = np.median(np.abs(frames[-1].pixels[last] - true))
    assert len(first) > 20 and 0.15 < error < 2.0
