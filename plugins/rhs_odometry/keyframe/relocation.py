"""Where a camera that lost its way is: the view matched with the key frames that the map still holds.

Of each key frame its picture is there and depth at every few pixels; key-points are found in it when it is first asked for.
A few key frames are tried per view, first those nearest to where the camera is thought to be, then the others in turn, so
that a view costs the same however large the map. What is found is a hypothesis: the caller looks the map's points up from
there. Compare the relocalisation of ORB-SLAM (Mur-Artal, Montiel and Tardos, TRO 2015, section V-D), by a vocabulary.
"""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera
from rhs.api.records import Features, Observation
from rhs.estimation.views import features as vision
from rhs.estimation.views.rigid import PointNoise, Rigid, ransac_rigid
from rhs.estimation.views.settings import RansacSettings

from .config import KeyframeAdvanced
from .keyframe_map import KeyframeMap

COLUMNS = 80  # of the depth that is kept of a key frame


class Relocation:
    """Key-points of the key frames of one map, found when they are asked for."""

    def __init__(self, settings: KeyframeAdvanced, camera: Camera, keyframes: KeyframeMap) -> None:
        self._settings, self._camera, self._map = settings, camera, keyframes
        self._stride = max(camera.width // COLUMNS, 1)
        self._depth: dict[int, np.ndarray] = {}  # by serial, (h, w) float16 metres
        self._features: dict[int, Features] = {}
        self._turn = 0  # whose turn it is among the key frames far off

    def note(self, keyframe: int, depth: np.ndarray) -> None:
        """Keep what recognising a new key frame needs: its (H, W) depth; forget what the map gave up."""
        half = self._stride // 2
        self._depth[int(self._map.serials[keyframe])] = depth[half :: self._stride, half :: self._stride].astype(np.float16)
        held = set(self._map.serials.tolist())
        for known in (self._depth, self._features):
            for serial in [serial for serial in known if serial not in held]:
                del known[serial]

    def candidates(self, view: Observation, near: np.ndarray, below: int, rng: np.random.Generator) -> list[np.ndarray]:
        """map_from_camera of the view by each key frame of rows less than `below` that it may show, the best supported
        first. near: the same as it is thought to be."""
        now = vision.orb_features(view, self._settings.rescue_features)
        found = [by for k in self._asked(near, below) if (by := self._found_by(now, k, rng)) is not None]
        return [pose for _, pose in sorted(found, key=lambda by: -by[0])]

    def by(self, view: Observation, keyframe: int, rng: np.random.Generator) -> np.ndarray | None:
        """map_from_camera of a view by the key-points of one key frame; None when too few agree."""
        found = self._found_by(vision.orb_features(view, self._settings.rescue_features), keyframe, rng)
        return None if found is None else found[1]

    def _found_by(self, now: Features, keyframe: int, rng: np.random.Generator) -> tuple[int, np.ndarray] | None:
        """How many key-points agree, and map_from_camera by them; None when they are too few."""
        motion = matched(now, self._of(keyframe), self._settings, float(self._camera.fx), rng)
        if motion is None or motion.count < self._settings.min_edge:
            return None
        return motion.count, self._map.poses[keyframe] @ motion.a_from_b

    def _asked(self, near: np.ndarray, below: int) -> list[int]:
        """Half of those tried are the nearest, half whose turn it is."""
        gaps = np.linalg.norm(self._map.poses[:below, :3, 3] - near[:3, 3], axis=1)
        half = (self._settings.relocate_tries + 1) // 2
        order = np.argsort(gaps, kind="stable")
        close, far = order[:half].tolist(), order[half:]
        turns = (self._turn + np.arange(min(half, len(far)))) % max(len(far), 1)
        self._turn += half
        return close + np.sort(far)[turns].tolist()

    def _of(self, keyframe: int) -> Features:
        serial = int(self._map.serials[keyframe])
        if serial not in self._features:
            bare = Observation(0, 0.0, self._camera, self._map.picture(keyframe)[0])
            seen, depth = vision.orb_features(bare, self._settings.rescue_features), self._depth[serial]
            at = np.minimum(seen.pixels[:, ::-1].astype(int) // self._stride, np.array(depth.shape) - 1)
            metres = depth[at[:, 0], at[:, 1]].astype(float)
            points = self._camera.points(seen.pixels.astype(float), np.where(metres > 0.0, metres, np.nan))
            self._features[serial] = Features(seen.pixels, seen.descriptors, points.astype(np.float32))
        return self._features[serial]


def matched(now: Features, then: Features, a: KeyframeAdvanced, fx: float, rng: np.random.Generator) -> Rigid | None:
    """then_from_now by matching ORB features with depth, however far the camera moved; None when too few agree."""
    rows = vision.match(now, then, a.rescue_ratio)
    p, q = now.points[rows[:, 0]].astype(float), then.points[rows[:, 1]].astype(float)
    known = np.isfinite(p).all(axis=1) & np.isfinite(q).all(axis=1)
    tries = RansacSettings(a.rescue_hypotheses, a.rescue_gate_sigma)
    return ransac_rigid(p[known], q[known], noise=PointNoise(fx, a.rescue_px), rng=rng, settings=tries)
