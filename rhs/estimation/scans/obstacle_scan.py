"""The nearest thing between the floor and the robot's height on every bearing of a depth image.

The floor is found in each view, not assumed: a plane through the level patches below the camera by iteratively reweighted
least squares (Tukey's biweight, narrower from pass to pass; Holland and Welsch 1977). What rises above it by more
than its own noise and reaches no higher than the robot is an obstacle; what hangs higher is not. Loads numba: import it
when it is needed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.frozen import freeze
from rhs.api.geometry import Camera, exp_so3, se3
from rhs.api.jit import compiled
from rhs.api.records import Scan

from .settings import BandSettings

WIDTHS_M = (0.4, 0.16, 0.08, 0.04, 0.03)  # of the biweight, pass by pass: beginning at what a tilted camera explains
LOW_M = 0.16  # the floor is this near to where it should be below the camera: a wrong height of the camera
PLANE_SIGMA = np.array([0.1, 0.05, 0.05])  # of the plane (m, 1, 1) where too little floor is seen to say
POINT_SIGMA_M = 0.02  # of one patch, its neighbours share its error
SPAN_PX = 3  # rows of the thinned image that a patch spans


class ObstacleScanner:
    """Reads depth images of one camera. max_range_m: of the sensor; further things are left out beyond settings.range_m."""

    def __init__(self, camera: Camera, settings: BandSettings, *, max_range_m: float) -> None:
        self.settings = settings
        every = max(1, round(camera.width / settings.columns))
        self._thin = slice(every // 2, None, every)
        rows, columns = np.arange(camera.height)[self._thin], np.arange(camera.width)[self._thin]
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
        rays = camera.rays(pixels) @ camera.body_from_camera[:3, :3].T
        self._rays = rays.reshape(len(rows), len(columns), 3).astype(np.float32)
        self._eye_m = camera.body_from_camera[:3, 3].astype(np.float32)
        self._flat = np.hypot(self._rays[..., 0], self._rays[..., 1])
        self._reach_m = min(settings.range_m, max_range_m)
        bearing = np.arctan2(self._rays[..., 1], self._rays[..., 0])
        self.bearings_rad = freeze(np.sort(bearing[len(rows) // 2]).astype(float))
        between = 0.5 * (self.bearings_rad[1:] + self.bearings_rad[:-1])
        self.beam_of = np.searchsorted(between, bearing).astype(np.int32)  # (rows, columns) each pixel's nearest beam
        self._origin = (float(self._eye_m[0]), float(self._eye_m[1]))
        self.height_m = settings.robot_height_m or camera.height_m + settings.headroom_m
        self._blind_m = self._seen_from_m()

    def thinned(self, depth: np.ndarray) -> np.ndarray:
        """The pixels of a depth image (H, W) that are looked at."""
        return np.ascontiguousarray(depth[self._thin, self._thin], np.float32)

    def scan(self, depth: np.ndarray, floor: tuple[np.ndarray, bool] | None = None, depth_times: float = 1.0) -> Scan:
        """Ranges (N,) of a depth image (H, W): NaN where most of a bearing is unknown, inf where nothing stands in reach.
        floor: of this image, if it is known. depth_times: noise of its depth, times a Kinect's."""
        z = self.thinned(depth)
        plane, known = self.floor(z) if floor is None else floor
        slack = np.float32(depth_times * self.settings.floor_per_m + (0.0 if known else self.settings.unsure_per_m))
        ranges = _nearest(z, self._rays, self._flat, self.beam_of, self._eye_m, plane.astype(np.float32),
                          (np.float32(self.settings.floor_m), slack, np.float32(self.height_m), np.float32(self._reach_m)))
        return Scan(self.bearings_rad, freeze(ranges), self._reach_m, self._origin, self._blind_m)

    def heights(self, z: np.ndarray, plane: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the pixels of a thinned depth image: metres above a floor (3,), NaN unknown; metres away along the floor;
        whether they look down."""
        x, y, up = self._points(z)
        return up - (plane[0] + plane[1] * x + plane[2] * y), z * self._flat, self._rays[..., 2] < 0.0

    def floor(self, z: np.ndarray) -> tuple[np.ndarray, bool]:
        """((3,) a, b, c of the floor a + b x + c y in the body frame, whether it was seen) of a thinned depth image."""
        settings = self.settings
        x, y, up = self._points(z)
        low, high = slice(SPAN_PX, None, 2), slice(None, -SPAN_PX, 2)
        with np.errstate(invalid="ignore"):
            along = np.hypot(x[low] - x[high], y[low] - y[high])
            away = np.hypot(x[low], y[low])
            level = np.abs(up[low] - up[high]) < settings.level_slope * along
            near = (away < settings.floor_within_m) & (np.abs(up[low]) < LOW_M + settings.most_tilt * away)
        x, y, up = (part[low][level & near].astype(float) for part in (x, y, up))
        if len(x) < settings.floor_patches:
            return np.zeros(3), False
        return _plane(np.stack([np.ones_like(x), x, y], axis=1), up)

    def _points(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """x, y and z in the body frame of the pixels of a thinned depth image."""
        x, y, up = (z * self._rays[..., axis] + self._eye_m[axis] for axis in range(3))
        return x, y, up

    def _seen_from_m(self) -> float:
        """Metres from which on all above the floor is in the picture; the whole reach of a camera that never sees it."""
        lowest = self._rays[-1, :, 2] / self._flat[-1]
        if lowest.max() >= 0.0:
            return self._reach_m
        return float(min(self._reach_m, (self._eye_m[2] - self.settings.floor_m) / -lowest.max()))


def levelled(camera: Camera, floor: np.ndarray) -> Camera:
    """The camera above a level floor, where its body sees the floor (3,) a + b x + c y: turned about the horizontal axis
    that brings the floor's normal up."""
    normal = np.array([-floor[1], -floor[2], 1.0]) / np.sqrt(1.0 + floor[1] ** 2 + floor[2] ** 2)
    axis = np.array([normal[1], -normal[0], 0.0])
    length = float(np.hypot(*axis[:2]))
    turn = exp_so3(axis / length * np.arctan2(length, normal[2])) if length > 0.0 else np.eye(3)
    return replace(camera, body_from_camera=se3(turn, np.zeros(3)) @ camera.body_from_camera)


def _plane(terms: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, bool]:
    """Reweighted least squares of up = terms @ plane, and whether a third of the patches lie on it."""
    prior = np.diag(1.0 / PLANE_SIGMA**2)
    plane, share = np.zeros(3), 0.0
    for width in WIDTHS_M:
        off = (up - terms @ plane) / width
        weight = np.where(np.abs(off) < 1.0, (1.0 - off**2) ** 2, 0.0)
        share = float(np.mean(np.abs(off) < 1.0))
        weighed = terms * (weight / POINT_SIGMA_M**2)[:, None]
        plane = np.linalg.solve(weighed.T @ terms + prior, weighed.T @ up)
    return (plane, True) if share > 1.0 / 3.0 else (np.zeros(3), False)


@compiled
def _nearest(z: np.ndarray, rays: np.ndarray, flat: np.ndarray, bins: np.ndarray, eye: np.ndarray, plane: np.ndarray,
             band: tuple[np.float32, np.float32, np.float32, np.float32]) -> np.ndarray:
    """(N,) least range over the rows of each bearing of what lies in the band, two neighbouring rows agreeing."""
    rows, columns = z.shape
    least, slack, top, reach = band
    ranges = np.full(columns, np.inf)
    known, of = np.zeros(columns, np.int32), np.zeros(columns, np.int32)  # pixels of the beam
    for j in range(columns):
        before = np.inf
        for i in range(rows):
            beam = bins[i, j]
            of[beam] += 1
            depth = z[i, j]
            here = np.inf
            if depth > 0.0:
                known[beam] += 1
                away = depth * flat[i, j]
                x, y = eye[0] + depth * rays[i, j, 0], eye[1] + depth * rays[i, j, 1]
                height = eye[2] + depth * rays[i, j, 2] - (plane[0] + plane[1] * x + plane[2] * y)
                if away <= reach and height < top and height > least + slack * away:
                    here = away
                    if abs(here - before) < 0.15 * here:
                        ranges[beam] = min(ranges[beam], here, before)
            before = here
    for k in range(columns):
        if np.isinf(ranges[k]) and 2 * known[k] <= of[k]:
            ranges[k] = np.nan
    return ranges
