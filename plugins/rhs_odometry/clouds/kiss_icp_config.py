"""Settings of the odometry `kiss_icp`."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import within

from .settings import CloudSettings


@dataclass
class KissIcp(CloudSettings):
    """KISS-ICP on depth clouds: point-to-point ICP against a voxel map with an adaptive threshold."""

    voxel_m: float = within(0.1, 0.005, 5.0)
    """Side of the voxels of the map, metres; scans are thinned to half and then one and a half of it."""
    iterations: int = within(40, 1, 100)
    """Most iterations of one alignment; the library's own 500 take seconds where the scene says little."""
    initial_threshold_m: float = within(0.5, 0.01, 10.0)
    """First threshold of partners, metres."""
    min_motion_m: float = within(0.02, 0.0, 10.0)
    """The least motion that adapts the threshold of partners, metres."""

    def build(self, context: Context) -> Odometry:
        from .kiss_icp import build

        return build(self, context)
