"""Settings of the odometry `kiss_icp`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import check_ranges

from .settings import CloudSettings


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
        check_ranges(owner, self, voxel_m=(0.005, 5.0), iterations=(1, 100), initial_threshold_m=(0.01, 10.0),
                     min_motion_m=(0.0, 10.0))

    def build(self, context: Context) -> Odometry:
        from .kiss_icp import build

        return build(self, context)
