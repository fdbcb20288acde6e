"""Settings of the odometries on depth clouds, `gicp` and `kiss_icp`, and what they share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, one_of, within

from ..advanced import GuessNoise


@dataclass
class CloudAdvanced(Bounded):
    """Thresholds of the odometries that align clouds."""

    lean: float = within(0.5, 0.0, 1.0)
    """a normal counts for a direction when it leans into it by at least this (cosine; 0.5 is 30 degrees off its plane)"""
    slide_m: float = within(0.15, 1e-4, 10.0)
    """how far the view is slid to see what leaves its surface, metres; about one step of a robot"""
    sure_sigmas: float = within(5.0, 0.1, 1000.0)
    """deviations that noise does not explain"""
    correlated: float = within(20.0, 1.0, 1e6)
    """neighbouring readings of a depth camera err together: so many count as one"""
    least_m: float = within(1e-3, 1e-9, 1.0)
    """no alignment is better than this, metres (1 sigma)"""
    least_rad: float = within(5e-4, 1e-9, 1.0)
    """nor its angles, radians (1 sigma)"""
    slipped_m: float = within(0.5, 1e-6, 100.0)
    """deviation along a direction that nothing holds, metres (1 sigma)"""
    leap_m: float = within(1.0, 1e-3, 1000.0)
    """an alignment further than this from its guess has locked on to something else, metres"""
    leap_rad: float = within(0.6, 1e-3, 3.2)
    """or turned further from it, radians"""
    misfit: float = within(0.25, 0.0, 1000.0)
    """an alignment is doubted when another motion lays the surfaces of two views on each other better by so much (mean
    squared distance in sigmas) ..."""
    gate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """... and its covariance does not explain the difference (chance that it does where the alignment is right)"""
    turned_m: float = within(0.0, 0.0, 10.0)
    """an alignment errs by so much more for each radian that the view turns, metres (1 sigma); 0.1, and a share
    of 0.08, is what `kiss_icp` errs by: it is then less often wrong and sure, and more often lost"""
    turned_share: float = within(0.0, 0.0, 1.0)
    """and by this share of the turn (1 sigma)"""
    guess: GuessNoise = field(default_factory=GuessNoise)


@dataclass
class CloudSettings(PartSettings):
    """How a depth image becomes a cloud, what motion is expected, and when the shape says too little."""

    needs: ClassVar[frozenset[str]] = frozenset({"depth"})

    guess: str = one_of("motion", "last")
    """Where an alignment starts: motion (wheels, else the command, else the last motion) or last (the last motion)."""
    stride_px: int = within(4, 1, 64)
    """One point per square of this side, pixels."""
    min_range_m: float = within(0.3, 0.0, 100.0, below="max_range_m")
    """Depths nearer than this are not used, metres."""
    max_range_m: float = within(8.0, 0.1, 1000.0)
    """Depths beyond this are not used, metres."""
    min_points: int = within(100, 10, 1_000_000)
    """Fewer points than this are no cloud: lost."""
    min_support: float = within(0.025, 0.0, 1.0)
    """Degenerate when a smaller share of the points holds the weakest direction. A bare corner is seen by up to
    0.024, small relief by 0.048 or more (simulated squares, seeds 100 to 102)."""
    slipping: str = one_of("report", "guess")
    """Along a direction that is not held: report what the alignment says, or take the guess (wheels, command) there."""
    planar: bool = True
    """The camera stands on a robot: keep the motion on the floor; no effect when it is hand-held."""
    advanced: CloudAdvanced = field(default_factory=CloudAdvanced)


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
        from .gicp import GicpRegistration
        from .odometry import CloudOdometry

        return CloudOdometry(self, context, GicpRegistration(self))


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
        from .kiss_icp import KissRegistration
        from .odometry import CloudOdometry

        return CloudOdometry(self, context, KissRegistration(self))
