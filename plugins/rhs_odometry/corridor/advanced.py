"""Thresholds of `odometry=corridor_ekf` that a user seldom touches: `odometry.advanced.name=value`. Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges

from ..tracks.settings import AlarmSettings, KltSettings


@dataclass(frozen=True)
class WallRules:
    """Attaching tracks to walls, finding and merging walls; lengths in metres. Chosen on one world and direction."""

    agree_sigmas: float = 1.5
    """a track lies on a wall if its own depth agrees within this many sigmas"""
    walls_before_floor: int = 1
    """points are put on the floor once so many walls are known: before a wall right ahead, points at its foot pass for floor
    further away, and the scale comes out a quarter too large"""
    reach_m: float = 1.0
    """how far beyond its seen extent a wall may be hit"""
    slot_m: float = 0.16
    """points of a new wall lie in a slot this thick"""
    points: int = 12
    """least number of points of a new wall"""
    spread_m: float = 0.9
    """least extent along the wall"""
    bins: int = 4
    """least number of 0.2 m stretches along the wall with points"""
    heights: int = 3
    """least number of 0.15 m height bands with points: a wall, not a row of skirting-board corners"""
    near_m: float = 0.15
    """a point this near to a known wall belongs to it"""
    offset_sigma_m: float = 0.5
    """first uncertainty of a new wall: big on purpose, its points fix it within five views"""
    memory: int = 60
    """views a point without a wall is remembered"""
    merge_m: float = 0.4
    """parallel walls nearer than this may be one"""
    merge_gap_m: float = 4.0
    """they overlap, or at most this much lies between them"""
    merge_chi2: float = 12.0
    """the states of two walls that are one agree within this (chi-square of two numbers: 99.75 %)"""
    strong_share: float = 0.2
    """a track has a depth of its own when its inverse depth is known better than this share of it (1 sigma)"""
    farthest_m: float = 20.0
    """and it is no further away than this"""
    some_per_m: float = 0.1
    """a track with an inverse depth known to this, 1/m (1 sigma), may still lie on the nearest wall it hits"""

    def __post_init__(self) -> None:
        check_ranges("", self, agree_sigmas=(0.1, 100.0), walls_before_floor=(0, 100), reach_m=(0.0, 100.0),
                     slot_m=(1e-3, 10.0), points=(3, 10_000), spread_m=(0.0, 100.0), bins=(1, 1000), heights=(1, 100),
                     near_m=(0.0, 10.0), offset_sigma_m=(1e-4, 100.0), memory=(1, 100_000), merge_m=(0.0, 10.0),
                     merge_gap_m=(0.0, 1000.0), merge_chi2=(0.0, 1e6), strong_share=(0.0, 10.0), farthest_m=(0.1, 1e4),
                     some_per_m=(0.0, 10.0))


@dataclass(frozen=True)
class FloorRules:
    """Telling the floor from what lies a little above it (floor_level.py); shares of the camera's height. Chosen on 18 drawn
    buildings (numbers 850 to 852)."""

    above_share: float = 0.15
    """what passes for floor is spread evenly up to this: skirting boards, plinths"""
    shares: tuple[float, ...] = (0.2, 0.35, 0.5, 0.65, 0.8)
    """parts of the points that may be floor: the likeliest is taken"""
    kept: int = 40
    """points of the last views that are looked at together"""
    least: int = 3
    """fewer say nothing: none is put on the floor"""
    known_share: float = 0.2
    """points tell of the level when their own distance is known to this share of it (1 sigma)"""
    apart_share: float = 0.4
    """and when they are no further off the floor than this"""
    stray: float = 0.05
    """density of points that are neither"""

    def __post_init__(self) -> None:
        check_ranges("", self, above_share=(0.01, 1.0), kept=(3, 10_000), least=(1, 10_000), known_share=(0.01, 1.0),
                     apart_share=(0.01, 10.0), stray=(1e-6, 100.0))


@dataclass(frozen=True)
class MotionRules:
    """How wrong the expected motion may be at least, and when a camera without wheels goes on after a turn on the spot."""

    forward_floor_m: float = 0.002
    """least noise of the distance of one step, metres (1 sigma)"""
    left_m: float = 0.002
    """noise sideways of one step, metres (1 sigma)"""
    turn_floor_rad: float = 0.005
    """least noise of the turn of one step, radians (1 sigma)"""
    speed_walk_mps: float = 0.08
    """motion=none: change of speed per step, m/s (1 sigma)"""
    turn_walk_radps: float = 0.16
    """motion=none: change of turn rate per step, rad/s (1 sigma)"""
    spin_views: int = 4
    """a turn on the spot is looked for over so many views"""
    spin_rad: float = 0.2
    """it turns by more than this, radians"""
    spin_m_per_rad: float = 0.3
    """and moves by less than this per radian, metres"""
    turn_sigma_radps: float = 0.1
    """how fast the camera may still turn when it goes on after it, rad/s (1 sigma)"""
    least_points: int = 8
    """fewer followed points say nothing about how the picture moves"""
    still_px: float = 0.4
    """a picture that moves less than this stands still, pixels of an image 320 wide"""

    def __post_init__(self) -> None:
        check_ranges("", self, forward_floor_m=(1e-6, 10.0), left_m=(1e-6, 10.0), turn_floor_rad=(1e-6, 3.0),
                     speed_walk_mps=(1e-6, 10.0), turn_walk_radps=(1e-6, 10.0), spin_views=(1, 1000), spin_rad=(0.0, 6.3),
                     spin_m_per_rad=(0.0, 10.0), turn_sigma_radps=(1e-6, 10.0), least_points=(1, 10_000),
                     still_px=(0.0, 100.0))


@dataclass(frozen=True)
class DrawingRules:
    """From the filter's walls to those of the map: where each begins and ends. Lengths in metres; chosen on the bundled
    corridors."""

    least_hits: int = 20
    """walls with fewer tracks are not drawn"""
    ahead_m: float = 5.0
    """a wall is drawn out to a wall across it this near to its seen end"""
    behind_m: float = 2.0
    """or pulled back to one this near"""
    beside_m: float = 2.5
    """beside a path this near, an unseen stretch of wall is believed to go on: the camera sees walls ahead only"""
    round_m: float = 1.0
    """and so far past the path's end: the robot has stood there and wants to come back"""
    body_m: float = 0.25
    """nearer to the path than this no wall can stand: the robot would have touched it"""
    shadow_m: float = 0.5
    """a weak wall this near to a strong one on the same line is not drawn"""
    side_share: float = 0.15
    """a wall was seen from a side if at least this share of its tracks was"""
    niche_m: float = 5.0
    """walls further apart than this have nothing to do with each other"""
    passed_m: float = 4.0
    """the robot passes a wall when it is no further from it than this"""
    behind_bins: int = 3
    """a wall gives way to one before or behind it where that one was seen along at least so many stretches"""
    clear_m: float = 0.3
    """a wall ends at least this far before the point where the path crosses its line"""
    narrowest_m: float = 0.5
    """walls nearer together than this are no two sides of a corridor"""
    widest_m: float = 6.0
    """nor are those further apart"""
    sight_m: float = 12.0
    """a beam that meets nothing nearer than this has passed a wall that is not known: points have no depth there"""
    straight: float = 0.98
    """cosine of the angle up to which two walls are parallel"""
    drawn_m: float = 4.0
    """finished walls are drawn from no further: there half a degree is one cell, and no cell of a wall is missed"""
    again: int = 4
    """views between two drawings of the walls for the scans on the way"""

    def __post_init__(self) -> None:
        lengths = ("ahead_m", "behind_m", "beside_m", "round_m", "body_m", "shadow_m", "niche_m", "passed_m", "clear_m",
                   "narrowest_m", "widest_m", "sight_m", "drawn_m")
        check_ranges("", self, least_hits=(0, 100_000), side_share=(0.0, 1.0), behind_bins=(1, 1000), straight=(0.0, 1.0),
                     again=(1, 1000), **{name: (0.0, 1000.0) for name in lengths})


@dataclass(frozen=True)
class WidthRules:
    """When the gap between two walls is the corridor's width."""

    hits: int = 12
    """both walls of a pair must be seen by so many tracks"""
    sigma_m: float = 0.01
    """walls of one corridor differ from the common width by this much, metres (1 sigma)"""
    gap_share: float = 0.3
    """a gap further than this from the width (share) is not this corridor's"""
    chi2: float = 16.0
    """and agrees with the width as believed within this (chi-square of one number: 4 sigmas)"""
    unknown_m: float = 2.6
    """prior of an unknown width, metres: narrow corridors of houses to wide ones of offices"""
    unknown_sigma_m: float = 0.6
    """and its spread, metres (1 sigma)"""

    def __post_init__(self) -> None:
        check_ranges("", self, hits=(1, 10_000), sigma_m=(1e-5, 10.0), gap_share=(0.0, 10.0), chi2=(0.0, 1e6),
                     unknown_m=(0.1, 50.0), unknown_sigma_m=(1e-4, 50.0))


@dataclass
class CorridorAdvanced:
    """Thresholds of `odometry=corridor_ekf`."""

    unknown_height_sigma_m: float = 0.5
    """height_known=false: how wrong the camera's height may be, metres (1 sigma)"""
    few_tracks: int = 8
    """fewer followed points than this and the view says nothing: lost"""
    least_views: int = 4
    """a track seen less often says too little to be worth its row"""
    gate_probability: float = 0.99
    """chance that a true track passes its chi-square gate"""
    agreeing_share: float = 0.0
    """where a smaller share of the tracks of a view agrees with what was expected none is believed: what is left of points
    of noise agrees by chance; 0: whatever agrees is believed"""
    sways_deg: float = 0.1
    """a camera that sways by more than this (wobble_sigma_deg) is first found again, then believed, degrees"""
    doubt: float = 2.0
    """where the structure ends the filter's sigmas count so many times"""
    least_step_m: float = 2e-4
    """no motion is known better, metres (1 sigma)"""
    least_turn_rad: float = 5e-5
    """nor a turn, radians (1 sigma)"""
    walls: WallRules = field(default_factory=WallRules)
    width: WidthRules = field(default_factory=WidthRules)
    motion: MotionRules = field(default_factory=MotionRules)
    drawing: DrawingRules = field(default_factory=DrawingRules)
    alarm: AlarmSettings = field(default_factory=AlarmSettings)
    follow: KltSettings = field(default_factory=KltSettings)

    def __post_init__(self) -> None:
        check_ranges("", self, unknown_height_sigma_m=(1e-4, 100.0), few_tracks=(0, 10_000), least_views=(2, 40),
                     gate_probability=(0.5, 1.0 - 1e-12), agreeing_share=(0.0, 1.0), sways_deg=(0.0, 90.0),
                     doubt=(1.0, 1000.0), least_step_m=(1e-9, 1.0), least_turn_rad=(1e-9, 1.0))
