"""Settings of the odometries `procrustes` and `orb`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, one_of, within

from ..advanced import GuessNoise, PatchSearch, SurfaceSettings, SwaySettings


@dataclass
class ProcrustesAdvanced(Bounded):
    """Thresholds of `odometry=procrustes`."""

    reference_age: int = within(5, 0, 10_000)
    """a reference view is given up after so many lost views: by then the robot looks at something else"""
    wheels_probability: float = within(0.999999, 0.5, 1.0 - 1e-12)
    """a motion that the wheels contradict so surely (chi-square test) is held against those that the other pairs agree on"""
    movers: int = within(2, 0, 100)
    """so many motions of things that move before the camera are set aside at most"""
    guess: GuessNoise = field(default_factory=GuessNoise)
    sway: SwaySettings = field(default_factory=SwaySettings)


@dataclass
class Procrustes(PartSettings):
    """Frame-to-frame RGB-D odometry: SIFT, RANSAC on the rigid model, weighted Procrustes (thesis section 3.1)."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})

    refine: str = one_of("reprojection", "none")
    """none: the thesis; reprojection: then Gauss-Newton on pixels and inverse depth, each weighed by the noise that the
    view shows (pixel_sigma_px and the depth noise are what is expected before)"""
    planar: bool = True
    """the camera stands on a robot: keep the motion on the floor; no effect when it is hand-held"""
    hypotheses: int = within(200, 1, 100_000)
    """RANSAC: three-point motions tried per view"""
    gate_sigma: float = within(4.0, 0.5, 100.0)
    """a pair of points further off than this many sigmas is an outlier; 3 loses good ones on blur"""
    pixel_sigma_px: float = within(0.5, 0.01, 100.0)
    """how well a key-point is placed, pixels (1 sigma), as measured in the simulator"""
    depth_constant_m: float = within(0.002, 1e-5, 1.0)
    """Depth noise: sigma_z = constant + quadratic * (z - 0.4 m)^2, metres; more than a Kinect's 0.0012 (Nguyen
    2012), because colour and depth are never quite registered."""
    depth_quadratic_per_m: float = within(0.0019, 0.0, 1.0)
    """Depth noise: the quadratic part of sigma_z, 1/m (Nguyen 2012, Kinect); see depth_constant_m."""
    min_inliers: int = within(12, 4, 100_000)
    """fewer agreeing pairs than this and the view is lost"""
    max_sigma_m: float = within(0.05, 1e-6, 100.0)
    """degenerate when a direction of the translation is less sure than this, metres"""
    max_sigma_rad: float = within(0.05, 1e-6, 10.0)
    """degenerate when an axis of the rotation is less sure than this, radians"""
    advanced: ProcrustesAdvanced = field(default_factory=ProcrustesAdvanced)

    def build(self, context: Context) -> Odometry:
        from .procrustes import ProcrustesOdometry

        return ProcrustesOdometry(self, context)


@dataclass
class OrbAdvanced(ProcrustesAdvanced):
    """Thresholds of `odometry=orb`."""

    patches: PatchSearch = field(default_factory=PatchSearch)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)


@dataclass
class Orb(Procrustes):
    """Frame-to-frame RGB-D odometry with fast features: ORB instead of SIFT, otherwise as `procrustes`."""

    features: int = within(500, 20, 20_000)
    """key-points per view; twice as many cost a third more time"""
    ratio: float = within(0.85, 0.1, 1.0)
    """ratio test; binary descriptors are coarse, so it is looser than SIFT's"""
    hypotheses: int = 100
    """RANSAC: half of procrustes's, for speed"""
    placing: str = one_of("patches", "features")
    """patches: matched points are looked up again by their patches, to a tenth of a pixel; features: as ORB places
    them."""
    pixel_sigma_px: float = 0.7
    """how well a point is placed, pixels (1 sigma); 1.5 when ORB places it"""
    advanced: OrbAdvanced = field(default_factory=OrbAdvanced)

    def build(self, context: Context) -> Odometry:
        from .orb import OrbOdometry

        return OrbOdometry(self, context)
