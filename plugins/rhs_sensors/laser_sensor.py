"""The sensor `laser`: see its settings."""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import ContractError
from rhs.api.records import Capture, Observation, Scan

from .degrade import frozen
from .laser import Laser


class LaserSensor:
    """Hands on scan and wheel travel; the recording has put its own noise on both."""

    senses_ahead = True

    def __init__(self, settings: Laser, context: Context) -> None:
        self._settings, self._camera = settings, context.camera

    def sense(self, capture: Capture) -> Observation:
        if capture.scan is None:
            raise ContractError(f"capture {capture.index} has no laser scan; sensor=laser needs a recording with one")
        travel = None if capture.travel is None else frozen(np.array(capture.travel, float))
        return Observation(
            capture.index, capture.stamp_s, self._camera,
            scan=self._limited(capture.scan), command=capture.command, wheel=travel,
        )

    def _limited(self, scan: Scan) -> Scan:
        """The scan with readings out of range made unknown (near) or free (far)."""
        reach = min(self._settings.max_range_m, scan.max_range_m)
        with np.errstate(invalid="ignore"):
            ranges = np.where(scan.ranges_m < self._settings.min_range_m, np.nan, scan.ranges_m)
            ranges = np.where(ranges > reach, np.inf, ranges)
        return Scan(scan.bearings_rad, ranges, reach, scan.origin_xy_m)
