"""Settings of the odometry `gicp`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import check_ranges

from .settings import CloudAdvanced, CloudSettings


@dataclass
class GicpAdvanced(CloudAdvanced):
    """Thresholds of `odometry=gicp`."""

    neighbours: int = 10
    """points that make the covariance of one"""
    min_inlier_share: float = 0.2
    """share of the cloud that must find a partner"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, neighbours=(3, 1000), min_inlier_share=(0.0, 1.0))


@dataclass
class Gicp(CloudSettings):
    """Generalised ICP of thinned depth clouds against a key cloud (small_gicp)."""

    name: ClassVar[str] = "gicp"

    voxel_m: float = 0.05
    """Clouds are thinned to one point per cube of this side, metres."""
    keep_move_m: float = 0.4
    """A new key cloud is taken after moving this far from it, metres."""
    keep_turn_deg: float = 12.0
    """A new key cloud is taken after turning this far from it, degrees."""
    reach_m: float = 0.3
    """Points are neighbours up to this distance, metres."""
    iterations: int = 30
    """Most iterations of one alignment."""
    advanced: GicpAdvanced = field(default_factory=GicpAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        owner = f"odometry.{self.name}"
        check_ranges(owner, self, voxel_m=(0.005, 5.0), keep_move_m=(0.0, 10.0), keep_turn_deg=(0.0, 180.0),
                     reach_m=(0.01, 10.0), iterations=(1, 100))

    def build(self, context: Context) -> Odometry:
        from .gicp import build

        return build(self, context)
