"""The eyes of the odometry `keyframe`: follow map points into a new view and fit its pose.

Lucas-Kanade brings a point near, from where the expected motion puts it; its patch in the key frame that anchors it
then says exactly where it is, so that following does not drift.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import Camera, inverse, log_se3
from rhs.api.records import Observation
from rhs_odometry.tracks import tracks

from ..advanced import SurfaceSettings
from .keyframe_map import KeyframeMap
from .patches import find_patches_in
from .reprojection import Noise, PoseFit, at_middle, fit_pose
from .surface import surfaces


@dataclass(frozen=True, eq=False)
class PreparedView:
    """One observation made ready: pyramid of its gray picture, its depth in metres, seconds since the one before; how
    surfaces are fitted to the depth; its noise beside what is told."""

    observation: Observation
    picture: list[np.ndarray]
    depth: np.ndarray
    interval_s: float
    surface: SurfaceSettings = SurfaceSettings()
    depth_times: float = 1.0

    def depth_at(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) metres at pixels (N, 2); NaN where unknown or over an edge."""
        return 1.0 / surfaces(self.depth, pixels, self.surface)[0]


class Tracker:
    """Knows which points are followed (ids, pixels) and where the camera was last: pose is map_from_camera."""

    def __init__(self, settings, camera: Camera, keyframes: KeyframeMap) -> None:
        self._settings, self._camera, self._map = settings, camera, keyframes
        self._focal = float(np.sqrt(camera.fx * camera.fy))
        a = self._advanced = settings.advanced
        self._noise = Noise(settings.pixel_sigma, settings.inverse_depth_sigma, a.gate, student_dof=a.student_dof)
        self._expected = np.zeros(6)  # shutter twist to expect in this view
        self._stamp = -np.inf
        self.shutter = np.zeros(6)  # twist while the last view was read
        self.speed = np.zeros(6)  # twist between the last two views
        self.look: PreparedView | None = None
        self.pose = np.eye(4)
        self.ids = np.zeros(0, int)
        self.pixels = np.zeros((0, 2), np.float32)
        self._moving_unknown, self._interval_s = False, 1.0  # see restart, _expect

    def ready(self, observation: Observation) -> PreparedView:
        assert observation.image is not None
        interval_s = observation.stamp_s - self._stamp
        self._stamp = observation.stamp_s
        picture = tracks.pyramid(tracks.gray(observation.image))
        depth = np.asarray(observation.depth, np.float32)
        return PreparedView(observation, picture, depth, interval_s if 0.0 < interval_s < 1.0 else 1.0,
                            self._advanced.surface, observation.depth_times)

    def follow(self, look: PreparedView, guess: np.ndarray) -> PoseFit:
        """Follow the points into the view from a guess of its map_from_camera, and fit its pose: by their patches alone
        where the guess puts them near enough."""
        assert self.look is not None
        if self._camera.readout_s == 0.0:
            fit = self._look_up(look, guess)
            if fit is not None:
                return fit
        shift = self._project(self.ids, guess) - self._project(self.ids, self.pose)
        pixels, found = tracks.follow(
            self.look.picture[0], look.picture[0], self.pixels, self.pixels + np.nan_to_num(shift),
            window_px=self._settings.window_px,
        )
        ids, pixels = self.ids[found], pixels[found]
        self._expect(look, guess)
        rough = self.fit(look, ids, pixels, inverse(guess))
        return self._settle(look, ids, pixels, rough)

    def _look_up(self, look: PreparedView, guess: np.ndarray) -> PoseFit | None:
        """The pose by patches alone; None where too few are found of the points that ought to be in view."""
        self._expect(look, guess)
        due = self._project(self.ids, guess)
        ids, pixels = self._patches(look, self.ids, due, inverse(guess))
        fit = self.fit(look, ids, pixels, inverse(guess))
        with np.errstate(invalid="ignore"):
            in_view = ((due > 8.0) & (due < [self._camera.width - 8.0, self._camera.height - 8.0])).all(axis=1).sum()
        if fit.inliers.sum() < self._advanced.found_share * in_view:
            return None
        self.ids, self.pixels = ids, pixels
        return fit

    def find(self, look: PreparedView, guess: np.ndarray) -> PoseFit:
        """The same without Lucas-Kanade, from a guess good to a few pixels: patches alone."""
        self._expect(look, guess)
        ids, pixels = self.seek(look, self.ids, guess)
        return self._settle(look, ids, pixels, self.fit(look, ids, pixels, inverse(guess)))

    def _settle(self, look: PreparedView, ids: np.ndarray, pixels: np.ndarray, rough: PoseFit) -> PoseFit:
        self._expect(look, inverse(rough.camera_from_map))
        if self._moving_unknown:
            self._mend_first(rough.camera_from_map)
        self.ids, self.pixels = self._patches(look, ids, pixels, rough.camera_from_map)
        return self.fit(look, self.ids, self.pixels, rough.camera_from_map)

    def _mend_first(self, camera_from_map: np.ndarray) -> None:
        """How the camera moved while its first view was read is known once there is a second: correct its points."""
        self._moving_unknown = False
        self.speed = log_se3(camera_from_map @ self.pose)
        share = self._camera.readout_s / self._interval_s
        self._map.reshape(len(self._map.poses) - 1, self._camera, share * self.speed)

    def accept(self, look: PreparedView, fit: PoseFit) -> None:
        """Take the fit for true: move on, sharpen the points that fit, forget the others."""
        now = inverse(fit.camera_from_map)
        self.speed = log_se3(fit.camera_from_map @ self.pose)
        self.pose, self.shutter, self.look = now, fit.shutter, look
        self.ids, self.pixels = self.ids[fit.inliers], self.pixels[fit.inliers]
        self._map.sharpen(self.ids, fit.camera_from_map, self._seen(look, self.pixels), look.depth_times)

    def restart(self, look: PreparedView, pose: np.ndarray) -> None:
        """Nothing is followed any more; the camera is believed at a pose."""
        self.pose, self.shutter, self.speed, self.look = pose, np.zeros(6), np.zeros(6), look
        self._expected = np.zeros(6)
        self._moving_unknown = self._camera.readout_s > 0.0
        self.ids, self.pixels = np.zeros(0, int), np.zeros((0, 2), np.float32)

    def fit(self, look: PreparedView, ids: np.ndarray, pixels: np.ndarray, start: np.ndarray) -> PoseFit:
        """The pose of a view in which points `ids` are at pixels, from a start (camera_from_map)."""
        rays = self._camera.rays(pixels.astype(float))
        sightings = self._map.sightings(ids, rays, look.depth_at(pixels), self._rows(pixels))
        noise = replace(self._noise, inverse_depth=self._settings.inverse_depth_sigma * look.depth_times)
        return fit_pose(sightings, start, focal=self._focal, noise=noise, shutter=self._expected)

    def seek(self, look: PreparedView, ids: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of points that should be in view of a pose, those whose patches are found, and their pixels."""
        return self._patches(look, ids, self._project(ids, pose), inverse(pose))

    def seeable(self, look: PreparedView) -> int:
        """Number of corners with known depth in the view: what one could begin with."""
        pixels = tracks.corners(look.picture[0], np.zeros((0, 2), np.float32), count=100, spacing_px=self._spacing)
        return int(np.isfinite(look.depth_at(pixels)).sum())

    @property
    def _spacing(self) -> int:
        return max(int(self._advanced.spacing_share * self._camera.height), 4)

    def top_up(self, look: PreparedView, keyframe: int) -> None:
        """Follow new corners where none are followed, anchored to a key frame that is this view."""
        count = self._settings.points - len(self.ids)
        pixels = tracks.corners(look.picture[0], self.pixels, count=count, spacing_px=self._spacing)
        seen = self._seen(look, pixels)
        known = np.isfinite(seen).all(axis=1)
        slopes = surfaces(look.depth, pixels[known], look.surface)[1]
        ids = self._map.add_points(keyframe, pixels[known], seen[known], slopes, look.depth_times)
        self.add(ids, pixels[known])

    def add(self, ids: np.ndarray, pixels: np.ndarray) -> None:
        """Follow these points as well."""
        self.ids = np.concatenate([self.ids, ids])
        self.pixels = np.concatenate([self.pixels, np.asarray(pixels, np.float32)])

    def _expect(self, look: PreparedView, pose: np.ndarray) -> None:
        """The shutter twist to expect in a view of about this pose: the motion at its middle, as far as it is read.

        The motion since the last view belongs to the middle between the two, so half of its change is added."""
        speed = log_se3(inverse(pose) @ self.pose)
        self._interval_s = look.interval_s
        share = self._camera.readout_s / look.interval_s
        shake_rad = float(np.radians(self._settings.shake_deg))
        self._noise = replace(self._noise, shutter_m=share * self._settings.shake_m, shutter_rad=share * shake_rad)
        self._expected = share * (speed + 0.5 * (speed - self.speed))

    def _patches(self, look: PreparedView, ids: np.ndarray, guess: np.ndarray, camera_from_map: np.ndarray):
        """Of the points `ids`, those whose patch is found near the guess (N, 2), and where."""
        warps = self._map.warps(ids, camera_from_map, self._camera)
        pixels, found = find_patches_in(
            self._map.picture, self._map.anchor[ids], look.picture, pixels=self._map.pixels[ids], warps=warps, guess=guess,
            s=self._advanced.patches)
        return ids[found], pixels[found].astype(np.float32)

    def _project(self, ids: np.ndarray, pose: np.ndarray) -> np.ndarray:
        return self._camera.project(self._map.seen_from(ids, inverse(pose)))

    def _rows(self, pixels: np.ndarray) -> np.ndarray:
        """(N,) rows of pixels, from the middle in image heights."""
        return (pixels[:, 1] + 0.5) / self._camera.height - 0.5

    def _seen(self, look: PreparedView, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) points seen at pixels, in the camera of the middle row; NaN where depth is unknown."""
        local = self._camera.points(pixels.astype(float), look.depth_at(pixels))
        return at_middle(local, self._rows(pixels), self.shutter)
