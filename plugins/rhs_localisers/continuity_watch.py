"""Has the robot watched its own way? Each view is compared with the one before, by key-points and scans
(rhs.estimation.views.motion_consistency). Where it may spare key-points the scan is asked first: while that goes on and lies
on the walls, key-points are compared only as often as half of what the last of them saw leaves the view."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera, inverse, transform
from rhs.api.records import Features, FeatureSettings, Motion, Observation, Scan, Tracking
from rhs.estimation.scans.scan_match import ScanMatcher
from rhs.estimation.views.explainability import in_view
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
        self._features: Features | None = None  # of the last view whose key-points were looked for ...
        self._since = np.eye(4)  # ... the motion since then, ...
        self._previous: tuple[Features, np.ndarray] | None = None  # ... and the one before it, with the motion between them
        self._scan: Scan | None = None
        self._image: np.ndarray | None = None
        self.spared = False  # the last view's key-points were not looked for
        self._left: tuple[Features, np.ndarray] | None = None  # the last view before a break, and left_from_body

    def goes_on(self, observation: Observation, motion: Motion, expected: np.ndarray | None, *,
                sparing: bool = False) -> Continuity:
        """Whether this view can be one motion after the last, which put the robot at `expected` (3,), None if unknown.

        One camera's key-points have no depth: there the odometry tells whether it followed enough points from the last view.
        Where the key-points cannot tell, measured scans do: they break where one cannot follow the other, and go on where
        the new one lies on the walls of the map as well. Key-points that break while half of the scan goes on are those of
        somebody who passes close by, and tell nothing; where most of the scan lies on walls too, and the odometry did not
        lose its way, nobody was carried off.
        sparing: do not look for key-points where the scan alone says that the view goes on."""
        scan, self._scan = self._scan, observation.scan
        still = self._hangs(observation)
        self._since = self._since @ motion.previous_from_body
        if self._left is not None:
            self._left = self._left[0], self._left[1] @ motion.previous_from_body
        self.spared = sparing and not still and self._vouches(scan, motion, expected) and self.overlaps(observation.camera)
        if self.spared:
            return Continuity.GOES_ON
        self._previous = None if self._features is None else (self._features, self._since)
        self._features, self._since = features(observation, self._settings), np.eye(4)
        return self._compared(scan, observation, motion, expected)

    def _hangs(self, observation: Observation) -> bool:
        """Whether the picture is the last one: no camera sees the same twice, but one that hangs."""
        last, self._image = self._image, observation.image
        return last is not None and self._image is not None and np.array_equal(last, self._image)

    def overlaps(self, camera: Camera, motion: np.ndarray | None = None) -> bool:
        """Whether half of the last key-points with depth, and enough to tell anything, are still in view; after one more
        motion (4x4). Half: as much again may be lost until the next view, where they have to be compared."""
        if self._features is None:
            return False
        since = self._since if motion is None else self._since @ motion
        points = self._features.points
        points = points[np.isfinite(points[:, 2])].astype(float)
        seen_from_last = inverse(since @ camera.body_from_camera) @ camera.body_from_camera
        left = int(in_view(transform(seen_from_last, points), camera)[1].sum())
        return left >= max(0.5 * len(points), self._rules.telling_pairs)

    def keep_last(self) -> None:
        """The view before this one is the last before a break."""
        self._left = self._previous

    def resumed(self, camera: Camera) -> bool:
        """Whether this view goes on from the last one before the break: then somebody passed close by, and nobody was
        carried off."""
        if self._left is None or self._features is None:
            return False
        return continuity(self._left[0], self._features, camera, self._left[1], self._rules) is Continuity.GOES_ON

    def settle(self) -> None:
        """There is no break to be explained."""
        self._left = None

    def _vouches(self, last: Scan | None, motion: Motion, expected: np.ndarray | None) -> bool:
        """Whether the odometry followed its way, and the scan goes on from the last one and lies on the walls: whatever the
        key-points were to say, `_compared` would then say that the view goes on."""
        return motion.status is Tracking.OK and self.on_walls(expected) and self._passer_by(last, motion) and (
            scan_continuity(last, self._scan, motion.previous_from_body, self._rules) is Continuity.GOES_ON)

    def _compared(self, scan: Scan | None, observation: Observation, motion: Motion,
                  expected: np.ndarray | None) -> Continuity:
        assert self._features is not None
        last, since = self._previous or (None, np.eye(4))
        seen = continuity(last, self._features, observation.camera, since, self._rules)
        if seen is Continuity.BROKEN and self._passer_by(scan, motion):
            alike = self.on_walls(expected, self._rules.passer_by_walls)
            return Continuity.GOES_ON if alike and self._followed(scan, motion) else Continuity.UNKNOWN
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

    def _followed(self, last: Scan | None, motion: Motion) -> bool:
        """Whether the odometry followed its way, or so much of the scan goes on that it need not: half of one goes on in
        another room as well, now and then."""
        return motion.status is Tracking.OK or scan_continuity(
            last, self._scan, motion.previous_from_body, self._rules) is Continuity.GOES_ON

    def on_walls(self, pose: np.ndarray | None, share: float | None = None) -> bool:
        """Whether this share of the last scan, else smooth_share, lies on the walls of the map if taken at a pose (3,)."""
        if self._scan is None or self._walls is None or pose is None:
            return False
        return self._walls.share(self._scan, pose) >= (self._smooth_share if share is None else share)
