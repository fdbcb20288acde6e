"""The sensor `rgbd`: ideal depth made Kinect-like, the depth row at the camera's height as a scan, and what stands between
the floor and the robot's height as another.

The two stay apart: scans are laid on one another at one height, where walls look the same from everywhere; a table or a bed
looks different from each side, and is what the robot must not touch. Both are read along the horizon: a camera that sways
shows it by the floor, view by view.

Depth noise and range: Nguyen, Izadi and Lovell 2012 (section 4.1) and Khoshelham and Elberink 2012 (disparity steps).
"""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Context
from rhs.api.frozen import freeze
from rhs.api.geometry import Camera
from rhs.api.records import Capture, Observation, Scan
from rhs.estimation.scans.obstacle_scan import ObstacleScanner, levelled
from rhs.estimation.views.depth_noise import DepthLevel, mended

from .degrade import Encoders, depth_of, image_of, noisy_image
from .noise import chosen, measure_depth, normal
from .rgbd import Rgbd
from .stereo import Stereo


class RgbdSensor:
    """Each noise has its own random stream, so that one setting does not change another's numbers."""

    senses_ahead = True

    def __init__(self, settings: Rgbd, context: Context) -> None:
        self._settings = settings
        self._camera = context.camera
        self._image_rng, self._depth_rng, wheel_rng = context.rng.spawn(3)
        self._encoders = Encoders(settings, wheel_rng)
        self._law = law_of(settings)
        self._rows = ScanRows(context.camera, settings)
        self._level, self._left = (DepthLevel(settings.advanced.depth_noise) for _ in range(2))
        self._band: ObstacleScanner | None = None
        if context.camera.height_m > 0.0:  # of a recording whose camera hangs nobody knows where, nobody knows the floor
            self._band = self._obstacles(context.camera)
        self._tilted = float(np.tan(np.radians(settings.advanced.obstacle.tilted_deg)))

    def sense(self, capture: Capture) -> Observation:
        clean = image_of(capture, self._camera)
        noise = self._settings.noise and not capture.sensed
        ideal = depth_of(capture, self._camera)
        image_sigma = self._settings.image_sigma if noise else 0.0
        depth, scan, obstacle, times = self._ranges(ideal, noise)
        return Observation(
            capture.index,
            capture.stamp_s,
            self._camera,
            image=noisy_image(clean, image_sigma, self._image_rng),
            depth=depth,
            scan=scan,
            command=capture.command,
            wheel=self._encoders.read(capture.travel, exact=capture.sensed),
            obstacle=obstacle,
            depth_times=times,
        )

    def _ranges(self, ideal: np.ndarray, noise: bool) -> tuple[np.ndarray, Scan, Scan | None, float]:
        """Depth (H, W) as this sensor measures it, its two scans, and how noisy it is beside a Kinect's."""
        depth, rules, times = self._degraded(ideal, noise), self._settings.advanced.depth_noise, 1.0
        level = self._level.look(depth)
        if level > rules.above:
            smooth, side_px = mended(depth, level, max_range_m=self._settings.max_range_m, settings=rules)
            depth, times = freeze(smooth), max(1.0, self._left.look(smooth, side_px))
        if self._band is None:
            return depth, self._rows.scan(depth), None, times
        floor = self._band.floor(self._band.thinned(depth))
        if np.hypot(*floor[0][1:]) <= self._tilted:
            return depth, self._rows.scan(depth), self._band.scan(depth, floor, times), times
        camera = levelled(self._camera, floor[0])
        return depth, ScanRows(camera, self._settings).scan(depth), self._obstacles(camera).scan(depth, None, times), times

    def _obstacles(self, camera: Camera) -> ObstacleScanner:
        settings = self._settings
        return ObstacleScanner(camera, settings.advanced.obstacle, max_range_m=settings.max_range_m)

    def _degraded(self, ideal: np.ndarray, noise: bool) -> np.ndarray:
        """(H, W) float32 depth with noise, in steps of disparity, NaN outside the range."""
        settings = self._settings
        depth = np.array(ideal, np.float32, order="C")
        if noise:
            which = chosen(self._depth_rng, depth.size)
            return freeze(measure_depth(depth.reshape(-1), which, normal(), *self._law).reshape(depth.shape))
        with np.errstate(invalid="ignore"):
            depth[~((depth >= settings.min_range_m) & (depth <= settings.max_range_m))] = np.nan
        return freeze(depth)


def law_of(settings: Rgbd) -> tuple[tuple[np.float32, np.float32], ...]:
    """What `measure_depth` is told: the deviation's two parts, disparity and its steps, the range."""
    times = settings.depth_noise
    pairs = ((times * settings.depth_constant_m, times * settings.depth_quadratic_per_m),
             (settings.disparity_m_px, settings.disparity_step_px), (settings.min_range_m, settings.max_range_m))
    return tuple((np.float32(first), np.float32(second)) for first, second in pairs)


class ScanRows:
    """Reads a depth image as a planar scan: in each column the pixel whose ray is level, so that every beam runs at the
    camera's height, whatever its pitch. For an upright camera this is the row nearest to cy, the thesis's middle row.

    A column without a level ray (a camera that looks up or down too much) has no beam: its range is always NaN.
    """

    def __init__(self, camera: Camera, settings: Rgbd | Stereo) -> None:
        count = min(settings.beams or camera.width, camera.width)
        columns = np.rint(np.linspace(camera.width - 1, 0, count)).astype(int)  # right to left: bearings increase
        rows = _level_rows(camera, columns)
        reach = settings.scan_rows // 2
        self._columns = columns
        self._rows = np.clip(np.rint(rows)[None, :] + np.arange(-reach, reach + 1)[:, None], 0, camera.height - 1)
        self._rows = self._rows.astype(int)
        self._level = (rows > -0.5) & (rows < camera.height - 0.5)
        rays = camera.rays(np.stack([columns, rows], axis=1).astype(float)) @ camera.body_from_camera[:3, :3].T
        self._bearings = freeze(np.arctan2(rays[:, 1], rays[:, 0]))
        self._stretch = np.hypot(rays[:, 0], rays[:, 1])  # metres along the floor per metre of depth
        self._max_range_m = settings.max_range_m
        self._origin = (float(camera.body_from_camera[0, 3]), float(camera.body_from_camera[1, 3]))

    def scan(self, depth: np.ndarray) -> Scan:
        """Ranges (N,) from the camera along the floor; NaN where depth is unknown or beyond max_range_m."""
        rows = depth[self._rows, self._columns]
        middle = rows[0] if len(rows) == 1 else known_median(rows)
        ranges = middle.astype(float) * self._stretch
        ranges[~self._level | ~(ranges <= self._max_range_m)] = np.nan
        return Scan(self._bearings, freeze(ranges), self._max_range_m, self._origin)


def known_median(rows: np.ndarray) -> np.ndarray:
    """(N,) median of what is known of each column of (R, N); NaN where nothing is."""
    known = ~np.isnan(rows).all(axis=0)
    out = np.full(rows.shape[1], np.nan, rows.dtype)
    out[known] = np.nanmedian(rows[:, known], axis=0)
    return out


def _level_rows(camera: Camera, columns: np.ndarray) -> np.ndarray:
    """(N,) row (float) in each column whose ray has no vertical component in the body frame, found by Newton steps."""
    rows = np.full(len(columns), camera.cy)
    up = camera.body_from_camera[2, :3]
    for _ in range(10):
        slope = camera.rays(np.stack([columns, rows], axis=1).astype(float)) @ up
        ahead = camera.rays(np.stack([columns, rows + 1.0], axis=1).astype(float)) @ up
        step = slope / np.where(np.abs(ahead - slope) > 1e-12, ahead - slope, np.inf)
        rows = np.clip(rows - step, -10.0 * camera.height, 10.0 * camera.height)
    return rows
