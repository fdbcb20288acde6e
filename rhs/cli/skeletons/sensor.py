"""A sensor for rhs."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.errors import ContractError
from rhs.api.records import Capture, Observation


@dataclass
class Skeleton(Bounded):
    """A laser scanner whose ranges are wrong by a share of themselves, and wheels that count right."""

    range_share: float = within(0.01, 0.0, 1.0)
    """noise of a range, share of it (1 sigma)"""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "wheel", "command"})

    def build(self, context: Context) -> Part:
        return Part(self, context)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: Skeleton, context: Context) -> None:
        self.settings, self.camera, self.rng = settings, context.camera, context.rng

    def sense(self, capture: Capture) -> Observation:
        """What is reported of a view: index and stamp are the capture's. A recorded one (`sensed`) has its noise already."""
        scan = capture.scan
        if scan is None:
            raise ContractError(f"capture {capture.index} has no scan")
        if not capture.sensed:
            noise = self.settings.range_share * self.rng.standard_normal(len(scan.ranges_m))
            scan = replace(scan, ranges_m=np.maximum(scan.ranges_m * (1.0 + noise), 0.0))
        return Observation(capture.index, capture.stamp_s, self.camera, scan=scan, command=capture.command,
                           wheel=capture.travel)
