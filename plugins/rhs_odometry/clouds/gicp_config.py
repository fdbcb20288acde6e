"""Settings of the odometry `gicp`."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import within

from .settings import CloudAdvanced, CloudSettings


@dataclass
class GicpAdvanced(CloudAdvanced):
    """Thresholds of `odometry=gicp`."""

    neighbours: int = within(10, 3, 1000)
    """points that make the covariance of one"""
    min_inlier_share: float = within(0.2, 0.0, 1.0)
    """share of the cloud that must find a partner"""


@dataclass
class Gicp(CloudSettings):
    """Generalised ICP of thinned depth clouds against a key cloud (small_gicp)."""

    voxel_m: float = within(0.05, 0.005, 5.0)
    """Clouds are thinned to one point per cube of this side, metres."""
    keep_move_m: float = within(0.4, 0.0, 10.0)
    """A new key cloud is taken after moving this far from it, metres."""
    keep_turn_deg: float = within(12.0, 0.0, 180.0)
    """A new key cloud is taken after turning this far from it, degrees."""
    reach_m: float = within(0.3, 0.01, 10.0)
    """Points are neighbours up to this distance, metres."""
    iterations: int = within(30, 1, 100)
    """Most iterations of one alignment."""
    advanced: GicpAdvanced = field(default_factory=GicpAdvanced)

    def build(self, context: Context) -> Odometry:
        from .gicp import build

        return build(self, context)
