"""A survey round the painted room, for tests of places and loops: views with known truth and, if wanted, drift."""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from painted_room import observe, paintings

from rhs.api.geometry import camera_from_fov, inverse, se2
from rhs.api.records import FeatureSettings, Motion, Observation, Tracking, View
from rhs.estimation.views.features import features

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0, forward_m=0.1)
FEATURES = FeatureSettings()
SMALL = np.diag([1e-4] * 3 + [1e-5] * 3)


def context(seed: int = 0) -> SimpleNamespace:
    return SimpleNamespace(rng=np.random.default_rng(seed), camera=CAMERA, features=FEATURES)


def ring(count: int = 24, turns: float = 1.0) -> list[np.ndarray]:
    """Body poses on a circle of 1.5 m, looking along the way, `turns` times round; the last repeats the first."""
    angles = np.linspace(0.0, 2 * np.pi * turns, count + 1)
    return [se2(1.5 * np.cos(a), 1.5 * np.sin(a), a + np.pi / 2) for a in angles]


@cache
def _paintings() -> np.ndarray:
    return paintings()


@cache
def _observation(key: bytes) -> Observation:
    return observe(CAMERA, np.frombuffer(key).reshape(4, 4), _paintings())


def look(pose: np.ndarray) -> Observation:
    """What the camera sees from a pose; rendered once per pose. Its index is 0."""
    return _observation((np.round(pose, 9) + 0.0).tobytes())


def survey(truth: list[np.ndarray], *, drift: np.ndarray | None = None, every: int = 1) -> list[View]:
    """Views at the true poses, believed to be where motions with an extra `drift` (4x4) at each step lead."""
    drift = np.eye(4) if drift is None else drift
    believed, out = truth[0], []
    for k, pose in enumerate(truth):
        step = np.eye(4) if k == 0 else inverse(truth[k - 1]) @ pose @ drift
        believed = believed @ step
        seen = look(pose)
        kept = k % every == 0 or k == len(truth) - 1
        motion = Motion(step, SMALL, Tracking.OK)
        out.append(View(k, 0.1 * k, CAMERA, motion, believed, SMALL, None, features(seen, FEATURES) if kept else None))
    return out
