"""The sensor `lidar`: a recorded point cloud of a scanner that looks around in space, which passes as an extra modality."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Sensor
from rhs.api.errors import Bounded, ContractError, within
from rhs.api.frozen import freeze
from rhs.api.records import Capture, Observation, Scan


@dataclass
class Lidar(Bounded):
    """A lidar's point clouds (the extra modality `cloud`) and wheel travel, for recordings; the map is of a band of them."""

    needs: ClassVar[frozenset[str]] = frozenset({"cloud"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    low_m: float = within(0.1, -100.0, 100.0, below="high_m")
    """the scan is the nearest point on each bearing from this height over the body's origin, metres; above the floor"""
    high_m: float = within(1.0, -100.0, 100.0)
    """up to this height, metres"""
    beams: int = within(360, 8, 10_000)
    """beams of the scan, all around"""
    min_range_m: float = within(0.5, 0.0, 100.0, below="max_range_m")
    """nearer points are the robot itself, metres"""
    max_range_m: float = within(50.0, 0.1, 1000.0)
    """further points do not enter the scan, metres"""

    def build(self, context: Context) -> Sensor:
        return LidarSensor(self, context)


class LidarSensor:
    """Reads a band of the cloud as a planar scan; the recording has put its own noise on it."""

    senses_ahead = True

    def __init__(self, settings: Lidar, context: Context) -> None:
        self._settings, self._camera = settings, context.camera
        step = 2.0 * np.pi / settings.beams
        self._bearings = freeze((np.arange(settings.beams) + 0.5) * step - np.pi)

    def sense(self, capture: Capture) -> Observation:
        if "cloud" not in capture.extras:
            raise ContractError(f"capture {capture.index} has no cloud; sensor=lidar needs a recording with point clouds")
        travel = None if capture.travel is None else freeze(np.array(capture.travel, float))
        return Observation(capture.index, capture.stamp_s, self._camera, scan=self._scan(capture.extras["cloud"]),
                           command=capture.command, wheel=travel)

    def _scan(self, cloud: np.ndarray) -> Scan:
        """The nearest point of each bearing within the band; NaN where there is none: between its rings a lidar is blind."""
        s = self._settings
        points = np.asarray(cloud, float)
        ranges = np.hypot(points[:, 0], points[:, 1])
        used = (points[:, 2] >= s.low_m) & (points[:, 2] <= s.high_m) & (ranges >= s.min_range_m) & (ranges <= s.max_range_m)
        turn = np.arctan2(points[used, 1], points[used, 0])
        beam = np.minimum(((turn + np.pi) * (s.beams / (2.0 * np.pi))).astype(int), s.beams - 1)
        nearest = np.full(s.beams, np.inf)
        np.minimum.at(nearest, beam, ranges[used])
        return Scan(self._bearings, freeze(np.where(np.isfinite(nearest), nearest, np.nan)), s.max_range_m)
