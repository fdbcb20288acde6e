"""Settings of the odometry `corridor_ekf`, and the thresholds that a user seldom touches: `odometry.advanced.name=value`.
Light to import."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import Bounded, ConfigError, one_of, within

from ..tracks.settings import AlarmSettings, KltSettings


@dataclass(frozen=True)
class WallRules(Bounded):
    """Attaching tracks to walls, finding and merging walls; lengths in metres. Chosen on one world and direction."""

    agree_sigmas: float = within(1.5, 0.1, 100.0)
    """a track lies on a wall if its own depth agrees within this many sigmas"""
    walls_before_floor: int = within(1, 0, 100)
    """points are put on the floor once so many walls are known: before a wall right ahead, points at its foot pass for floor
    further away, and the scale comes out a quarter too large"""
    reach_m: float = within(1.0, 0.0, 100.0)
    """how far beyond its seen extent a wall may be hit"""
    slot_m: float = within(0.16, 1e-3, 10.0)
    """points of a new wall lie in a slot this thick"""
    points: int = within(12, 3, 10_000)
    """least number of points of a new wall"""
    spread_m: float = within(0.9, 0.0, 100.0)
    """least extent along the wall"""
    bins: int = within(4, 1, 1000)
    """least number of 0.2 m stretches along the wall with points"""
    heights: int = within(3, 1, 100)
    """least number of 0.15 m height bands with points: a wall, not a row of skirting-board corners"""
    near_m: float = within(0.15, 0.0, 10.0)
    """a point this near to a known wall belongs to it"""
    offset_sigma_m: float = within(0.5, 1e-4, 100.0)
    """first uncertainty of a new wall: big on purpose, its points fix it within five views"""
    memory: int = within(60, 1, 100_000)
    """views a point without a wall is remembered"""
    merge_m: float = within(0.4, 0.0, 10.0)
    """parallel walls nearer than this may be one"""
    merge_gap_m: float = within(4.0, 0.0, 1000.0)
    """they overlap, or at most this much lies between them"""
    merge_chi2: float = within(12.0, 0.0, 1e6)
    """the states of two walls that are one agree within this (chi-square of two numbers: 99.75 %)"""
    strong_share: float = within(0.2, 0.0, 10.0)
    """a track has a depth of its own when its inverse depth is known better than this share of it (1 sigma)"""
    farthest_m: float = within(20.0, 0.1, 1e4)
    """and it is no further away than this"""
    some_per_m: float = within(0.1, 0.0, 10.0)
    """a track with an inverse depth known to this, 1/m (1 sigma), may still lie on the nearest wall it hits"""


@dataclass(frozen=True)
class FloorRules(Bounded):
    """Telling the floor from what lies a little above it (floor_level.py); shares of the camera's height. Chosen on 18 drawn
    buildings (numbers 850 to 852)."""

    above_share: float = within(0.15, 0.01, 1.0)
    """what passes for floor is spread evenly up to this: skirting boards, plinths"""
    shares: tuple[float, ...] = (0.2, 0.35, 0.5, 0.65, 0.8)
    """parts of the points that may be floor: the likeliest is taken"""
    kept: int = within(40, 3, 10_000)
    """points of the last views that are looked at together"""
    least: int = within(3, 1, 10_000)
    """fewer say nothing: none is put on the floor"""
    known_share: float = within(0.2, 0.01, 1.0)
    """points tell of the level when their own distance is known to this share of it (1 sigma)"""
    apart_share: float = within(0.4, 0.01, 10.0)
    """and when they are no further off the floor than this"""
    stray: float = within(0.05, 1e-6, 100.0)
    """density of points that are neither"""


@dataclass(frozen=True)
class MotionRules(Bounded):
    """How wrong the expected motion may be at least, and when a camera without wheels goes on after a turn on the spot."""

    forward_floor_m: float = within(0.002, 1e-6, 10.0)
    """least noise of the distance of one step, metres (1 sigma)"""
    left_m: float = within(0.002, 1e-6, 10.0)
    """noise sideways of one step, metres (1 sigma)"""
    turn_floor_rad: float = within(0.005, 1e-6, 3.0)
    """least noise of the turn of one step, radians (1 sigma)"""
    speed_walk_mps: float = within(0.08, 1e-6, 10.0)
    """motion=none: change of speed per step, m/s (1 sigma)"""
    turn_walk_radps: float = within(0.16, 1e-6, 10.0)
    """motion=none: change of turn rate per step, rad/s (1 sigma)"""
    spin_views: int = within(4, 1, 1000)
    """a turn on the spot is looked for over so many views"""
    spin_rad: float = within(0.2, 0.0, 6.3)
    """it turns by more than this, radians"""
    spin_m_per_rad: float = within(0.3, 0.0, 10.0)
    """and moves by less than this per radian, metres"""
    turn_sigma_radps: float = within(0.1, 1e-6, 10.0)
    """how fast the camera may still turn when it goes on after it, rad/s (1 sigma)"""
    least_points: int = within(8, 1, 10_000)
    """fewer followed points say nothing about how the picture moves"""
    still_px: float = within(0.4, 0.0, 100.0)
    """a picture that moves less than this stands still, pixels of an image 320 wide"""


@dataclass(frozen=True)
class DrawingRules(Bounded):
    """From the filter's walls to those of the map: where each begins and ends. Lengths in metres; chosen on the bundled
    corridors."""

    least_hits: int = within(20, 0, 100_000)
    """walls with fewer tracks are not drawn"""
    ahead_m: float = within(5.0, 0.0, 1000.0)
    """a wall is drawn out to a wall across it this near to its seen end"""
    behind_m: float = within(2.0, 0.0, 1000.0)
    """or pulled back to one this near"""
    beside_m: float = within(2.5, 0.0, 1000.0)
    """beside a path this near, an unseen stretch of wall is believed to go on: the camera sees walls ahead only"""
    round_m: float = within(1.0, 0.0, 1000.0)
    """and so far past the path's end: the robot has stood there and wants to come back"""
    body_m: float = within(0.25, 0.0, 1000.0)
    """nearer to the path than this no wall can stand: the robot would have touched it"""
    shadow_m: float = within(0.5, 0.0, 1000.0)
    """a weak wall this near to a strong one on the same line is not drawn"""
    side_share: float = within(0.15, 0.0, 1.0)
    """a wall was seen from a side if at least this share of its tracks was"""
    niche_m: float = within(5.0, 0.0, 1000.0)
    """walls further apart than this have nothing to do with each other"""
    passed_m: float = within(4.0, 0.0, 1000.0)
    """the robot passes a wall when it is no further from it than this"""
    behind_bins: int = within(3, 1, 1000)
    """a wall gives way to one before or behind it where that one was seen along at least so many stretches"""
    clear_m: float = within(0.3, 0.0, 1000.0)
    """a wall ends at least this far before the point where the path crosses its line"""
    narrowest_m: float = within(0.5, 0.0, 1000.0)
    """walls nearer together than this are no two sides of a corridor"""
    widest_m: float = within(6.0, 0.0, 1000.0)
    """nor are those further apart"""
    sight_m: float = within(12.0, 0.0, 1000.0)
    """a beam that meets nothing nearer than this has passed a wall that is not known: points have no depth there"""
    straight: float = within(0.98, 0.0, 1.0)
    """cosine of the angle up to which two walls are parallel"""
    drawn_m: float = within(4.0, 0.0, 1000.0)
    """finished walls are drawn from no further: there half a degree is one cell, and no cell of a wall is missed"""
    again: int = within(4, 1, 1000)
    """views between two drawings of the walls for the scans on the way"""


@dataclass(frozen=True)
class WidthRules(Bounded):
    """When the gap between two walls is the corridor's width."""

    hits: int = within(12, 1, 10_000)
    """both walls of a pair must be seen by so many tracks"""
    sigma_m: float = within(0.01, 1e-5, 10.0)
    """walls of one corridor differ from the common width by this much, metres (1 sigma)"""
    gap_share: float = within(0.3, 0.0, 10.0)
    """a gap further than this from the width (share) is not this corridor's"""
    chi2: float = within(16.0, 0.0, 1e6)
    """and agrees with the width as believed within this (chi-square of one number: 4 sigmas)"""
    unknown_m: float = within(2.6, 0.1, 50.0)
    """prior of an unknown width, metres: narrow corridors of houses to wide ones of offices"""
    unknown_sigma_m: float = within(0.6, 1e-4, 50.0)
    """and its spread, metres (1 sigma)"""


@dataclass
class CorridorAdvanced(Bounded):
    """Thresholds of `odometry=corridor_ekf`."""

    unknown_height_sigma_m: float = within(0.5, 1e-4, 100.0)
    """height_known=false: how wrong the camera's height may be, metres (1 sigma)"""
    few_tracks: int = within(8, 0, 10_000)
    """fewer followed points than this and the view says nothing: lost"""
    least_views: int = within(4, 2, 40)
    """a track seen less often says too little to be worth its row"""
    gate_probability: float = within(0.99, 0.5, 1.0 - 1e-12)
    """chance that a true track passes its chi-square gate"""
    agreeing_share: float = within(0.0, 0.0, 1.0)
    """where a smaller share of the tracks of a view agrees with what was expected none is believed: what is left of points
    of noise agrees by chance; 0: whatever agrees is believed"""
    sways_deg: float = within(0.1, 0.0, 90.0)
    """a camera that sways by more than this (wobble_sigma_deg) is first found again, then believed, degrees"""
    doubt: float = within(2.0, 1.0, 1000.0)
    """where the structure ends the filter's sigmas count so many times"""
    least_step_m: float = within(2e-4, 1e-9, 1.0)
    """no motion is known better, metres (1 sigma)"""
    least_turn_rad: float = within(5e-5, 1e-9, 1.0)
    """nor a turn, radians (1 sigma)"""
    walls: WallRules = field(default_factory=WallRules)
    width: WidthRules = field(default_factory=WidthRules)
    motion: MotionRules = field(default_factory=MotionRules)
    drawing: DrawingRules = field(default_factory=DrawingRules)
    alarm: AlarmSettings = field(default_factory=AlarmSettings)
    follow: KltSettings = field(default_factory=KltSettings)


@dataclass
class CorridorEkf(Bounded):
    """Monocular, in corridors whose plan is not known: a window of poses and a list of walls, right angles a soft prior."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan", "walls"})

    motion: str = one_of("command", "wheel", "none")
    """what predicts the next pose: command, wheel, or none (constant speed and turn rate)"""
    motion_scale_sigma: float = within(0.1, 1e-4, 1.0)
    """how wrong the command or wheel distance may be all along, share (1 sigma)"""
    forward_noise: float = within(0.04, 1e-4, 1.0)
    """noise of one motion's length, share of it (1 sigma)"""
    turn_noise: float = within(0.08, 1e-4, 1.0)
    """noise of one motion's turn, share of it (1 sigma)"""
    speed_mps: float = within(0.5, 0.0, 10.0)
    """motion=none: the speed expected at the start"""
    speed_sigma_mps: float = within(0.12, 1e-4, 10.0)
    """motion=none: how wrong the expected speed may be (1 sigma)"""
    height_known: bool = True
    """the camera's height above the floor sets the scale through points of the floor"""
    height_sigma_m: float = within(0.01, 1e-4, 1.0)
    """how well the height is known (1 sigma): a tape held beside the robot"""
    width_m: float = within(0.0, 0.0, 50.0)
    """width of the corridors; 0: unknown and constant"""
    width_sigma_m: float = within(0.05, 1e-4, 10.0)
    """how well a width that is given is known (1 sigma)"""
    right_angle_sigma_deg: float = within(0.5, 1e-3, 30.0)
    """how far walls may be from right angles (1 sigma); 1 for old buildings, 0.17 where a plan promises them"""
    wobble_sigma_deg: float = within(0.1, 1e-3, 30.0)
    """pitch and roll of a view (1 sigma): wheels on an ordinary floor; 1.2 for a camera that sways"""
    start_heading_sigma_deg: float = within(2.0, 1e-3, 30.0)
    """how well the start heading is known relative to the walls (1 sigma): a robot put down by eye"""
    window: int = within(12, 5, 40)
    """views a track may span; 10-14 did equally well, 6 loses heading after corners"""
    pixel_sigma_px: float = within(1.0, 0.05, 20.0)
    """noise of a track; five times the residual, as errors along a track go together"""
    points: int = within(130, 20, 400)
    """points followed at most"""
    save_tracks: bool = False
    """write the survey's tracks to tracks.npz in the run folder, for python -m rhs_odometry"""
    scan_range_m: float = within(8.0, 0.5, 50.0)
    """walls are put into the scan up to this distance"""
    advanced: CorridorAdvanced = field(default_factory=CorridorAdvanced)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.advanced.least_views > self.window:
            raise ConfigError(f"advanced.least_views={self.advanced.least_views} is above window={self.window}")
        if self.motion == "none" and not self.height_known and self.width_m == 0.0:
            raise ConfigError("motion=none: nothing fixes the scale with height_known=false and width_m=0; give one of them")

    def build(self, context: Context) -> Odometry:
        from .ekf import build_corridor_ekf

        return build_corridor_ekf(self, context)
