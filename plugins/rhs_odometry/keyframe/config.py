"""Settings of `odometry=keyframe`: the accurate visual odometry with depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import check_ranges

from ..advanced import DirectSettings, GuessNoise, PatchSearch, SurfaceSettings, SwaySettings


@dataclass
class KeyframeAdvanced:
    """Thresholds of `odometry=keyframe`."""

    gate: float = 5.0
    """a sighting off by more than so many deviations (Mahalanobis, 3 degrees of freedom) is no inlier"""
    student_dof: float = 5.0
    """degrees of freedom of the Student's t that weighs sightings (Kerl et al. 2013)"""
    trusted_share: float = 0.25
    """a fit is believed at once when this share of the followed points (and twice min_inliers) agrees; else features are
    matched"""
    found_share: float = 0.8
    """patches are looked for where the guess puts them; when fewer than this share of those that ought to be in view agree,
    Lucas-Kanade brings the points near first"""
    wheels_probability: float = 0.999999
    """points that the wheels contradict so surely (chi-square test) are looked for once more where the wheels put them"""
    direct_share: float = 0.3
    """in a hand a view with fewer inliers than this share of `points` is laid on an earlier one by all its pixels, too,"""
    corner_share: float = 0.5
    """or with fewer than this share of the points followed: the others were noise, and are not missed"""
    outvote: float = 3.0
    """so many times min_inliers are right where they contradict all pixels"""
    least_full: float = 0.25
    """but fewer points than keep_share of this share of `points` make a key frame in any case"""
    rescue_features: int = 600
    """ORB key-points compared when following fails"""
    rescue_ratio: float = 0.85
    """Lowe's ratio of these matches"""
    rescue_px: float = 2.0
    """how well ORB places a key-point, pixels (1 sigma)"""
    rescue_hypotheses: int = 200
    """RANSAC: three-point motions tried then"""
    rescue_gate_sigma: float = 3.0
    """a pair further off than this many sigmas is an outlier"""
    relocate_tries: int = 10
    """key frames of the map that a lost view is matched with"""
    relocate_views: int = 90
    """after so many views not found again a new part of the map is begun, of which nobody knows where it lies"""
    relocate_probability: float = 0.999
    """chance that wheels or a command err by no more than what finding the camera again may move it"""
    relocate_every: int = 3
    """while it is not found, every so many views are made key frames and looked for"""
    floor_stretch: float = 1.5
    """on a floor, where the camera goes smoothly, a key frame is made after so many times the way and the turn, and when so
    much less of the last one's points is followed; 1: as in a hand"""
    floor_points: int = 120
    """where fewer points than this are followed, no smaller share of them will do on a floor than in a hand"""
    floor_settled: float = 1e-3
    """on a floor a step of the pose graph that lowers what its edges cost by less than this share is the last: drift is
    little; in a hand one in a thousand million"""
    left_m: float = 2.0
    """in a hand as many key frames again are looked up of those that so much way ago were left, metres; a radian of turning
    counts as one"""
    min_edge: int = 20
    """inliers that make a relative pose worth an edge of the graph"""
    edge_share: float = 0.4
    """and least share of the points looked up"""
    correlated: float = 4.0
    """the points of one view err together (blur, lens, depth calibration): so many count as one"""
    least_edge_m: float = 1e-3
    """no edge is better than this, metres (1 sigma)"""
    least_edge_rad: float = 3e-4
    """nor its angles, radians (1 sigma): a fiftieth of a degree"""
    sharpest: float = 0.5
    """averaging makes an inverse depth no surer than this share of one reading's deviation: errors of a depth camera are the
    same from view to view (Kinect: a smooth distortion)"""
    held: int = 150
    """key frames the map holds at most, a bound on memory and time: beyond it the one whose place another shows as well is
    given up for each new one"""
    picture_mb: float = 15.0
    """of their pictures that lie ready, megabytes (0.1 each at 320x240, all that are held; 0.4 at 640x480); the others are
    packed to a third without loss, 1.6 ms each at 320x240"""
    settle_rounds: int = 15
    """most steps of the pose graph when a key frame is found again"""
    spacing_share: float = 0.03
    """least distance between followed points, share of the image height"""
    visible_per_m: float = 0.05
    """a point is in view when the inverse depth measured there is its own up to this, 1/m"""
    guess: GuessNoise = field(default_factory=GuessNoise)
    sway: SwaySettings = field(default_factory=SwaySettings)
    patches: PatchSearch = field(default_factory=PatchSearch)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    direct: DirectSettings = field(default_factory=DirectSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, gate=(0.5, 1000.0), student_dof=(0.5, 1e6), trusted_share=(0.0, 1.0), found_share=(0.0, 10.0),
                     direct_share=(0.0, 1.0), corner_share=(0.0, 1.0), outvote=(0.0, 1e6),
                     least_full=(0.0, 1.0),
                     wheels_probability=(0.5, 1.0 - 1e-12), rescue_features=(20, 100_000), rescue_ratio=(0.1, 1.0),
                     rescue_px=(0.05, 100.0),
                     rescue_hypotheses=(1, 100_000), rescue_gate_sigma=(0.5, 100.0), min_edge=(6, 100_000),
                     relocate_tries=(1, 1000), relocate_views=(0, 1_000_000), relocate_every=(1, 1000), left_m=(0.0, 1e6),
                     relocate_probability=(0.5, 1.0 - 1e-12),
                     edge_share=(0.0, 1.0), correlated=(1.0, 1e4), least_edge_m=(1e-9, 1.0), least_edge_rad=(1e-9, 1.0),
                     sharpest=(0.0, 1.0), held=(4, 1_000_000), picture_mb=(0.0, 1e6),
                     floor_stretch=(1.0, 10.0), floor_points=(0, 5000), floor_settled=(0.0, 0.1),
                     settle_rounds=(1, 10_000), spacing_share=(0.001, 0.5),
                     visible_per_m=(0.0, 10.0))


@dataclass
class Keyframe:
    """Frame to key-frame map: Lucas-Kanade tracks, robust Gauss-Newton, old key frames found again, a pose graph."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset()

    points: int = 400
    """Points followed at a time; more cost time in proportion and gain little."""
    window_px: int = 15
    """Side of the patch that Lucas-Kanade matches, pixels."""
    pixel_sigma: float = 0.6
    """Deviation of one sighting, pixels. Measured 0.15 on sharp images, 0.2 in the simulator, more when a hand
    shakes."""
    inverse_depth_sigma: float = 0.002
    """Deviation of one inverse depth, 1/m, averaged over a window: measured 0.0006 in the simulator, 0.001 of a
    still PrimeSense, 0.004 of a shaken Kinect; 0.002 means sigma_z = 0.002 z^2."""
    shake_m: float = 0.003
    """A hand shakes: how far the motion while an image is read (Camera.readout_s) differs from the motion between the
    images, metres per image interval. No effect on a global shutter."""
    shake_deg: float = 0.5
    """A hand shakes: the same for the turn, degrees per image interval. No effect on a global shutter."""
    keep_share: float = 0.6
    """A new key frame is made when fewer than this share of the last one's points is still followed. This and the next two
    are stretched on a floor: advanced.floor_stretch."""
    keep_turn_deg: float = 15.0
    """A new key frame is made after turning this far from the last one, degrees."""
    keep_move_m: float = 0.2
    """A new key frame is made after moving this far from the last one, metres."""
    min_inliers: int = 12
    """Fewer inliers than this is no measurement: lost."""
    planar: bool = True
    """The camera stands on a robot on a floor: keep the motion in the plane. No effect on a hand-held camera."""
    max_sigma_m: float = 0.05
    """Degenerate when a direction of the translation is less sure than this, metres (1 sigma)."""
    max_sigma_rad: float = 0.05
    """Degenerate when an axis of the rotation is less sure than this, radians (1 sigma)."""
    revisit: int = 2
    """Old key frames looked up again at every new one; 0 makes it a plain key-frame odometry."""
    advanced: KeyframeAdvanced = field(default_factory=KeyframeAdvanced)

    def __post_init__(self) -> None:
        check_ranges("odometry.keyframe", self, points=(30, 5000), window_px=(5, 61), pixel_sigma=(0.05, 20.0),
                     inverse_depth_sigma=(1e-5, 0.5), keep_share=(0.05, 1.0), keep_turn_deg=(0.5, 90.0),
                     keep_move_m=(0.01, 10.0), min_inliers=(6, 1000), shake_m=(0.0, 1.0), shake_deg=(0.0, 45.0),
                     max_sigma_m=(1e-6, 100.0), max_sigma_rad=(1e-6, 10.0), revisit=(0, 10))

    def build(self, context: Context) -> Odometry:
        from .keyframe import KeyframeOdometry

        return KeyframeOdometry(self, context)
