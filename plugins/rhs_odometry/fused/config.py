"""Settings of the odometry `fused`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from rhs.api.errors import check_range

if TYPE_CHECKING:
    from rhs.api.contracts import Context


@dataclass
class Fused:
    """Pictures with depth where they show something, the shape of the walls where they do not, joined per direction."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset()

    picture_widening: float = 1.5
    """Sigmas of what procrustes says are multiplied by this: errors of neighbouring views go together."""
    shape_widening: float = 2.0
    """Sigmas of what gicp says are multiplied by this: errors of neighbouring views go together."""
    command_forward_share: float = 0.04
    """The command's distance may be wrong by this share of it (1 sigma)."""
    command_turn_share: float = 0.06
    """The command's turn may be wrong by this share of it (1 sigma)."""
    command_floor_m: float = 0.003
    """The command's distance is never surer than this, metres (1 sigma)."""
    command_floor_rad: float = 0.003
    """The command's turn is never surer than this, radians (1 sigma)."""
    disagreement: float = 30.0
    """An estimate further from the others than this (chi-square, 3 degrees of freedom) is left out."""
    walls_sigma_deg: float = 0.5
    """The direction of the walls, known to a quarter turn, gives the heading: 1 sigma of one view's reading,
    degrees."""
    right_angle_sigma_deg: float = 0.3
    """How far walls stray from right angles, degrees (1 sigma)."""
    walls_share: float = 0.6
    """Share of the upright surfaces that must agree on the direction of the walls; 1.01 leaves it out."""

    def __post_init__(self) -> None:
        owner = "odometry.fused"
        for name in ("picture_widening", "shape_widening"):
            check_range(owner, name, getattr(self, name), low=0.1, high=100.0)
        for name in ("command_forward_share", "command_turn_share", "command_floor_m", "command_floor_rad"):
            check_range(owner, name, getattr(self, name), low=1e-5, high=1.0)
        check_range(owner, "disagreement", self.disagreement, low=1.0, high=1e6)
        for name in ("walls_sigma_deg", "right_angle_sigma_deg"):
            check_range(owner, name, getattr(self, name), low=1e-3, high=30.0, unit="degrees")
        check_range(owner, "walls_share", self.walls_share, low=0.1, high=1.01)

    def build(self, context: Context) -> Any:
        from .fused import FusedOdometry

        return FusedOdometry(self, context)
