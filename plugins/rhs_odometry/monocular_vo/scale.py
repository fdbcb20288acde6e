"""How many metres a unit of the map is: the way by wheels or commands over the way seen, or what was typed, or unknown."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.records import Observation

from ..fused.fallback import told_motion

LEAST_WAY_M = 1e-3  # a shorter way between two key frames says nothing of the scale
UNKNOWN = "unknown"


class Scale:
    """metres: of a unit. source: wheel, command, first depth, or unknown."""

    def __init__(self, body_from_camera: np.ndarray, first_depth_m: float, frames: int) -> None:
        self._camera, self._frames = body_from_camera, frames
        self.metres = first_depth_m or 1.0
        self.source = "first depth" if first_depth_m else UNKNOWN
        self._ways: list[tuple[float, float]] = []
        self._since: np.ndarray | None = np.eye(4)  # body motion since the last key frame as wheels or commands tell it
        self._told = ""

    @property
    def known(self) -> bool:
        return self.source != UNKNOWN

    def hear(self, observation: Observation) -> np.ndarray | None:
        """Count on; the body's motion (4x4) by wheels or command since the view before, None where nobody tells."""
        self._told, motion = told_motion(observation)
        self._since = None if motion is None or self._since is None else self._since @ motion
        return motion

    def begin(self) -> None:
        """A new map: what was learnt of the old one's unit does not hold."""
        self._ways, self._since = [], np.eye(4)

    def key_frame(self, way_units: float) -> None:
        """A key frame lies so far from the one before, in units of the map."""
        if self._since is not None:
            way_m = float(np.linalg.norm((inverse(self._camera) @ self._since @ self._camera)[:3, 3]))
            if way_m > LEAST_WAY_M and way_units > 0.0:
                self._ways = [*self._ways, (way_m, way_units)][-self._frames:]
                self.metres = sum(m for m, _ in self._ways) / sum(u for _, u in self._ways)
                self.source = self._told
        self._since = np.eye(4)
