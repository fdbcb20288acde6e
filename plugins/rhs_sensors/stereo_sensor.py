"""The sensor `stereo`: noise on both images, depth from their disparity (stereo_matching), the scans of a depth camera, and
before plain walls, which have no disparity, where the floor ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import ContractError
from rhs.api.frozen import freeze
from rhs.api.records import Capture, Observation, Scan
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_of
from rhs.estimation.scans.floor_end import FloorEnds, filled
from rhs.estimation.scans.obstacle_scan import ObstacleScanner

from .degrade import Encoders, image_of, noisy_image, size
from .rgbd_sensor import ScanRows
from .stereo import Stereo
from .stereo_coarse import CoarsePair
from .stereo_matching import StereoPair

WIDER = 5  # bearings that a block of the smaller images spans
BEFORE = 0.85  # of the range of what is known: nearer than its noise (rhs.estimation.scans.obstacle_scan)


class StereoSensor:
    """Each noise has its own random stream, so that one setting does not change another's numbers."""

    senses_ahead = True

    def __init__(self, settings: Stereo, context: Context) -> None:
        self._settings = settings
        self._camera = context.camera
        self._left_rng, self._right_rng, wheel_rng = context.rng.spawn(3)
        self._encoders = Encoders(settings, wheel_rng)
        self._pair: StereoPair | None = None  # the second camera comes with the first capture
        self._band: ObstacleScanner | None = None
        self._coarse: CoarsePair | None = None

    def sense(self, capture: Capture) -> Observation:
        clean, clean_right = image_of(capture, self._camera), self._right_of(capture)
        pair = self._pair or self._meet(capture)
        sigma = self._settings.image_sigma if self._settings.noise and not capture.sensed else 0.0
        image, right = noisy_image(clean, sigma, self._left_rng), noisy_image(clean_right, sigma, self._right_rng)
        depth = freeze(pair.depth(image, right))
        scan, obstacle = self._scans(depth, image, right)
        return Observation(
            capture.index,
            capture.stamp_s,
            self._camera,
            image=image,
            depth=depth,
            scan=scan,
            command=capture.command,
            wheel=self._encoders.read(capture.travel, exact=capture.sensed),
            extras={RIGHT_IMAGE: right},
            obstacle=obstacle,
        )

    def _scans(self, depth: np.ndarray, image: np.ndarray, right: np.ndarray) -> tuple[Scan, Scan | None]:
        """The scan at the camera's height and that of obstacles, both up to the end of the floor where depth is blank; of
        obstacles nearly plain ones too."""
        scan = self._rows.scan(depth)
        if self._band is None:
            return scan, None
        z = self._band.thinned(depth)
        floor = self._band.floor(z)
        obstacle = self._band.scan(depth, floor)
        if self._coarse is not None:
            obstacle = _nearer(obstacle, self._band.scan(self._coarse.depth(image, right, np.isfinite(depth)), floor))
        if not np.isnan(scan.ranges_m).any():
            return scan, obstacle
        ends, bearings = self._ends.ranges(z, floor), self._band.bearings_rad
        walls = np.where(np.isinf(ends), np.nan, ends)  # the floor goes on, and nobody knows what stands on it there
        free = ends if self._ends.reach_m >= obstacle.max_range_m else walls
        return filled(scan, bearings, walls), filled(obstacle, bearings, free)

    def _right_of(self, capture: Capture) -> np.ndarray:
        """The right image. Raises ContractError where there is none, or of another size."""
        for name in (RIGHT_IMAGE, RIGHT_CAMERA):
            if name not in capture.extras:
                raise ContractError(f"capture {capture.index} has no {name}; sensor=stereo needs a source with two cameras")
        right = capture.extras[RIGHT_IMAGE]
        wanted = (self._camera.height, self._camera.width, 3)
        if right.shape != wanted:
            raise ContractError(f"capture {capture.index}: the right image is {size(right)}, the left one "
                                f"{wanted[1]}x{wanted[0]}")
        return right

    def _meet(self, capture: Capture) -> StereoPair:
        """Get to know the second camera."""
        self._pair = pair = StereoPair(self._camera, camera_of(capture.extras[RIGHT_CAMERA]), self._settings)
        self._rows = ScanRows(self._camera, replace(self._settings, max_range_m=float(pair.max_range_m)))
        if self._camera.height_m > 0.0:  # of a recording whose camera hangs nobody knows where, nobody knows the floor
            advanced = self._settings.advanced
            self._band = ObstacleScanner(self._camera, advanced.obstacle, max_range_m=pair.max_range_m)
            sure_m = (1.0 - 2.0 * self._settings.depth_error_share) * pair.max_range_m  # nearer ends are not the reach's
            if advanced.coarser:
                self._coarse = CoarsePair(self._camera, camera_of(capture.extras[RIGHT_CAMERA]), self._settings)
            self._ends = FloorEnds(self._band, advanced.floor_end, sure_m=sure_m)
        return pair


def _nearer(scan: Scan, coarse: Scan) -> Scan:
    """The scan, with what the other one of the same bearings sees before all that this one sees there. What smaller images
    show is wider than it is by half a block on either side."""
    from scipy.ndimage import binary_erosion, minimum_filter1d

    solid = binary_erosion(np.isfinite(coarse.ranges_m), np.ones(WIDER), border_value=1)
    known = np.where(np.isnan(scan.ranges_m), np.inf, scan.ranges_m)
    seen = solid & (coarse.ranges_m < BEFORE * minimum_filter1d(known, WIDER, mode="nearest"))
    return replace(scan, ranges_m=freeze(np.where(seen, coarse.ranges_m, scan.ranges_m)))
