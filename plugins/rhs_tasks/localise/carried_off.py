"""A source whose robot is carried off now and then, and told nothing: stretches of its views are left out.

What the wheels counted from view to view stays what it was: a robot in the air does not turn them.
"""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Source
from rhs.api.errors import RhsError
from rhs.api.records import Capture, Twist


class CarriedOff(Source):
    """The source, less a stretch of skip_m after every every_m of way, both by the truth, else by its wheels."""

    def __init__(self, source: Source, every_m: float, skip_m: float) -> None:
        self._source, self._every_m, self._skip_m = source, every_m, skip_m
        self.camera, self.facts, self.views_expected = source.camera, source.facts, source.views_expected
        self.provides, self.renderer, self.stamps_repaired = source.provides, source.renderer, source.stamps_repaired
        self.timed = source.timed
        self._way_m = 0.0
        self._last: np.ndarray | None = None
        self.fresh = False  # the last view is the first one elsewhere

    @property
    def lost(self) -> str:  # type: ignore[override]  # grows while a recording is read
        return self._source.lost

    @property
    def views_lost(self) -> int:  # type: ignore[override]
        return self._source.views_lost

    def lead(self) -> Capture | None:
        capture = self._next()
        self.fresh = self._way_m >= self._every_m
        if self.fresh:
            self._way_m = 0.0
            while capture is not None and self._way_m < self._skip_m:
                capture = self._next()
            self._way_m = 0.0
        return capture

    def _next(self) -> Capture | None:
        """The next view of the source; its way is added."""
        capture = self._source.lead()
        if capture is None:
            return None
        truth, before = self._source.truth(), self._last
        self._last = truth
        if truth is not None and before is not None:
            self._way_m += float(np.linalg.norm(truth[:2, 3] - before[:2, 3]))
        elif capture.travel is not None:
            self._way_m += float(np.hypot(*capture.travel[:2]))
        elif truth is None and capture.index > 0:
            raise RhsError("kidnap_every_m counts true way, or that of wheels, and this recording has neither; leave it out")
        return capture

    def begin_patrol(self) -> None:
        self._source.begin_patrol()

    def drive(self, command: Twist) -> Capture:
        return self._source.drive(command)

    def teleport(self, world_from_body: np.ndarray) -> None:
        self._source.teleport(world_from_body)

    def truth(self) -> np.ndarray | None:
        return self._source.truth()

    def clearance_m(self) -> tuple[float, bool]:
        return self._source.clearance_m()

    def close(self) -> None:
        self._source.close()
