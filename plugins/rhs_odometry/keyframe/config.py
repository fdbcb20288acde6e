"""Settings of `odometry=keyframe`: the accurate visual odometry with depth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry, PartSettings
from rhs.api.errors import Bounded, within

from ..advanced import DirectSettings, GuessNoise, PatchSearch, SurfaceSettings, SwaySettings


@dataclass
class KeyframeAdvanced(Bounded):
    """Thresholds of `odometry=keyframe`."""

    gate: float = within(5.0, 0.5, 1000.0)
    """a sighting off by more than so many deviations (Mahalanobis, 3 degrees of freedom) is no inlier"""
    student_dof: float = within(5.0, 0.5, 1e6)
    """degrees of freedom of the Student's t that weighs sightings (Kerl et al. 2013)"""
    trusted_share: float = within(0.25, 0.0, 1.0)
    """a fit is believed at once when this share of the followed points (and twice min_inliers) agrees; else features are
    matched"""
    found_share: float = within(0.8, 0.0, 10.0)
    """patches are looked for where the guess puts them; when fewer than this share of those that ought to be in view agree,
    Lucas-Kanade brings the points near first"""
    wheels_probability: float = within(0.999999, 0.5, 1.0 - 1e-12)
    """points that the wheels contradict so surely (chi-square test) are looked for once more where the wheels put them"""
    direct_share: float = within(0.3, 0.0, 1.0)
    """in a hand a view with fewer inliers than this share of `points` is laid on an earlier one by all its pixels, too,"""
    corner_share: float = within(0.5, 0.0, 1.0)
    """or with fewer than this share of the points followed: the others were noise, and are not missed"""
    outvote: float = within(3.0, 0.0, 1e6)
    """so many times min_inliers are right where they contradict all pixels"""
    least_full: float = within(0.25, 0.0, 1.0)
    """but fewer points than keep_share of this share of `points` make a key frame in any case"""
    rescue_features: int = within(600, 20, 100_000)
    """ORB key-points compared when following fails"""
    rescue_ratio: float = within(0.85, 0.1, 1.0)
    """Lowe's ratio of these matches"""
    rescue_px: float = within(2.0, 0.05, 100.0)
    """how well ORB places a key-point, pixels (1 sigma)"""
    rescue_hypotheses: int = within(200, 1, 100_000)
    """RANSAC: three-point motions tried then"""
    rescue_gate_sigma: float = within(3.0, 0.5, 100.0)
    """a pair further off than this many sigmas is an outlier"""
    relocate_tries: int = within(10, 1, 1000)
    """key frames of the map that a lost view is matched with"""
    relocate_views: int = within(90, 0, 1_000_000)
    """after so many views not found again a new part of the map is begun, of which nobody knows where it lies"""
    relocate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """chance that wheels or a command err by no more than what finding the camera again may move it"""
    relocate_every: int = within(3, 1, 1000)
    """while it is not found, every so many views are made key frames and looked for"""
    floor_stretch: float = within(1.5, 1.0, 10.0)
    """on a floor, where the camera goes smoothly, a key frame is made after so many times the way and the turn, and when so
    much less of the last one's points is followed; 1: as in a hand"""
    floor_points: int = within(120, 0, 5000)
    """where fewer points than this are followed, no smaller share of them will do on a floor than in a hand"""
    floor_settled: float = within(1e-3, 0.0, 0.1)
    """on a floor a step of the pose graph that lowers what its edges cost by less than this share is the last: drift is
    little; in a hand one in a thousand million"""
    left_m: float = within(2.0, 0.0, 1e6)
    """in a hand as many key frames again are looked up of those that so much way ago were left, metres; a radian of turning
    counts as one"""
    min_edge: int = within(20, 6, 100_000)
    """inliers that make a relative pose worth an edge of the graph"""
    edge_share: float = within(0.4, 0.0, 1.0)
    """and least share of the points looked up"""
    correlated: float = within(4.0, 1.0, 1e4)
    """the points of one view err together (blur, lens, depth calibration): so many count as one"""
    least_edge_m: float = within(1e-3, 1e-9, 1.0)
    """no edge is better than this, metres (1 sigma)"""
    least_edge_rad: float = within(3e-4, 1e-9, 1.0)
    """nor its angles, radians (1 sigma): a fiftieth of a degree"""
    sharpest: float = within(0.5, 0.0, 1.0)
    """averaging makes an inverse depth no surer than this share of one reading's deviation: errors of a depth camera are the
    same from view to view (Kinect: a smooth distortion)"""
    held: int = within(150, 4, 1_000_000)
    """key frames the map holds at most, a bound on memory and time: beyond it the one whose place another shows as well is
    given up for each new one"""
    picture_mb: float = within(15.0, 0.0, 1e6)
    """of their pictures that lie ready, megabytes (0.1 each at 320x240, all that are held; 0.4 at 640x480); the others are
    packed to a third without loss, 1.6 ms each at 320x240"""
    settle_rounds: int = within(15, 1, 10_000)
    """most steps of the pose graph when a key frame is found again"""
    spacing_share: float = within(0.03, 0.001, 0.5)
    """least distance between followed points, share of the image height"""
    visible_per_m: float = within(0.05, 0.0, 10.0)
    """a point is in view when the inverse depth measured there is its own up to this, 1/m"""
    guess: GuessNoise = field(default_factory=GuessNoise)
    sway: SwaySettings = field(default_factory=SwaySettings)
    patches: PatchSearch = field(default_factory=PatchSearch)
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    direct: DirectSettings = field(default_factory=DirectSettings)


@dataclass
class Keyframe(PartSettings):
    """Frame to key-frame map: Lucas-Kanade tracks, robust Gauss-Newton, old key frames found again, a pose graph."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})

    points: int = within(400, 30, 5000)
    """Points followed at a time; more cost time in proportion and gain little."""
    window_px: int = within(15, 5, 61)
    """Side of the patch that Lucas-Kanade matches, pixels."""
    pixel_sigma: float = within(0.6, 0.05, 20.0)
    """Deviation of one sighting, pixels. Measured 0.15 on sharp images, 0.2 in the simulator, more when a hand
    shakes."""
    inverse_depth_sigma: float = within(0.002, 1e-5, 0.5)
    """Deviation of one inverse depth, 1/m, averaged over a window: measured 0.0006 in the simulator, 0.001 of a
    still PrimeSense, 0.004 of a shaken Kinect; 0.002 means sigma_z = 0.002 z^2."""
    shake_m: float = within(0.003, 0.0, 1.0)
    """A hand shakes: how far the motion while an image is read (Camera.readout_s) differs from the motion between the
    images, metres per image interval. No effect on a global shutter."""
    shake_deg: float = within(0.5, 0.0, 45.0)
    """A hand shakes: the same for the turn, degrees per image interval. No effect on a global shutter."""
    keep_share: float = within(0.6, 0.05, 1.0)
    """A new key frame is made when fewer than this share of the last one's points is still followed. This and the next two
    are stretched on a floor: advanced.floor_stretch."""
    keep_turn_deg: float = within(15.0, 0.5, 90.0)
    """A new key frame is made after turning this far from the last one, degrees."""
    keep_move_m: float = within(0.2, 0.01, 10.0)
    """A new key frame is made after moving this far from the last one, metres."""
    min_inliers: int = within(12, 6, 1000)
    """Fewer inliers than this is no measurement: lost."""
    planar: bool = True
    """The camera stands on a robot on a floor: keep the motion in the plane. No effect on a hand-held camera."""
    max_sigma_m: float = within(0.05, 1e-6, 100.0)
    """Degenerate when a direction of the translation is less sure than this, metres (1 sigma)."""
    max_sigma_rad: float = within(0.05, 1e-6, 10.0)
    """Degenerate when an axis of the rotation is less sure than this, radians (1 sigma)."""
    revisit: int = within(2, 0, 10)
    """Old key frames looked up again at every new one; 0 makes it a plain key-frame odometry."""
    advanced: KeyframeAdvanced = field(default_factory=KeyframeAdvanced)

    def build(self, context: Context) -> Odometry:
        from .keyframe import KeyframeOdometry

        return KeyframeOdometry(self, context)
