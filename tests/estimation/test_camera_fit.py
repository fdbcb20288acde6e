"""The camera read off its own pictures: a painted box of a room seen by a camera that turns, told rightly and wrongly."""

import numpy as np
import pytest

from rhs.api.geometry import Camera, exp_so3, inverse, se3, transform
from rhs.api.records import Features, Thumbnail, View
from rhs.estimation.views.camera_fit import contradictions_of, fit_camera, turned_apart
from rhs.estimation.views.settings import CameraFitSettings

TRUE = Camera(320, 240, 262.5, 262.5, 159.5, 119.5)
HALF_M = np.array([2.0, 1.3, 2.2])  # of a room round the origin
SETTINGS = CameraFitSettings()


def depth_of(camera_from_room: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(N,) metres along the optical axis to the walls of the room, of rays (N, 3) of depth one."""
    eye, ways = inverse(camera_from_room)[:3, 3], rays @ camera_from_room[:3, :3]
    with np.errstate(divide="ignore"):
        reach = np.where(ways > 0, (HALF_M - eye) / ways, (-HALF_M - eye) / ways)
    return reach.min(axis=1)


def views_of(told: Camera, *, depth_focal: float = TRUE.fx, scale: float = 1.0, count: int = 40) -> list[View]:
    """Views of 900 marks on the walls, 0.3 pixels and a Kinect's depth noise; depth is read at the pixel of an image that
    a camera with depth_focal took."""
    rng = np.random.default_rng(5)
    marks = rng.uniform(-1, 1, (900, 3)) * HALF_M
    axis = rng.integers(0, 3, 900)
    marks[np.arange(900), axis] = np.sign(marks[np.arange(900), axis]) * HALF_M[axis]
    names = rng.standard_normal((900, 128)).astype(np.float32)
    names /= np.linalg.norm(names, axis=1, keepdims=True)
    v, u = np.mgrid[0:60, 0:80] * 4 + 1.5
    out = []
    for k in range(count):
        turn = np.array([0.25 * np.sin(0.4 * k), 0.15 * k, 0.1 * np.sin(0.3 * k)])
        camera_from_room = inverse(se3(exp_so3(turn), 0.5 * np.sin(np.array([0.1, 0.13, 0.17]) * k)))
        seen = transform(camera_from_room, marks)
        rays = seen / np.where(seen[:, 2:] > 0.1, seen[:, 2:], np.nan)
        pixels = TRUE.project(rays) + 0.3 * rng.standard_normal((900, 2))
        inside = ((pixels > 4) & (pixels < [315, 235])).all(axis=1)
        at = pixels[inside]
        inverse_depth = 1.0 / (scale * depth_of(camera_from_room, looked_at(at, depth_focal)))
        depth = 1.0 / (inverse_depth + 0.002 * rng.standard_normal(len(at)))
        thumb = scale * depth_of(camera_from_room, looked_at(np.column_stack([u.ravel(), v.ravel()]), depth_focal))
        features = Features(at.astype(np.float32), names[inside], told.points(at, depth).astype(np.float32),
                            Thumbnail(np.zeros((60, 80), np.uint8), thumb.reshape(60, 80).astype(np.float32)))
        out.append(View(k, 0.1 * k, told, None, inverse(camera_from_room) @ inverse(told.body_from_camera), np.eye(6), None,
                        features))
    return out


def looked_at(pixels: np.ndarray, focal_px: float) -> np.ndarray:
    return np.column_stack([(pixels - [TRUE.cx, TRUE.cy]) / focal_px, np.ones(len(pixels))])


def told(focal_px: float) -> Camera:
    return Camera(320, 240, focal_px, focal_px, TRUE.cx, TRUE.cy)


@pytest.mark.parametrize("focal_px", [262.5, 292.5, 240.0])
def test_the_focal_length_is_found_whatever_was_told(focal_px):
    fit = fit_camera(views_of(told(focal_px)), rng=np.random.default_rng(0))
    assert focal_px * fit.focal_ratio == pytest.approx(262.5, abs=max(3 * focal_px * fit.focal_ratio_sigma, 1.5))
    assert focal_px * fit.focal_ratio_sigma < 2.0
    said = contradictions_of(fit, told(focal_px), SETTINGS)
    assert len(said) == (focal_px != 262.5)
    if said:
        assert "source.camera=[26" in said[0] and f"told has {focal_px:.0f}" in said[0]


def test_a_wrong_scale_of_depth_contradicts_nothing():
    """With it the whole world is larger."""
    fit = fit_camera(views_of(told(262.5), scale=1.02), rng=np.random.default_rng(0))
    assert contradictions_of(fit, told(262.5), SETTINGS) == []
    assert fit.focal_ratio == pytest.approx(1.0, abs=0.01)


def test_depth_of_a_camera_beside_is_noticed():
    fit = fit_camera(views_of(told(262.5), depth_focal=292.5), rng=np.random.default_rng(0))
    assert 1.05 < fit.depth_magnified < 1.15
    assert fit.focal_ratio == pytest.approx(1.0, abs=0.02)
    said = contradictions_of(fit, told(262.5), SETTINGS)
    assert len(said) == 1 and "source.depth_camera=" in said[0]


def test_nothing_is_said_of_few_views():
    views = views_of(told(292.5), count=8)
    assert len(turned_apart(views, SETTINGS)) < SETTINGS.least_pairs
    assert fit_camera(views, rng=np.random.default_rng(0)) is None


def test_pairs_look_aside_from_each_other_by_what_is_wanted():
    views = views_of(told(262.5))
    for earlier, later in turned_apart(views, SETTINGS):
        axes = [views[k].map_from_body[:3, :3] @ TRUE.body_from_camera[:3, 2] for k in (earlier, later)]
        assert 14.0 < np.degrees(np.arccos(axes[0] @ axes[1])) < 40.0
