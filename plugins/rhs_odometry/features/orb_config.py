"""Settings of the odometry `orb`."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import one_of, within

from ..advanced import PatchSearch, SurfaceSettings
from .procrustes_config import Procrustes, ProcrustesAdvanced


@dataclass
class OrbAdvanced(ProcrustesAdvanced):
    """Thresholds of `odometry=orb`."""

    patches: PatchSearch = field(default_factory=PatchSearch)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)


@dataclass
class Orb(Procrustes):
    """Frame-to-frame RGB-D odometry with fast features: ORB instead of SIFT, otherwise as `procrustes`."""

    features: int = within(500, 20, 20_000)
    """key-points per view; twice as many cost a third more time"""
    ratio: float = within(0.85, 0.1, 1.0)
    """ratio test; binary descriptors are coarse, so it is looser than SIFT's"""
    hypotheses: int = 100
    """RANSAC: half of procrustes's, for speed"""
    placing: str = one_of("patches", "features")
    """patches: matched points are looked up again by their patches, to a tenth of a pixel; features: as ORB places
    them."""
    pixel_sigma_px: float = 0.7
    """how well a point is placed, pixels (1 sigma); 1.5 when ORB places it"""
    advanced: OrbAdvanced = field(default_factory=OrbAdvanced)

    def build(self, context: Context) -> Odometry:
        from .orb import OrbOdometry

        return OrbOdometry(self, context)
