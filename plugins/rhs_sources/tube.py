"""The source `tube`: ray-cast views from inside a painted tube whose texture is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Source, SourceContext
from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, camera_from_fov, exp_so3, inverse, planar, se3
from rhs.api.records import Capture, Twist, WorldFacts
from rhs.worlds import tubes

from .lens import checked_rays
from .simulator_route import Wobble
from .tube_config import Tube
from .tube_paint import Paint

DARK_BEYOND = 40.0  # the wall is drawn up to this many sizes away; further it is dark


class TubeSource(Source):
    """See rhs.api.contracts.Source. The map begins under the camera's first place, on the bottom of the tube."""

    renderer = "numpy"
    leads_ahead = True

    def __init__(self, settings: Tube, context: SourceContext) -> None:
        self._settings = settings
        self.tube = tube_of(settings)
        half = settings.size_m * (settings.aspect if settings.shape == "rectangular" else 1.0)
        self._map_from_tube = se3(np.eye(3), np.array([0.0, 0.0, half]))
        self._up = half * (2.0 * settings.camera_share - 1.0)
        self.camera = camera_of(settings, half + self._up)
        rng, strays, tilts, self._rng = context.rng.spawn(4)
        share = settings.wobble_share * settings.size_m
        self._aside, self._above = Wobble(strays, share), Wobble(strays, share)
        self._tilts = [Wobble(tilts, math.radians(settings.wobble_deg)) for _ in range(3)]
        self._bias = self._rng.normal(0.0, settings.command_bias_percent / 100)
        self.facts = WorldFacts("tube", (0.0, 0.0, 0.0), (), bounds_of(self.tube, settings), 0.3 * settings.size_m)
        self._paint = Paint(settings, self.tube.section, rng)
        self._rays = unit_rays(self.camera)
        self.views_expected: int | None = int(settings.length_m / settings.step_m + 1e-9) + 1
        self._index, self._pose = 0, np.eye(4)

    def lead(self) -> Capture | None:
        """The next view along the centre line."""
        if self._index >= (self.views_expected or 0):
            return None
        along_m, seconds = self._index * self._settings.step_m, self._settings.step_m / self._settings.speed_mps
        before, self._pose = self._pose, self._stand(along_m)
        image, depth = self._draw()
        command = travel = None
        if self._index:
            travel = planar(inverse(before) @ self._pose)
            command = self._command(travel, seconds)
            travel.setflags(write=False)
        self._index += 1
        return Capture(self._index - 1, (self._index - 1) * seconds, image, depth, command, travel)

    def texture(self, along_m: np.ndarray, around_m: np.ndarray) -> np.ndarray:
        """True grey level (0..255) of the wall at (N,) distances from the first view's section, (N,) round it."""
        return self._paint.at(along_m, around_m)

    def begin_patrol(self) -> None:
        """Nothing to put in."""

    def drive(self, command: Twist) -> Capture:
        raise ConfigError("source=tube cannot be driven; type source=simulator")

    def teleport(self, world_from_body: np.ndarray) -> None:
        raise ConfigError("source=tube cannot be teleported; type source=simulator")

    def truth(self) -> np.ndarray | None:
        return self._pose.copy()

    def clearance_m(self) -> tuple[float, bool]:
        return math.nan, False

    def close(self) -> None:
        """Nothing is open."""

    def _stand(self, along_m: float) -> np.ndarray:
        """4x4 map_from_body of the view at `along_m`; the first stands exactly where it should."""
        distance = along_m / self._settings.size_m  # a hand shakes as often per size of the tube, however large it is
        if along_m == 0.0:
            aside, above, tilt = 0.0, 0.0, np.zeros(3)
        else:
            aside, above = self._aside(distance), self._above(distance)
            tilt = np.array([wobble(distance) for wobble in self._tilts])
        at = se3(exp_so3(tilt), np.array([0.0, aside, self._up + above]))
        upright = se3(np.eye(3), np.array([0.0, 0.0, -self.camera.height_m]))
        return self._map_from_tube @ self.tube.pose(along_m) @ at @ upright

    def _draw(self) -> tuple[np.ndarray, np.ndarray]:
        """Image (H, W, 3) uint8 and depth (H, W) float32."""
        camera, eye = self.camera, inverse(self._map_from_tube) @ self._pose @ self.camera.body_from_camera
        directions = self._rays @ eye[:3, :3].T
        reach = self.tube.trace(eye[:3, 3], directions, DARK_BEYOND * self._settings.size_m)
        met = np.isfinite(reach)
        flat = self.tube.flat(eye[:3, 3] + reach[met, None] * directions[met])
        footprint = reach[met] ** 2 / (camera.fx * self._settings.size_m)
        grey = np.full(len(reach), 20.0)
        grey[met] = self._paint.at(*flat.T, footprint_m=footprint)
        image = np.rint(grey).astype(np.uint8).reshape(camera.height, camera.width)
        depth = (reach * self._rays[:, 2]).reshape(image.shape).astype(np.float32)
        image = np.repeat(image[:, :, None], 3, axis=2)
        image.setflags(write=False)
        depth.setflags(write=False)
        return image, depth

    def _command(self, travel: np.ndarray, seconds: float) -> Twist:
        error = 1.0 + self._bias + self._rng.normal(0.0, self._settings.command_noise_percent / 100, 2)
        return Twist(float(travel[0] / error[0] / seconds), float(travel[2] / error[1] / seconds), seconds)


def tube_of(settings: Tube) -> tubes.Tube:
    """The geometry that the settings describe."""
    section = (tubes.RoundSection(settings.size_m) if settings.shape == "round"
               else tubes.RectangularSection(settings.size_m, settings.aspect))
    pairs = zip(settings.pieces[::2], settings.pieces[1::2], strict=True)
    return tubes.Tube(section, tuple((length_m, math.radians(bend) / length_m) for length_m, bend in pairs))


def bounds_of(tube: tubes.Tube, settings: Tube) -> tuple[float, float, float, float]:
    """x_min, y_min, x_max, y_max of the tube as far as the camera looks into it."""
    ahead = np.linspace(0.0, settings.length_m + 12.0 * settings.size_m, 60)
    line, rim = np.array([tube.pose(s)[:2, 3] for s in ahead]), 2.0 * settings.size_m
    (x_min, y_min), (x_max, y_max) = line.min(axis=0) - rim, line.max(axis=0) + rim
    return float(x_min), float(y_min), float(x_max), float(y_max)


def camera_of(settings: Tube, height_m: float) -> Camera:
    """An upright camera at that height with the lens of the settings."""
    plain = camera_from_fov(settings.image_width, settings.image_width * 3 // 4, settings.hfov_deg, height_m=height_m)
    return replace(plain, skew=settings.skew_px, distortion=tuple(settings.distortion),
                   body_from_camera=se3(BODY_FROM_OPTICAL, np.array([0.0, 0.0, height_m])))


def unit_rays(camera: Camera) -> np.ndarray:
    """(H * W, 3) unit directions of all pixels in the camera frame. Raises ConfigError for a lens that folds the picture."""
    v, u = np.indices((camera.height, camera.width)).reshape(2, -1)
    rays = checked_rays(camera, np.stack([u, v], axis=1).astype(float), "source")
    return rays / np.linalg.norm(rays, axis=1)[:, None]
