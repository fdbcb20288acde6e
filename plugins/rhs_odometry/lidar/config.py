"""Settings of the odometries on a lidar's clouds: `vgicp_lidar` and `kiss_icp_lidar`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, within


@dataclass
class LidarAdvanced(Bounded):
    """Thresholds of both."""

    voxels_of_range: float = within(15.0, 1.0, 1000.0)
    """voxel_m=0: voxels of the map have this part of the median distance of the first cloud's points as their side"""
    neighbours: int = within(10, 3, 1000)
    """points that make the normal of one"""
    lean: float = within(0.5, 0.0, 1.0)
    """a normal counts for a direction when it leans into it by at least this (cosine; 0.5 is 30 degrees off its plane)"""
    thin: float = within(0.1, 0.0, 1.0)
    """neighbours lie on a plane where they spread across it by at most this share of their spread in it (variances) ..."""
    broad: float = within(0.05, 0.0, 1.0)
    """... and on no line: their second spread is at least this share of their first"""
    correlated: float = within(20.0, 1.0, 1e6)
    """neighbouring points err together: so many count as one"""
    least_m: float = within(0.02, 1e-9, 1.0)
    """no alignment is better than this, metres (1 sigma)"""
    least_rad: float = within(1e-3, 1e-9, 1.0)
    """nor its angles, radians (1 sigma)"""
    slipped_m: float = within(1.0, 1e-6, 100.0)
    """deviation along a direction that nothing holds, metres (1 sigma)"""
    leap_m: float = within(3.0, 1e-3, 1000.0)
    """an alignment further than this from its guess has locked on to something else, metres"""
    leap_rad: float = within(0.6, 1e-3, 3.2)
    """or turned further from it, radians"""


@dataclass
class VgicpAdvanced(LidarAdvanced):
    """Thresholds of `odometry=vgicp_lidar`."""

    voxels_of_range: float = 30.0
    """voxel_m=0: voxels of the map have this part of the median distance of the first cloud's points as their side"""
    partner_m: float = within(2.0, 0.01, 100.0)
    """without wheels: surfaces of two clouds on end fit together within this of each other, metres"""
    kept_clouds: int = within(100, 1, 1_000_000)
    """a voxel of the map in which no point of so many clouds fell is forgotten"""


@dataclass
class LidarOdometry(PartSettings):
    """What both are told of the clouds: the extra modality `cloud`, and `cloud_time_s` where a recording knows it."""

    needs: ClassVar[frozenset[str]] = frozenset({"cloud"})

    voxel_m: float = within(0.0, 0.0, 10.0)
    """Side of the voxels of the map, metres; 0: by how far the first cloud's points are (advanced.voxels_of_range)."""
    deskew: bool = True
    """Points whose time is known are moved to where they would have been at the stamp of their cloud, as the robot moves."""
    min_range_m: float = within(0.5, 0.0, 100.0, below="max_range_m")
    """Nearer points are the robot itself, metres."""
    max_range_m: float = within(100.0, 0.1, 1000.0)
    """Further points are not used, metres (KISS-ICP's authors' habit)."""
    min_points: int = within(100, 10, 1_000_000)
    """Fewer points than this are no cloud: lost."""
    min_support: float = within(0.03, 0.0, 1.0)
    """Degenerate when a smaller share of the points holds the weakest horizontal direction, as in a tunnel."""
    point_sigma_m: float = within(0.05, 1e-4, 1.0)
    """Noise of a point along its surface's normal, metres (1 sigma)."""
    iterations: int = within(100, 1, 500)
    """Most iterations of one alignment."""
    advanced: LidarAdvanced = field(default_factory=LidarAdvanced)


@dataclass
class VgicpLidar(LidarOdometry):
    """Voxelised generalised ICP of a lidar's clouds against a map of Gaussians (small_gicp)."""

    advanced: VgicpAdvanced = field(default_factory=VgicpAdvanced)

    def build(self, context: Context) -> Odometry:
        from .vgicp import Vgicp

        return Vgicp(self)


@dataclass
class KissIcpLidar(LidarOdometry):
    """KISS-ICP on the point clouds of a lidar: points against points, to compare with."""

    initial_threshold_m: float = within(2.0, 0.01, 100.0)
    """First threshold of partners, metres (the authors')."""
    min_motion_m: float = within(0.1, 0.0, 10.0)
    """The least motion that adapts the threshold of partners, metres (the authors')."""

    def build(self, context: Context) -> Odometry:
        from .kiss_icp import KissIcp

        return KissIcp(self)
