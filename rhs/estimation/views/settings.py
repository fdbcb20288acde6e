"""Thresholds of what is judged from views, light to import: plugins nest these classes in their `advanced` settings.

Distances in pixels are those of an image 320 pixels wide and grow with the width.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import Bounded, within

REFERENCE_WIDTH_PX = 320.0


@dataclass(frozen=True)
class RansacSettings(Bounded):
    """Search for the rigid motion that most pairs of points agree with (Fischler and Bolles 1981)."""

    hypotheses: int = within(200, 1, 100_000)
    """three-point motions tried: with half the pairs wrong, 200 miss the right one once in 4e11"""
    gate_sigma: float = within(3.0, 0.5, 100.0)
    """a pair further off than this many sigmas is an outlier"""


@dataclass(frozen=True)
class SightingSettings(Bounded):
    """The geometric check of one view against another."""

    min_inliers: int = within(15, 3, 100_000)
    """key-points that must agree on one motion"""
    min_coverage: float = within(0.0, 0.0, 1.0)
    """least share of the key-points which ought to be seen again, were the place the same, that are"""
    ratio: float = within(0.8, 0.1, 1.0)
    """Lowe's ratio of the matches"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    depth_share: float = within(0.0, 0.0, 1.0)
    """depths are wrong by this share of them beside a Kinect's noise (1 sigma): where one camera read them off
    its pictures"""


@dataclass(frozen=True)
class ExplainSettings(Bounded):
    """How much of a view the stored views near a pose explain (rhs.estimation.views.explainability)."""

    views: int = within(4, 1, 100)
    """stored views, nearest first, whose key-points are drawn into the view"""
    near_m: float = within(2.0, 0.01, 100.0)
    """stored views this near a pose may show what is seen from it, metres"""
    near_deg: float = within(40.0, 1.0, 180.0)
    """and turned away from it by no more than this, degrees"""
    pixels_px: float = within(5.0, 0.5, 100.0)
    """a key-point is found within this distance of where it is drawn, pixels of an image 320 wide"""
    likeness: float = within(0.75, -1.0, 1.0)
    """with at least this cosine of the descriptors"""
    depth_share: float = within(0.08, 0.0, 10.0)
    """at the same depth up to this share of it, where it is known"""
    depth_m: float = within(0.05, 0.0, 10.0)
    """and up to this constant, metres"""
    telling: int = within(60, 0, 100_000)
    """a view with fewer key-points says nothing by not being recognised, nor does one near stored views with fewer: of
    bare walls they hold some 30, and hardly any view of them is named"""
    expected_m: float = within(0.8, 0.01, 100.0)
    """a view ought to be recognised where a stored view stands this near, metres"""
    expected_deg: float = within(20.0, 1.0, 180.0)
    """and looks the same way up to this, degrees"""
    expected_score: float = within(0.25, 0.0, 1.0)
    """and its neighbours explain so much of it, as of a named place that counts (`strong`): a quarter of the stored views
    have less than 0.36 to 0.43 in three buildings with paintings, three quarters less than 0.24 in one of plain boxes"""
    silence: float = within(5.0, 1.0, 1e6)
    """how much likelier it is that no place is recognised somewhere else than where one ought to be: of views beside the
    surveyed way 1 to 10 % are not recognised (measured on the bundled buildings), of views that look the other way
    nearly all"""


@dataclass(frozen=True)
class ThumbnailSettings(Bounded):
    """Direct comparison of a view's blocks with those of the stored views (rhs.estimation.views.thumbnails)."""

    views: int = within(2, 1, 100)
    """stored views, nearest first, that the blocks are compared with"""
    grey: float = within(0.7, 1e-3, 255.0)
    """noise and rounding of the mean over a block, grey levels of 255 (1 sigma)"""
    slope_share: float = within(0.5, 0.0, 10.0)
    """where the picture has a slope, two views from poses a few pixels wrong differ by what the slope changes over this
    share of a block (1 sigma)"""
    outlier: float = within(5.0, 0.1, 1000.0)
    """sigmas that a block counts at most: something hides what was seen"""
    together: float = within(16.0, 1.0, 1e6)
    """so many neighbouring blocks count as one independent observation: their differences go together"""
    standing: float = within(0.125, 1e-6, 10.0)
    """two places that look the same differ by this in half the logarithm of their mean squares (1 sigma), because the stored
    views stand and the poses err differently; chosen on one building (square_twin, seeds from 100)"""
    enough: float = within(0.125, 0.0, 1.0)
    """a smaller share of the blocks says nothing"""
    nearest_m: float = within(0.3, 0.0, 10.0)
    """what is nearer to a stored camera than this is not looked for, metres"""
    exposure: float = within(2.0, 1.0, 100.0)
    """the picture may be so many times brighter or darker than the stored ones"""


@dataclass(frozen=True)
class PlaceRules(Bounded):
    """When candidates of one query are one place, an answer, or rivals that look alike."""

    min_score: float = within(0.02, 0.0, 1.0)
    """least explained share (explained times found) of an answer"""
    rival_share: float = within(0.85, 0.0, 1.0)
    """if a second, distant place has more than this share of the best one's score the two look alike: abstain"""
    misfit: float = within(1.5, 0.0, 1e6)
    """thumbnails fit a place up to this mean squared residual, in sigmas; 1 where the pose is right"""
    level: float = within(3.1, 0.0, 100.0)
    """a place that fits refutes those that fit worse by so many sigmas: by chance once in 1,000"""
    misfit_inliers: int = within(30, 0, 100_000)
    """a place whose thumbnail does not fit is an answer only with so many agreeing key-points: pictures of real cameras
    seldom fit, but many key-points agree in them"""
    faint_inliers: int = within(6, 3, 100_000)
    """if no candidate fits, a second look asks whether any fits with so few agreeing key-points"""
    faint_checks: int = within(0, 0, 10_000)
    """candidates of that second look; it doubles a query that finds nothing, so only for a view asked alone: a robot on its
    way asks with its next view"""
    most: int = within(4, 1, 100)
    """different places of one query that are looked at"""
    apart_m: float = within(1.0, 0.01, 100.0)
    """two sightings further apart than this are two different places, metres"""
    apart_deg: float = within(20.0, 0.1, 180.0)
    """or turned against each other by more than this, degrees"""
    tie: float = within(0.12, 0.0, 1.0)
    """places within this share of the best score count as equal: such differences come from where the stored views happen to
    stand and keep their sign for many views"""
    slope: float = within(12.0, 0.0, 1e4)
    """beyond that the weight of a place falls e-fold per 1 / slope of the score"""
    place_sigma_m: float = within(0.03, 1e-6, 10.0)
    """how exact a stored pose is against its neighbours, metres (1 sigma); the map is drawn from these very poses"""
    place_sigma_deg: float = within(0.5, 1e-4, 90.0)
    """and its angles, degrees (1 sigma)"""
    explain: ExplainSettings = field(default_factory=ExplainSettings)
    thumbnails: ThumbnailSettings = field(default_factory=ThumbnailSettings)


@dataclass(frozen=True)
class PlaceSettings:
    """The place database (thesis section 5.2)."""

    retrieval: str = "vlad"
    """votes, kd_tree or vlad"""
    checks: int = 5
    """candidates checked by geometry"""
    sighting: SightingSettings = field(default_factory=SightingSettings)
    rules: PlaceRules = field(default_factory=PlaceRules)


@dataclass(frozen=True)
class ContinuitySettings(Bounded):
    """Does a view go on from the one before? Shares were measured on led laps of three bundled worlds."""

    pixels_px: float = within(5.0, 0.5, 100.0)
    """a key-point is found again within this distance of where it is drawn, pixels of an image 320 wide"""
    likeness: float = within(0.85, -1.0, 1.0)
    """with at least this cosine of the descriptors"""
    depth_share: float = within(0.08, 0.0, 10.0)
    """at the same depth up to this share of it"""
    depth_m: float = within(0.05, 0.0, 10.0)
    """and up to this constant, metres"""
    goes_on_share: float = within(0.15, 0.0, 1.0)
    """a view goes on when this share of the key-points that ought to be in both is found again: views 0.2 m or 8 degrees
    apart share 0.29 or more, unrelated ones 0.06 in 99 of 100"""
    telling_pairs: int = within(20, 1, 100_000)
    """fewer such key-points tell no break"""
    few_found: int = within(5, 1, 100_000)
    """of fewer so many found again tell that the view goes on: at 0.06 each, as in unrelated views, 5 of 19 are found by
    chance once in 200 times"""
    scan_goes_on_share: float = within(0.8, 0.0, 1.0)
    """a scan goes on when this share of the beams that both views hold ends where the last one says: scans 0.2 m or 8
    degrees apart share 0.98 or more"""
    scan_broken_share: float = within(0.5, 0.0, 1.0)
    """below this it is broken: of a robot carried off 0.04 in the median; in between something may have moved"""
    telling_beams: int = within(10, 1, 100_000)
    """fewer such beams tell nothing"""
    beam_m: float = within(0.08, 0.0, 10.0)
    """a beam ends where the last scan says up to this, metres"""
    beam_share: float = within(0.04, 0.0, 1.0)
    """plus this share of the range"""
    fine_beam_m: float = within(0.03, 0.0, 10.0)
    """the same, where it is asked whether what stands still shows the motion told: as near as depth noise allows"""
    fine_beam_share: float = within(0.03, 0.0, 1.0)
    """plus this share of the range"""
    passer_by_share: float = within(0.5, 0.0, 1.0)
    """key-points that do not go on are somebody's who passes when so many beams, finely, do: 18 of 20 views with a person
    close by in a drawn building; of pairs of views from two places of five drawn buildings 0.2 to 1.2 in 100"""
    passer_by_walls: float = within(0.75, 0.0, 1.0)
    """and the view goes on after all where so much of the scan lies on walls of the map: somebody close by hides up to a
    quarter of it"""
    carried: float = within(0.5, 0.01, 0.99)
    """chance of having been carried elsewhere when a view does not go on from the last; else it was spoiled"""


@dataclass(frozen=True)
class DepthNoiseSettings(Bounded):
    """Depth noisier than a Kinect's: when it is averaged away, and how far."""

    above: float = within(1.5, 1.0, 1000.0)
    """depth whose noise is more than so many times a Kinect's is averaged over a window that brings it back to that; 1000:
    never"""
    memory: int = within(10, 1, 10_000)
    """views that the level is averaged over"""
    widest_share: float = within(0.04, 0.0, 0.25)
    """half the side of the widest window, share of the image's width: more would average over whole things"""
    edge_sigma: float = within(4.0, 0.5, 100.0)
    """residuals whose mean square is larger than that of the noise by so many of its own deviations hold an edge"""
    known: float = within(0.6, 0.0, 1.0)
    """share of a window that must be known"""
    cut_sigma: float = within(3.0, 0.0, 10.0)
    """what lies nearer to the end of the range than so many deviations of a reading is unknown: the range cut off some of
    its readings, and the mean of the others is too near"""


@dataclass(frozen=True)
class CameraFitSettings(Bounded):
    """What the views say of their camera (rhs.estimation.views.camera_fit), and when it contradicts what was told."""

    turn_deg: float = within(14.0, 1.0, 90.0)
    """views turned apart by this are compared, degrees: a quarter of what a Kinect sees, so that most is in both"""
    most_turn_deg: float = within(40.0, 1.0, 180.0)
    """but by no more than this, degrees"""
    most_pairs: int = within(40, 2, 10_000)
    """pairs of views compared: some 25 ms of processor time each"""
    least_pairs: int = within(10, 2, 10_000)
    """with fewer nothing is said"""
    most_points: int = within(100, 6, 100_000)
    """key-points of a pair"""
    least_points: int = within(20, 6, 100_000)
    """with fewer a pair says nothing"""
    ratio: float = within(0.8, 0.1, 1.0)
    """Lowe's ratio of the matches"""
    ransac_px: float = within(1.5, 0.05, 100.0)
    """how well a key-point is known while the told camera may be wrong, pixels of an image 320 wide"""
    hypotheses: int = within(200, 1, 100_000)
    """three-point motions tried for a pair"""
    gate_sigma: float = within(4.0, 0.5, 100.0)
    """pairs of key-points this near to one of them take part at first"""
    outlier_sigma: float = within(6.0, 0.5, 1000.0)
    """and then those within so many sigmas of all"""
    student_dof: float = within(5.0, 0.5, 1e6)
    """degrees of freedom of the Student's t that weighs them (Kerl et al. 2013)"""
    principal_sigma: float = within(0.02, 1e-6, 10.0)
    """what is believed beforehand (1 sigma): of the principal point, a share of the focal length (10 pixels at 640x480),"""
    inverse_depth_sigma: float = within(0.01, 1e-6, 10.0)
    """of what is added to all inverse depths, 1/m (half a pixel of a Kinect's disparity),"""
    magnified_sigma: float = within(0.3, 1e-6, 10.0)
    """of how much larger or smaller the depth image is than the picture, a share (hardly anything),"""
    shifted_sigma: float = within(0.03, 1e-6, 10.0)
    """and of by how much it is shifted, a share of the focal length (a base line of 25 mm at 0.8 m)"""
    rounds: int = within(30, 1, 1000)
    """most steps of Gauss-Newton"""
    settled: float = within(1e-5, 1e-12, 1.0)
    """a step smaller than this is the last"""
    stretches: int = within(10, 2, 1000)
    """of the way, whose errors are taken for independent"""
    least_off: float = within(0.04, 0.0, 1.0)
    """a focal length, or a size of the depth image, that is off by less contradicts nothing, a share: fast turns of a
    rolling shutter and the bent depth of a Kinect move a right one by up to 0.03 (measured: results/history); colour and
    depth of two cameras differ by 0.1"""
    sure_sigma: float = within(4.0, 0.0, 100.0)
    """nor one that is off by less than so many standard errors"""


@dataclass(frozen=True)
class DriftBounds(Bounded):
    """How wrong the odometry may be between two loops that are held against each other."""

    base_m: float = within(0.15, 0.0, 100.0)
    """metres at once"""
    per_m: float = within(0.05, 0.0, 10.0)
    """metres per metre travelled; visual odometry drifts by 0.01 to 0.04"""
    base_rad: float = within(0.05, 0.0, 3.0)
    """radians at once"""
    rad_per_m: float = within(0.015, 0.0, 3.0)
    """radians per metre travelled"""


def scaled_px(pixels_px: float, width_px: int) -> float:
    """A distance in pixels of an image 320 wide, in those of an image `width_px` wide."""
    return pixels_px * (width_px / REFERENCE_WIDTH_PX)
