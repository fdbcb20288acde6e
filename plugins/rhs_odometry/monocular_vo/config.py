"""Settings of `odometry=monocular_vo`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import Bounded, within


@dataclass
class MonocularVoAdvanced(Bounded):
    """Thresholds of `odometry=monocular_vo`."""

    gate_px: float = within(3.0, 0.1, 100.0)
    """a point seen further than this from where it should be is no inlier, pixels"""
    huber_px: float = within(1.0, 0.01, 100.0)
    """beyond this a sighting pulls with constant force (Huber), pixels"""
    start_share: float = within(0.7, 0.1, 1.0)
    """a first pair of views is taken when this share of its points lies in front of both and fits"""
    keep_share: float = within(0.7, 0.05, 1.0)
    """a key frame is made when fewer of the last one's points are still followed"""
    keep_parallax_px: float = within(7.0, 1.0, 1000.0)
    """and when points have moved by this much since the last key frame beyond what turning explains, pixels of an image 320
    wide (median)"""
    window: int = within(7, 3, 50)
    """key frames that are refined together; the two oldest of them stay"""
    rounds: int = within(6, 1, 100)
    """steps of Levenberg-Marquardt at each key frame"""
    new_parallax_deg: float = within(1.0, 0.05, 45.0)
    """a point is added to the map when it was seen under at least this angle, degrees (ORB-SLAM: 1.1)"""
    scale_frames: int = within(20, 1, 10_000)
    """key frames whose way by the wheels gives the scale"""
    give_up: int = within(5, 0, 10_000)
    """after so many lost views on end a new map is begun"""


@dataclass
class MonocularVo(Bounded):
    """One camera anywhere: points followed, essential matrix, a local map with bundle adjustment; scale of wheels or
    command, else unknown."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan"})

    points: int = within(300, 30, 5000)
    """points followed at a time"""
    window_px: int = within(15, 5, 61)
    """side of the patch that Lucas-Kanade matches, pixels"""
    pixel_sigma: float = within(0.7, 0.05, 20.0)
    """deviation of one sighting, pixels"""
    start_parallax_deg: float = within(1.5, 0.05, 45.0)
    """the map is begun when the first points are seen under this angle, degrees (median): before it nobody knows how far
    anything is"""
    first_depth_m: float = within(0.0, 0.0, 1e4)
    """median distance of what is seen at the start along the optical axis, metres, if somebody knows; 0: unknown"""
    min_inliers: int = within(20, 8, 1000)
    """fewer points than this agree: lost"""
    max_sigma_share: float = within(0.05, 1e-6, 10.0)
    """degenerate when a direction of the way since the last view is less sure than this share of the points' distance"""
    advanced: MonocularVoAdvanced = field(default_factory=MonocularVoAdvanced)

    def build(self, context: Context) -> Odometry:
        from .odometry import MonocularVoOdometry

        return MonocularVoOdometry(self, context)
