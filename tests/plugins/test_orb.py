"""Odometry orb: fast features, placed by patches."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from painted_room import observe, paintings

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov, inverse, log_se3, se2
from rhs.api.records import FeatureSettings, Observation, Tracking
from rhs_odometry.features.config import Orb

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0, forward_m=0.1)
TEXTURES = paintings()
START = se2(0.3, -0.2, 1.5)
MOVES = [se2(0.1, 0.0, 0.0), se2(0.0, 0.0, 0.1), se2(0.08, 0.02, -0.08), se2(-0.05, 0.0, 0.05)]


def build(**settings):
    context = SimpleNamespace(rng=np.random.default_rng(0), camera=CAMERA, features=FeatureSettings())
    return Orb(**settings).build(context)


def errors(**settings):
    """(M, 6) twists from the true to the estimated motion, and the motions."""
    motions = []
    for move in MOVES:
        odometry = build(**settings)
        odometry.update(observe(CAMERA, START, TEXTURES, 0))
        motions.append(odometry.update(observe(CAMERA, START @ move, TEXTURES, 1)))
    return np.array([log_se3(inverse(a) @ m.previous_from_body) for a, m in zip(MOVES, motions, strict=True)]), motions


def test_patches_place_points_several_times_better_than_the_features_do():
    placed, motions = errors()
    as_found, _ = errors(placing="features")
    assert all(m.status is Tracking.OK for m in motions)
    assert np.abs(placed[:, :3]).max() < 0.001 and np.abs(placed[:, 3:]).max() < 0.0005
    assert np.linalg.norm(placed) < 0.5 * np.linalg.norm(as_found)


@pytest.mark.parametrize("image", [None, 0, 128])
def test_nothing_to_see_is_lost(image):
    odometry = build()
    odometry.update(observe(CAMERA, START, TEXTURES, 0))
    seen = None if image is None else np.full((240, 320, 3), image, np.uint8)
    motion = odometry.update(Observation(1, 0.1, CAMERA, seen, np.full((240, 320), 2.0, np.float32)))
    assert motion.status is Tracking.LOST and "took same again" in motion.reason


def test_a_view_whose_depth_is_unknown_is_lost_and_the_next_is_found_again():
    odometry = build()
    views = [observe(CAMERA, START, TEXTURES, k) for k in range(3)]
    blind = Observation(1, 0.1, CAMERA, views[1].image, np.full((240, 320), np.nan, np.float32))
    motions = [odometry.update(view) for view in (views[0], blind, views[2])]
    assert [m.status is Tracking.LOST for m in motions] == [False, True, False]
    assert np.abs(motions[2].previous_from_body - np.eye(4)).max() < 0.003


def test_settings_out_of_range_are_refused():
    with pytest.raises(ConfigError, match="placing"):
        Orb(placing="guess")
