"""Settings of the odometry `fused`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import check_ranges

from ..clouds.gicp_config import Gicp
from ..features.procrustes_config import Procrustes


@dataclass
class FusedAdvanced:
    """Thresholds of `odometry=fused`, and the settings of the two odometries inside it."""

    few_normals: int = 80
    """fewer upright surfaces than this tell no direction of the walls"""
    upright: float = 0.2
    """a surface is upright when its normal rises by less than this (sine)"""
    near_deg: float = 6.0
    """surfaces this near to the direction that most share are counted to it, degrees"""
    gate_sigma: float = 4.0
    """a reading further off than this belongs to a wall that is not square to the others, sigmas"""
    sideways_share: float = 0.02
    """the command may be wrong sideways by this share of the distance (1 sigma)"""
    pictures: Procrustes = field(default_factory=Procrustes)
    shape: Gicp = field(default_factory=Gicp)

    def __post_init__(self) -> None:
        check_ranges("", self, few_normals=(1, 1_000_000), upright=(0.0, 1.0), near_deg=(0.1, 45.0),
                     gate_sigma=(0.1, 1000.0), sideways_share=(0.0, 10.0))


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
    advanced: FusedAdvanced = field(default_factory=FusedAdvanced)

    def __post_init__(self) -> None:
        command, degrees = (1e-5, 1.0), (1e-3, 30.0)
        check_ranges("odometry.fused", self, picture_widening=(0.1, 100.0), shape_widening=(0.1, 100.0),
                     command_forward_share=command, command_turn_share=command, command_floor_m=command,
                     command_floor_rad=command, disagreement=(1.0, 1e6), walls_sigma_deg=degrees,
                     right_angle_sigma_deg=degrees, walls_share=(0.1, 1.01))

    def build(self, context: Context) -> Odometry:
        from .fused import FusedOdometry

        return FusedOdometry(self, context)
