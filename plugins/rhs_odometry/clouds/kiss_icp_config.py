"""Settings of the odometry `kiss_icp`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import check_range

from .settings import CloudSettings

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Odometry


@dataclass
class KissIcp(CloudSettings):
    """KISS-ICP on depth clouds: point-to-point ICP against a voxel map with an adaptive threshold."""

    name: ClassVar[str] = "kiss_icp"

    voxel_m: float = 0.1
    """Side of the voxels of the map, metres; scans are thinned to half and then one and a half of it."""
    iterations: int = 40
    """Most iterations of one alignment; the library's own 500 take seconds where the scene says little."""
    initial_threshold_m: float = 0.5
    """First threshold of partners, metres."""
    min_motion_m: float = 0.02
    """The least motion that adapts the threshold of partners, metres."""

    def __post_init__(self) -> None:
        super().__post_init__()
        owner = f"odometry.{self.name}"
        check_range(owner, "voxel_m", self.voxel_m, low=0.005, high=5.0, unit="m")
        check_range(owner, "iterations", self.iterations, low=1, high=100)
        check_range(owner, "initial_threshold_m", self.initial_threshold_m, low=0.01, high=10.0, unit="m")
        check_range(owner, "min_motion_m", self.min_motion_m, low=0.0, high=10.0, unit="m")

    def build(self, context: Context) -> Odometry:
        from .kiss_icp import build

        return build(self, context)
