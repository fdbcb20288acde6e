"""Has the robot watched its own way? Each view is compared with the one before, by key-points and scans
(rhs.estimation.views.motion_consistency)."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera
from rhs.api.records import Features, FeatureSettings, Motion, Observation, Scan, Tracking
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.views.features import features
from rhs.estimation.views.motion_consistency import Continuity, continuity, scan_continuity, scan_share
from rhs.estimation.views.settings import ContinuitySettings

USUAL = ContinuitySettings()


class ContinuityWatch:
    """Remembers the last view. walls: the map, or None for a robot without one. smooth_share: of a scan's ends on walls,
    above which a robot whose key-points cannot tell is still where it expects to be."""

    def __init__(self, settings: FeatureSettings, walls: ScanMatcher | None, rules: ContinuitySettings = USUAL,
                 *, smooth_share: float = 0.9) -> None:
        self._settings, self._walls, self._rules, self._smooth_share = settings, walls, rules, smooth_share
        self.begin()

    def begin(self) -> None:
        """The next view is the first one."""
        self._features: Features | None = None  # of the last view ...
        self._previous: Features | None = None  # ... and of the one before
        self._scan: Scan | None = None
        self._left: tuple[Features, np.ndarray] | None = None  # the last view before a break, and left_from_body

    def goes_on(self, observation: Observation, motion: Motion, expected: np.ndarray | None) -> Continuity:
        """Whether this view can be one motion after the last, which put the robot at `expected` (3,), None if unknown.

        One eye's key-points have no depth: there the odometry tells whether it followed enough points from the last view.
        Where the key-points cannot tell, measured scans do: they break where one cannot follow the other, and go on where
        the new one lies on the walls of the map as well. Key-points that break while half of the scan goes on are those of
        somebody who passes close by, and tell nothing; where most of the scan lies on walls too, nobody was carried off."""
        last, scan = self._features, self._scan
        self._features, self._scan = features(observation, self._settings), observation.scan
        if self._left is not None:
            self._left = self._left[0], self._left[1] @ motion.previous_from_body
        self._previous = last
        return self._compared(last, scan, observation, motion, expected)

    def keep_last(self, previous_from_body: np.ndarray) -> None:
        """The view before this one is the last before a break."""
        self._left = None if self._previous is None else (self._previous, previous_from_body)

    def resumed(self, camera: Camera) -> bool:
        """Whether this view goes on from the last one before the break: then somebody passed close by, and nobody was
        carried off."""
        if self._left is None or self._features is None:
            return False
        return continuity(self._left[0], self._features, camera, self._left[1], self._rules) is Continuity.GOES_ON

    def settle(self) -> None:
        """There is no break to be explained."""
        self._left = None

    def _compared(self, last: Features | None, scan: Scan | None, observation: Observation, motion: Motion,
                  expected: np.ndarray | None) -> Continuity:
        assert self._features is not None
        seen = continuity(last, self._features, observation.camera, motion.previous_from_body, self._rules)
        if seen is Continuity.BROKEN and self._passer_by(scan, motion):
            return Continuity.GOES_ON if self.on_walls(expected, self._rules.passer_by_walls) else Continuity.UNKNOWN
        if seen is not Continuity.UNKNOWN:
            return seen
        if motion.scan_measured and motion.status is Tracking.OK:
            return Continuity.GOES_ON
        if scan_continuity(scan, self._scan, motion.previous_from_body, self._rules) is Continuity.BROKEN:
            return Continuity.BROKEN
        return Continuity.GOES_ON if self.on_walls(expected) else seen

    def _passer_by(self, last: Scan | None, motion: Motion) -> bool:
        share = scan_share(last, self._scan, motion.previous_from_body, self._rules, fine=True)
        return share >= self._rules.passer_by_share

    def on_walls(self, pose: np.ndarray | None, share: float | None = None) -> bool:
        """Whether this share of the last scan, else smooth_share, lies on the walls of the map if taken at a pose (3,)."""
        if self._scan is None or self._walls is None or pose is None:
            return False
        return self._walls.share(self._scan, pose) >= (self._smooth_share if share is None else share)
