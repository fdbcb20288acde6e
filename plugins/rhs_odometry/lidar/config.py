"""Settings of the odometries on a lidar's clouds: `vgicp_lidar` and `kiss_icp_lidar`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import ConfigError, check_ranges


@dataclass
class LidarAdvanced:
    """Thresholds of both."""

    voxels_of_range: float = 15.0
    """voxel_m=0: voxels of the map have this part of the median distance of the first cloud's points as their side"""
    neighbours: int = 10
    """points that make the normal of one"""
    lean: float = 0.5
    """a normal counts for a direction when it leans into it by at least this (cosine; 0.5 is 30 degrees off its plane)"""
    thin: float = 0.1
    """neighbours lie on a plane where they spread across it by at most this share of their spread in it (variances) ..."""
    broad: float = 0.05
    """... and on no line: their second spread is at least this share of their first"""
    correlated: float = 20.0
    """neighbouring points err together: so many count as one"""
    least_m: float = 0.02
    """no alignment is better than this, metres (1 sigma)"""
    least_rad: float = 1e-3
    """nor its angles, radians (1 sigma)"""
    slipped_m: float = 1.0
    """deviation along a direction that nothing holds, metres (1 sigma)"""
    leap_m: float = 3.0
    """an alignment further than this from its guess has locked on to something else, metres"""
    leap_rad: float = 0.6
    """or turned further from it, radians"""

    def __post_init__(self) -> None:
        check_ranges("", self, voxels_of_range=(1.0, 1000.0), neighbours=(3, 1000), lean=(0.0, 1.0), thin=(0.0, 1.0),
                     broad=(0.0, 1.0), correlated=(1.0, 1e6),
                     least_m=(1e-9, 1.0), least_rad=(1e-9, 1.0), slipped_m=(1e-6, 100.0), leap_m=(1e-3, 1000.0),
                     leap_rad=(1e-3, 3.2))


@dataclass
class VgicpAdvanced(LidarAdvanced):
    """Thresholds of `odometry=vgicp_lidar`."""

    voxels_of_range: float = 30.0
    """voxel_m=0: voxels of the map have this part of the median distance of the first cloud's points as their side"""
    partner_m: float = 2.0
    """without wheels: surfaces of two clouds on end fit together within this of each other, metres"""
    kept_clouds: int = 100
    """a voxel of the map in which no point of so many clouds fell is forgotten"""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges("", self, partner_m=(0.01, 100.0), kept_clouds=(1, 1_000_000))


@dataclass
class LidarOdometry:
    """What both are told of the clouds: the extra modality `cloud`, and `cloud_time_s` where a recording knows it."""

    needs: ClassVar[frozenset[str]] = frozenset({"cloud"})
    provides: ClassVar[frozenset[str]] = frozenset()
    owner: ClassVar[str] = "odometry"

    voxel_m: float = 0.0
    """Side of the voxels of the map, metres; 0: by how far the first cloud's points are (advanced.voxels_of_range)."""
    deskew: bool = True
    """Points whose time is known are moved to where they would have been at the stamp of their cloud, as the robot moves."""
    min_range_m: float = 0.5
    """Nearer points are the robot itself, metres."""
    max_range_m: float = 100.0
    """Further points are not used, metres (KISS-ICP's authors' habit)."""
    min_points: int = 100
    """Fewer points than this are no cloud: lost."""
    min_support: float = 0.03
    """Degenerate when a smaller share of the points holds the weakest horizontal direction, as in a tunnel."""
    point_sigma_m: float = 0.05
    """Noise of a point along its surface's normal, metres (1 sigma)."""
    iterations: int = 100
    """Most iterations of one alignment."""
    advanced: LidarAdvanced = field(default_factory=LidarAdvanced)

    def __post_init__(self) -> None:
        check_ranges(self.owner, self, voxel_m=(0.0, 10.0), min_range_m=(0.0, 100.0), max_range_m=(0.1, 1000.0))
        if self.min_range_m >= self.max_range_m:
            raise ConfigError(f"{self.owner}.min_range_m={self.min_range_m} is not below max_range_m={self.max_range_m}")
        check_ranges(self.owner, self, min_points=(10, 1_000_000), min_support=(0.0, 1.0), point_sigma_m=(1e-4, 1.0),
                     iterations=(1, 500))


@dataclass
class VgicpLidar(LidarOdometry):
    """Voxelised generalised ICP of a lidar's clouds against a map of Gaussians (small_gicp)."""

    owner: ClassVar[str] = "odometry.vgicp_lidar"

    advanced: VgicpAdvanced = field(default_factory=VgicpAdvanced)

    def build(self, context: Context) -> Odometry:
        from .vgicp import Vgicp

        return Vgicp(self)


@dataclass
class KissIcpLidar(LidarOdometry):
    """KISS-ICP on the point clouds of a lidar: points against points, to compare with."""

    owner: ClassVar[str] = "odometry.kiss_icp_lidar"

    initial_threshold_m: float = 2.0
    """First threshold of partners, metres (the authors')."""
    min_motion_m: float = 0.1
    """The least motion that adapts the threshold of partners, metres (the authors')."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self.owner, self, initial_threshold_m=(0.01, 100.0), min_motion_m=(0.0, 10.0))

    def build(self, context: Context) -> Odometry:
        from .kiss_icp import KissIcp

        return KissIcp(self)
