"""Settings of the odometry `fused`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, within

from ..clouds.config import Gicp
from ..features.config import Procrustes


@dataclass
class FusedAdvanced(Bounded):
    """Thresholds of `odometry=fused`, and the settings of the two odometries inside it."""

    few_normals: int = within(80, 1, 1_000_000)
    """fewer upright surfaces than this tell no direction of the walls"""
    upright: float = within(0.2, 0.0, 1.0)
    """a surface is upright when its normal rises by less than this (sine)"""
    near_deg: float = within(6.0, 0.1, 45.0)
    """surfaces this near to the direction that most share are counted to it, degrees"""
    gate_sigma: float = within(4.0, 0.1, 1000.0)
    """a reading further off than this belongs to a wall that is not square to the others, sigmas"""
    sideways_share: float = within(0.02, 0.0, 10.0)
    """the command may be wrong sideways by this share of the distance (1 sigma)"""
    pictures: Procrustes = field(default_factory=Procrustes)
    shape: Gicp = field(default_factory=Gicp)


@dataclass
class Fused(PartSettings):
    """Pictures with depth where they show something, the shape of the walls where they do not, joined per direction."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})

    picture_widening: float = within(1.5, 0.1, 100.0)
    """Sigmas of what procrustes says are multiplied by this: errors of neighbouring views go together."""
    shape_widening: float = within(2.0, 0.1, 100.0)
    """Sigmas of what gicp says are multiplied by this: errors of neighbouring views go together."""
    command_forward_share: float = within(0.04, 1e-5, 1.0)
    """The command's distance may be wrong by this share of it (1 sigma)."""
    command_turn_share: float = within(0.06, 1e-5, 1.0)
    """The command's turn may be wrong by this share of it (1 sigma)."""
    command_floor_m: float = within(0.003, 1e-5, 1.0)
    """The command's distance is never surer than this, metres (1 sigma)."""
    command_floor_rad: float = within(0.003, 1e-5, 1.0)
    """The command's turn is never surer than this, radians (1 sigma)."""
    disagreement: float = within(30.0, 1.0, 1e6)
    """An estimate further from the others than this (chi-square, 3 degrees of freedom) is left out."""
    walls_sigma_deg: float = within(0.5, 1e-3, 30.0)
    """The direction of the walls, known to a quarter turn, gives the heading: 1 sigma of one view's reading,
    degrees."""
    right_angle_sigma_deg: float = within(0.3, 1e-3, 30.0)
    """How far walls stray from right angles, degrees (1 sigma)."""
    walls_share: float = within(0.6, 0.1, 1.01)
    """Share of the upright surfaces that must agree on the direction of the walls; 1.01 leaves it out."""
    advanced: FusedAdvanced = field(default_factory=FusedAdvanced)

    def build(self, context: Context) -> Odometry:
        from .fused import FusedOdometry

        return FusedOdometry(self, context)
