"""The sensor `laser`: see its settings."""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import ContractError
from rhs.api.records import Capture, Observation, Scan

from .degrade import Encoders, frozen
from .laser import Laser


class LaserSensor:
    """Scan and wheel travel; a recording has put its own noise on both. Each noise has its own random stream."""

    senses_ahead = True

    def __init__(self, settings: Laser, context: Context) -> None:
        self._settings, self._camera = settings, context.camera
        self._range_rng, wheel_rng = context.rng.spawn(2)
        self._encoders = Encoders(settings, wheel_rng)

    def sense(self, capture: Capture) -> Observation:
        if capture.scan is None:
            raise ContractError(f"capture {capture.index} has no laser scan; sensor=laser needs a recording with one, or "
                                "source.laser_beams of the simulator")
        return Observation(
            capture.index, capture.stamp_s, self._camera,
            scan=self._measured(capture.scan, exact=capture.sensed), command=capture.command,
            wheel=self._encoders.read(capture.travel, exact=capture.sensed),
        )

    def _measured(self, scan: Scan, *, exact: bool) -> Scan:
        """The scan with noise, and with readings out of range made unknown (near) or free (far)."""
        settings, ranges = self._settings, scan.ranges_m
        reach = min(settings.max_range_m, scan.max_range_m)
        if settings.noise and not exact:
            ranges = ranges + settings.range_sigma_m * self._range_rng.standard_normal(len(ranges))
        with np.errstate(invalid="ignore"):
            ranges = np.where(ranges < settings.min_range_m, np.nan, ranges)
            ranges = np.where(ranges > reach, np.inf, ranges)
        return Scan(scan.bearings_rad, frozen(ranges), reach, scan.origin_xy_m)
