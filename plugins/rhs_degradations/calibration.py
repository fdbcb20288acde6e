"""A camera that is not as the parts are told: focal length, mounting. The captures stay as they are."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.geometry import Camera, exp_so3, se3
from rhs.api.records import Capture


class Miscalibrated(Degradation):
    """Hands captures on; what is told of the camera is wrong."""

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        return capture


@dataclass
class WrongFocal(PartSettings):
    """The focal length that the parts are told is wrong."""

    focal_share: float = within(0.02, -0.5, 1.0)
    """by this share of the true one, too long; negative: too short"""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    def build(self, context: Context) -> Degradation:
        return Focal(self)


class Focal(Miscalibrated):
    """fx and fy by a factor."""

    def __init__(self, settings: WrongFocal) -> None:
        self._factor = 1.0 + settings.focal_share

    def told(self, camera: Camera) -> Camera:
        return replace(camera, fx=self._factor * camera.fx, fy=self._factor * camera.fy, skew=self._factor * camera.skew)


@dataclass
class Mounting(PartSettings):
    """The camera is not mounted as the parts are told: they believe it pitched or rolled."""

    pitch_deg: float = within(1.0, -45.0, 45.0)
    """told so much further down than it looks, degrees"""
    roll_deg: float = within(0.0, -45.0, 45.0)
    """told so much further turned about its axis, clockwise in the picture, degrees"""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    def build(self, context: Context) -> Degradation:
        return Askew(self)


class Askew(Miscalibrated):
    """The extrinsics, turned in the camera frame (x right, y down, z forward)."""

    def __init__(self, settings: Mounting) -> None:
        self._turn = (exp_so3(np.radians([-settings.pitch_deg, 0.0, 0.0]))
                      @ exp_so3(np.radians([0.0, 0.0, settings.roll_deg])))

    def told(self, camera: Camera) -> Camera:
        return replace(camera, body_from_camera=camera.body_from_camera @ se3(self._turn, np.zeros(3)))
