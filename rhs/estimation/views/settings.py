"""Thresholds of what is judged from views, light to import: plugins nest these classes in their `advanced` settings.

Distances in pixels are those of an image 320 pixels wide and grow with the width.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges

REFERENCE_WIDTH_PX = 320.0


@dataclass(frozen=True)
class RansacSettings:
    """Search for the rigid motion that most pairs of points agree with (Fischler and Bolles 1981)."""

    hypotheses: int = 200
    """three-point motions tried: with half the pairs wrong, 200 miss the right one once in 4e11"""
    gate_sigma: float = 3.0
    """a pair further off than this many sigmas is an outlier"""

    def __post_init__(self) -> None:
        check_ranges("", self, hypotheses=(1, 100_000), gate_sigma=(0.5, 100.0))


@dataclass(frozen=True)
class SightingSettings:
    """The geometric check of one view against another."""

    min_inliers: int = 15
    """key-points that must agree on one motion"""
    min_coverage: float = 0.0
    """least share of the key-points which ought to be seen again, were the place the same, that are"""
    ratio: float = 0.8
    """Lowe's ratio of the matches"""
    ransac: RansacSettings = field(default_factory=RansacSettings)
    depth_share: float = 0.0
    """depths are wrong by this share of them beside a Kinect's noise (1 sigma): where one eye read them off its pictures"""

    def __post_init__(self) -> None:
        check_ranges("", self, min_inliers=(3, 100_000), min_coverage=(0.0, 1.0), ratio=(0.1, 1.0), depth_share=(0.0, 1.0))


@dataclass(frozen=True)
class ExplainSettings:
    """How much of a view the stored views near a pose explain (rhs.estimation.views.explainability)."""

    views: int = 4
    """stored views, nearest first, whose key-points are drawn into the view"""
    near_m: float = 2.0
    """stored views this near a pose may show what is seen from it, metres"""
    near_deg: float = 40.0
    """and turned away from it by no more than this, degrees"""
    pixels_px: float = 5.0
    """a key-point is found within this distance of where it is drawn, pixels of an image 320 wide"""
    likeness: float = 0.75
    """with at least this cosine of the descriptors"""
    depth_share: float = 0.08
    """at the same depth up to this share of it, where it is known"""
    depth_m: float = 0.05
    """and up to this constant, metres"""
    telling: int = 60
    """a view with fewer key-points says nothing by not being recognised, nor does one near stored views with fewer: of
    bare walls they hold some 30, and hardly any view of them is named"""
    expected_m: float = 0.8
    """a view ought to be recognised where a stored view stands this near, metres"""
    expected_deg: float = 20.0
    """and looks the same way up to this, degrees"""
    silence: float = 5.0
    """how much likelier it is that no place is recognised somewhere else than where one ought to be: of views beside the
    surveyed way 1 to 10 % are not recognised (measured on the bundled buildings), of views that look the other way
    nearly all"""

    def __post_init__(self) -> None:
        check_ranges("", self, views=(1, 100), near_m=(0.01, 100.0), near_deg=(1.0, 180.0), pixels_px=(0.5, 100.0),
                     likeness=(-1.0, 1.0), depth_share=(0.0, 10.0), depth_m=(0.0, 10.0), telling=(0, 100_000),
                     expected_m=(0.01, 100.0), expected_deg=(1.0, 180.0), silence=(1.0, 1e6))


@dataclass(frozen=True)
class ThumbnailSettings:
    """Direct comparison of a view's blocks with those of the stored views (rhs.estimation.views.thumbnails)."""

    views: int = 2
    """stored views, nearest first, that the blocks are compared with"""
    grey: float = 0.7
    """noise and rounding of the mean over a block, grey levels of 255 (1 sigma)"""
    slope_share: float = 0.5
    """where the picture has a slope, two views from poses a few pixels wrong differ by what the slope changes over this
    share of a block (1 sigma)"""
    outlier: float = 5.0
    """sigmas that a block counts at most: something hides what was seen"""
    together: float = 16.0
    """so many neighbouring blocks count as one independent observation: their differences go together"""
    standing: float = 0.125
    """two places that look the same differ by this in half the logarithm of their mean squares (1 sigma), because the stored
    views stand and the poses err differently; chosen on one building (square_twin, seeds from 100)"""
    enough: float = 0.125
    """a smaller share of the blocks says nothing"""
    nearest_m: float = 0.3
    """what is nearer to a stored camera than this is not looked for, metres"""
    exposure: float = 2.0
    """the picture may be so many times brighter or darker than the stored ones"""

    def __post_init__(self) -> None:
        check_ranges("", self, views=(1, 100), grey=(1e-3, 255.0), slope_share=(0.0, 10.0), outlier=(0.1, 1000.0),
                     together=(1.0, 1e6), standing=(1e-6, 10.0), enough=(0.0, 1.0), nearest_m=(0.0, 10.0),
                     exposure=(1.0, 100.0))


@dataclass(frozen=True)
class PlaceRules:
    """When candidates of one query are one place, an answer, or rivals that look alike."""

    min_score: float = 0.02
    """least explained share (explained times found) of an answer"""
    rival_share: float = 0.85
    """if a second, distant place has more than this share of the best one's score the two look alike: abstain"""
    misfit: float = 1.5
    """thumbnails fit a place up to this mean squared residual, in sigmas; 1 where the pose is right"""
    level: float = 3.1
    """a place that fits refutes those that fit worse by so many sigmas: by chance once in 1,000"""
    misfit_inliers: int = 30
    """a place whose thumbnail does not fit is an answer only with so many agreeing key-points: pictures of real cameras
    seldom fit, but many key-points agree in them"""
    faint_inliers: int = 6
    """if no candidate fits, a second look asks whether any fits with so few agreeing key-points"""
    faint_checks: int = 0
    """candidates of that second look; it doubles a query that finds nothing, so only for a view asked alone: a robot on its
    way asks with its next view"""
    most: int = 4
    """different places of one query that are looked at"""
    apart_m: float = 1.0
    """two sightings further apart than this are two different places, metres"""
    apart_deg: float = 20.0
    """or turned against each other by more than this, degrees"""
    tie: float = 0.12
    """places within this share of the best score count as equal: such differences come from where the stored views happen to
    stand and keep their sign for many views"""
    slope: float = 12.0
    """beyond that the weight of a place falls e-fold per 1 / slope of the score"""
    place_sigma_m: float = 0.03
    """how exact a stored pose is against its neighbours, metres (1 sigma); the map is drawn from these very poses"""
    place_sigma_deg: float = 0.5
    """and its angles, degrees (1 sigma)"""
    explain: ExplainSettings = field(default_factory=ExplainSettings)
    thumbnails: ThumbnailSettings = field(default_factory=ThumbnailSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, min_score=(0.0, 1.0), rival_share=(0.0, 1.0), misfit=(0.0, 1e6), level=(0.0, 100.0),
                     misfit_inliers=(0, 100_000), faint_inliers=(3, 100_000), faint_checks=(0, 10_000), most=(1, 100),
                     apart_m=(0.01, 100.0), apart_deg=(0.1, 180.0), tie=(0.0, 1.0), slope=(0.0, 1e4),
                     place_sigma_m=(1e-6, 10.0), place_sigma_deg=(1e-4, 90.0))


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
class ContinuitySettings:
    """Does a view go on from the one before? Shares were measured on led laps of three bundled worlds."""

    pixels_px: float = 5.0
    """a key-point is found again within this distance of where it is drawn, pixels of an image 320 wide"""
    likeness: float = 0.85
    """with at least this cosine of the descriptors"""
    depth_share: float = 0.08
    """at the same depth up to this share of it"""
    depth_m: float = 0.05
    """and up to this constant, metres"""
    goes_on_share: float = 0.15
    """a view goes on when this share of the key-points that ought to be in both is found again: views 0.2 m or 8 degrees
    apart share 0.29 or more, unrelated ones 0.06 in 99 of 100"""
    telling_pairs: int = 20
    """fewer such key-points tell nothing"""
    scan_goes_on_share: float = 0.8
    """a scan goes on when this share of the beams that both views hold ends where the last one says: scans 0.2 m or 8
    degrees apart share 0.98 or more"""
    scan_broken_share: float = 0.5
    """below this it is broken: of a robot carried off 0.04 in the median; in between something may have moved"""
    telling_beams: int = 10
    """fewer such beams tell nothing"""
    beam_m: float = 0.08
    """a beam ends where the last scan says up to this, metres"""
    beam_share: float = 0.04
    """plus this share of the range"""
    fine_beam_m: float = 0.03
    """the same, where it is asked whether what stands still shows the motion told: as near as depth noise allows"""
    fine_beam_share: float = 0.03
    """plus this share of the range"""
    passer_by_share: float = 0.5
    """key-points that do not go on are somebody's who passes when so many beams, finely, do: 18 of 20 views with a person
    close by in a drawn building; of pairs of views from two places of five drawn buildings 0.2 to 1.2 in 100"""
    passer_by_walls: float = 0.75
    """and the view goes on after all where so much of the scan lies on walls of the map: somebody close by hides up to a
    quarter of it"""
    carried: float = 0.5
    """chance of having been carried elsewhere when a view does not go on from the last; else it was spoiled"""

    def __post_init__(self) -> None:
        check_ranges("", self, pixels_px=(0.5, 100.0), likeness=(-1.0, 1.0), depth_share=(0.0, 10.0), depth_m=(0.0, 10.0),
                     goes_on_share=(0.0, 1.0), telling_pairs=(1, 100_000), scan_goes_on_share=(0.0, 1.0),
                     scan_broken_share=(0.0, 1.0), telling_beams=(1, 100_000), beam_m=(0.0, 10.0), beam_share=(0.0, 1.0),
                     fine_beam_m=(0.0, 10.0), fine_beam_share=(0.0, 1.0), passer_by_share=(0.0, 1.0),
                     passer_by_walls=(0.0, 1.0), carried=(0.01, 0.99))


@dataclass(frozen=True)
class DepthNoiseSettings:
    """Depth noisier than a Kinect's: when it is averaged away, and how far."""

    above: float = 1.5
    """depth whose noise is more than so many times a Kinect's is averaged over a window that brings it back to that; 1000:
    never"""
    memory: int = 10
    """views that the level is averaged over"""
    widest_share: float = 0.04
    """half the side of the widest window, share of the image's width: more would average over whole things"""
    edge_sigma: float = 4.0
    """residuals whose mean square is larger than that of the noise by so many of its own deviations hold an edge"""
    known: float = 0.6
    """share of a window that must be known"""
    cut_sigma: float = 3.0
    """what lies nearer to the end of the range than so many deviations of a reading is unknown: the range cut off some of
    its readings, and the mean of the others is too near"""

    def __post_init__(self) -> None:
        check_ranges("", self, above=(1.0, 1000.0), memory=(1, 10_000), widest_share=(0.0, 0.25), edge_sigma=(0.5, 100.0),
                     known=(0.0, 1.0), cut_sigma=(0.0, 10.0))


@dataclass(frozen=True)
class CameraFitSettings:
    """What the views say of their camera (rhs.estimation.views.camera_fit), and when it contradicts what was told."""

    turn_deg: float = 14.0
    """views turned apart by this are compared, degrees: a quarter of what a Kinect sees, so that most is in both"""
    most_turn_deg: float = 40.0
    """but by no more than this, degrees"""
    most_pairs: int = 40
    """pairs of views compared: some 25 ms of processor time each"""
    least_pairs: int = 10
    """with fewer nothing is said"""
    most_points: int = 100
    """key-points of a pair"""
    least_points: int = 20
    """with fewer a pair says nothing"""
    ratio: float = 0.8
    """Lowe's ratio of the matches"""
    ransac_px: float = 1.5
    """how well a key-point is known while the told camera may be wrong, pixels of an image 320 wide"""
    hypotheses: int = 200
    """three-point motions tried for a pair"""
    gate_sigma: float = 4.0
    """pairs of key-points this near to one of them take part at first"""
    outlier_sigma: float = 6.0
    """and then those within so many sigmas of all"""
    student_dof: float = 5.0
    """degrees of freedom of the Student's t that weighs them (Kerl et al. 2013)"""
    principal_sigma: float = 0.02
    """what is believed beforehand (1 sigma): of the principal point, a share of the focal length (10 pixels at 640x480),"""
    inverse_depth_sigma: float = 0.01
    """of what is added to all inverse depths, 1/m (half a pixel of a Kinect's disparity),"""
    magnified_sigma: float = 0.3
    """of how much larger or smaller the depth image is than the picture, a share (hardly anything),"""
    shifted_sigma: float = 0.03
    """and of by how much it is shifted, a share of the focal length (a base line of 25 mm at 0.8 m)"""
    rounds: int = 30
    """most steps of Gauss-Newton"""
    settled: float = 1e-5
    """a step smaller than this is the last"""
    stretches: int = 10
    """of the way, whose errors are taken for independent"""
    least_off: float = 0.04
    """a focal length, or a size of the depth image, that is off by less contradicts nothing, a share: fast turns of a
    rolling shutter and the bent depth of a Kinect move a right one by up to 0.03 (measured: results/history); colour and
    depth of two cameras differ by 0.1"""
    sure_sigma: float = 4.0
    """nor one that is off by less than so many standard errors"""

    def __post_init__(self) -> None:
        check_ranges("", self, turn_deg=(1.0, 90.0), most_turn_deg=(1.0, 180.0), most_pairs=(2, 10_000),
                     least_pairs=(2, 10_000), most_points=(6, 100_000), least_points=(6, 100_000), ratio=(0.1, 1.0),
                     ransac_px=(0.05, 100.0), hypotheses=(1, 100_000), gate_sigma=(0.5, 100.0), outlier_sigma=(0.5, 1000.0),
                     student_dof=(0.5, 1e6), rounds=(1, 1000), settled=(1e-12, 1.0), stretches=(2, 1000),
                     principal_sigma=(1e-6, 10.0), inverse_depth_sigma=(1e-6, 10.0), magnified_sigma=(1e-6, 10.0),
                     shifted_sigma=(1e-6, 10.0),
                     least_off=(0.0, 1.0), sure_sigma=(0.0, 100.0))


@dataclass(frozen=True)
class DriftBounds:
    """How wrong the odometry may be between two loops that are held against each other."""

    base_m: float = 0.15
    """metres at once"""
    per_m: float = 0.05
    """metres per metre travelled; visual odometry drifts by 0.01 to 0.04"""
    base_rad: float = 0.05
    """radians at once"""
    rad_per_m: float = 0.015
    """radians per metre travelled"""

    def __post_init__(self) -> None:
        check_ranges("", self, base_m=(0.0, 100.0), per_m=(0.0, 10.0), base_rad=(0.0, 3.0), rad_per_m=(0.0, 3.0))


def scaled_px(pixels_px: float, width_px: int) -> float:
    """A distance in pixels of an image 320 wide, in those of an image `width_px` wide."""
    return pixels_px * (width_px / REFERENCE_WIDTH_PX)
