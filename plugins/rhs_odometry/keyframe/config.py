"""Settings of `odometry=keyframe`: the accurate visual odometry with depth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.errors import check_range


@dataclass
class Keyframe:
    """Frame to key-frame map: Lucas-Kanade tracks, robust Gauss-Newton, old key frames found again, a pose graph."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset()

    points: int = 400
    """Points followed at a time; more cost time in proportion and gain little."""
    window_px: int = 15
    """Side of the patch that Lucas-Kanade matches, pixels."""
    pixel_sigma: float = 0.6
    """Deviation of one sighting, pixels. Measured 0.15 on sharp images, 0.2 in the simulator, more when a hand
    shakes."""
    inverse_depth_sigma: float = 0.002
    """Deviation of one inverse depth, 1/m, averaged over a window: measured 0.0006 in the simulator, 0.001 of a
    still PrimeSense, 0.004 of a shaken Kinect; 0.002 means sigma_z = 0.002 z^2."""
    shake_m: float = 0.003
    """A hand shakes: how far the motion while an image is read (Camera.readout_s) differs from the motion between the
    images, metres per image interval. No effect on a global shutter."""
    shake_deg: float = 0.5
    """A hand shakes: the same for the turn, degrees per image interval. No effect on a global shutter."""
    keep_share: float = 0.6
    """A new key frame is made when fewer than this share of the last one's points is still followed."""
    keep_turn_deg: float = 15.0
    """A new key frame is made after turning this far from the last one, degrees."""
    keep_move_m: float = 0.2
    """A new key frame is made after moving this far from the last one, metres."""
    min_inliers: int = 12
    """Fewer inliers than this is no measurement: lost."""
    planar: bool = True
    """The camera stands on a robot on a floor: keep the motion in the plane. No effect on a hand-held camera."""
    max_sigma_m: float = 0.05
    """Degenerate when a direction of the translation is less sure than this, metres (1 sigma)."""
    max_sigma_rad: float = 0.05
    """Degenerate when an axis of the rotation is less sure than this, radians (1 sigma)."""
    revisit: int = 2
    """Old key frames looked up again at every new one; 0 makes it a plain key-frame odometry."""

    def __post_init__(self) -> None:
        owner = "odometry.keyframe"
        check_range(owner, "points", self.points, low=30, high=5000)
        check_range(owner, "window_px", self.window_px, low=5, high=61, unit="pixels")
        check_range(owner, "pixel_sigma", self.pixel_sigma, low=0.05, high=20.0, unit="pixels")
        check_range(owner, "inverse_depth_sigma", self.inverse_depth_sigma, low=1e-5, high=0.5, unit="1/m")
        check_range(owner, "keep_share", self.keep_share, low=0.05, high=1.0)
        check_range(owner, "keep_turn_deg", self.keep_turn_deg, low=0.5, high=90.0, unit="degrees")
        check_range(owner, "keep_move_m", self.keep_move_m, low=0.01, high=10.0, unit="m")
        check_range(owner, "min_inliers", self.min_inliers, low=6, high=1000)
        check_range(owner, "shake_m", self.shake_m, low=0.0, high=1.0, unit="m")
        check_range(owner, "shake_deg", self.shake_deg, low=0.0, high=45.0, unit="degrees")
        check_range(owner, "max_sigma_m", self.max_sigma_m, low=1e-6, high=100.0, unit="m")
        check_range(owner, "max_sigma_rad", self.max_sigma_rad, low=1e-6, high=10.0, unit="rad")
        check_range(owner, "revisit", self.revisit, low=0, high=10)

    def build(self, context):
        from .keyframe import KeyframeOdometry

        return KeyframeOdometry(self, context)
