"""What the parts hand to one another: frozen, without behaviour.

NaN means unknown in every array. A pose is 4x4, float64, last row 0 0 0 1: `a_from_b` takes points of frame b to frame a and
is the pose of b in a. Body frame: x forward, y left, z up, on the floor under the robot; yaw counter-clockwise. Map
frame: where the survey began is `WorldFacts.start`. Camera frame: x right, y down, z forward. A covariance is 6x6 in the
order (x, y, z, rx, ry, rz), metres and radians, of the right perturbation `a_from_b @ exp(delta)`: it is expressed in
frame b. rhs.api.validate checks all of them. """

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from .errors import Bounded, within
from .frozen import Shown
from .geometry import Camera, arc, planar
from .robot_shape import Footprint
from .statuses import BeliefStatus as BeliefStatus
from .statuses import Event as Event
from .statuses import MissionStatus as MissionStatus
from .statuses import PlanReason as PlanReason
from .statuses import Tracking as Tracking


@dataclass(frozen=True)
class WorldFacts:
    """The public facts of a world: what a person commissioning the robot would tell it.

    start: (x m, y m, yaw rad), where the map begins. places: names and (x, y) metres of favourite locations.
    bounds_m: (x_min, y_min, x_max, y_max) of the area to map. robot_radius_m: of the robot, or of the circle about its
    turning point that holds it. footprint: of one that is not round. bounds_known: False where bounds_m is only where to
    begin, as of a recording: nobody knows how far its way leads, and a map may outgrow them.
    """

    name: str
    start: tuple[float, float, float]
    places: tuple[tuple[str, float, float], ...]
    bounds_m: tuple[float, float, float, float]
    robot_radius_m: float
    footprint: Footprint | None = None
    bounds_known: bool = True


@dataclass(frozen=True, eq=False)
class Twist:
    """A unicycle command held for a time: forward metres per second, radians per second to the left, seconds."""

    forward_mps: float
    turn_radps: float
    duration_s: float

    @property
    def travel(self) -> np.ndarray:
        """(3,) dx, dy, dyaw, metres and radians, of a robot that obeys."""
        return arc(self.forward_mps * self.duration_s, self.turn_radps * self.duration_s)


@dataclass(frozen=True, eq=False, repr=False)
class Scan(Shown):
    """Ranges over bearings in the body frame, beams leaving `origin_xy_m`.

    bearings_rad (N,): left positive. ranges_m (N,): metres along the beam, NaN unknown, +inf
    nothing within max_range_m. blind_m: nearer than this a beam may pass over
    something unseen, and says nothing.
    """

    bearings_rad: np.ndarray
    ranges_m: np.ndarray
    max_range_m: float
    origin_xy_m: tuple[float, float] = (0.0, 0.0)
    blind_m: float = 0.0


@dataclass(frozen=True, eq=False, repr=False)
class Capture(Shown):
    """An ideal view at one instant, before any sensor. Arrays that are views of a buffer, which may be filled again, are
    copied; others are taken as they are, and can no longer be written to.

    image (H, W, 3) uint8 RGB or None. depth (H, W) float32, metres along the optical axis, NaN unknown, or None.
    command: what the robot was given since the previous view, or None. travel: (3,) true wheel travel since the previous
    view in the previous body frame (dx m, dy m, dyaw rad), or None. scan: of a laser scanner, or None.
    sensed: a sensor has taken this view already (a recording): it brings its own noise, and no sensor adds more.
    extras: further modalities by name (`imu`, `right_image`, ...), arrays of any shape; `cloud`: (N, 3) finite points in the
    body frame, metres, of a lidar, and `cloud_time_s`: (N,) when each was seen, seconds after the stamp.
    contact: whether the robot's bumper was pressed since the previous view; None: it has none (a recording).
    """

    index: int
    stamp_s: float
    image: np.ndarray | None = None
    depth: np.ndarray | None = None
    command: Twist | None = None
    travel: np.ndarray | None = None
    scan: Scan | None = None
    sensed: bool = False
    extras: Mapping[str, np.ndarray] = field(default_factory=dict)
    contact: bool | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Observation(Shown):
    """What this sensor reports of a Capture. Arrays are read-only.

    wheel: (3,) encoder travel since the previous view (dx, dy, dyaw), with slip, or None.
    extras: further modalities by name, as the source gave them. contact: of the bumper, as the source gave it.
    obstacle: the nearest thing between the floor and the robot's height on each bearing, beside `scan`, whose beams all run
    at one height (rhs.estimation.scans.obstacle_scan); None of a sensor that does not look for it.
    depth_times: deviation of a reading of depth as the pictures themselves show it, times a Kinect's; 1: no more than that.
    """

    index: int
    stamp_s: float
    camera: Camera
    image: np.ndarray | None = None
    depth: np.ndarray | None = None
    scan: Scan | None = None
    command: Twist | None = None
    wheel: np.ndarray | None = None
    extras: Mapping[str, np.ndarray] = field(default_factory=dict)
    obstacle: Scan | None = None
    contact: bool | None = None
    depth_times: float = 1.0


@dataclass(frozen=True, eq=False, repr=False)
class Motion(Shown):
    """Motion of the body since the previous observation: previous_from_body, covariance in the body frame of this one.

    When status is lost, previous_from_body is the part's best guess and the covariance is honest about it.
    observability (6,): square roots of the information per direction in the body frame (1/m, 1/rad), or None.
    reason: why the status is not ok, at most 2000 characters.
    scan: a scan the odometry believes in without depth (walls seen by one camera), or None.
    scan_measured: each view measured that scan in its picture, so that a robot may drive by it; it is not cast on walls
    believed in.
    details: numbers for the per-step table (inliers, matches, ...), none named as what the record says itself.
    replaced: this is not what the odometry said: the gate put the wheels' motion in its place (rhs.patrol.gate).
    """

    previous_from_body: np.ndarray
    covariance: np.ndarray
    status: Tracking
    reason: str = ""
    observability: np.ndarray | None = None
    scan: Scan | None = None
    details: Mapping[str, float] = field(default_factory=dict)
    replaced: bool = False
    scan_measured: bool = False


@dataclass(frozen=True, eq=False, repr=False)
class Belief(Shown):
    """Where the robot thinks it is: map_from_body, covariance in the body frame (6x6, right perturbation).

    probability: chance (0..1) that the pose is right (0.25 m, 5 degrees)."""

    map_from_body: np.ndarray
    covariance: np.ndarray
    status: BeliefStatus = BeliefStatus.TRACKING
    probability: float = 1.0
    details: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FeatureAdvanced(Bounded):
    """When the depth under a key-point is believed."""

    window_half_px: int = within(2, 1, 50)
    """half the side of the window of depth that a plane is fitted to, without its middle pixel. Pixels of the image as
    it is: a window that grows with the image was tried on 60 recorded views of 640x480, the error of a step rose by a
    tenth"""
    window_known: float = within(0.6, 0.0, 1.0)
    """share of the window that must be known"""
    edge_per_m: float = within(0.02, 1e-6, 10.0)
    """inverse depths of the window lie this close to the plane, or the key-point hangs over an edge, 1/m (RMS)"""
    occlusion_per_m: float = within(0.03, 1e-6, 10.0)
    """where inverse depth bends by more than this from pixel to pixel something stands in front of something else, 1/m: a
    key-point whose patch holds such an edge sees two things that move apart, and is pulled along by the wrong one"""
    patch_diameters: float = within(1.5, 0.0, 100.0)
    """the patch that places a key-point reaches this many of its diameters from its centre"""
    sift_px: int = within(76_800, 1, 1_000_000_000)
    """a picture of 4, 9, ... times so many pixels is made 2, 3, ... times smaller before key-points are looked for: SIFT
    doubles what it is given, and the finest detail of a real camera is little but noise"""
    few_over_edges: float = within(0.1, 0.0, 1.0)
    """key-points over edges are left without depth when they are at most this share: in a corridor they bend the path, in a
    cluttered view they are too many to lose. Chosen on two places (half the drift in the square, a third more error on a
    desk)"""


@dataclass(frozen=True)
class FeatureSettings(Bounded):
    """Settings of the SIFT features that all parts share (rhs.estimation.views.features)."""

    count: int = within(300, 10, 100_000)
    """strongest key-points kept per 320x240 pixels (four times as many at 640x480)"""
    contrast: float = within(0.02, 0.0, 1.0)
    """OpenCV's contrastThreshold, smaller keeps weaker ones"""
    ratio: float = within(0.8, 0.1, 1.0)
    """Lowe's ratio between the nearest and the second nearest descriptor"""
    advanced: FeatureAdvanced = FeatureAdvanced()


@dataclass(frozen=True, eq=False, repr=False)
class Thumbnail(Shown):
    """The thumbnail of a view: means over blocks of its picture, of which faint, wide patterns of a wall remain where
    noise and key-points do not. grey (h, w) uint8; depth (h, w) float32, metres along the optical axis, NaN where a
    pixel of the block is unknown."""

    grey: np.ndarray
    depth: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Features(Shown):
    """Key-points of one view. pixels (N, 2) float32; descriptors (N, D) (float32 RootSIFT or uint8 ORB);
    points (N, 3) float32 in the camera frame, NaN where depth is unknown; thumbnail: of the view they are of, if it is
    kept; sift (N, 128) uint8: of what the descriptors are the roots, where they are."""

    pixels: np.ndarray
    descriptors: np.ndarray
    points: np.ndarray
    thumbnail: Thumbnail | None = None
    sift: np.ndarray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Wall(Shown):
    """A vertical wall an odometry believes in: a segment in the map, metres, from floor to ceiling."""

    start_xy_m: np.ndarray
    end_xy_m: np.ndarray
    floor_m: float = 0.0
    ceiling_m: float = np.inf


@dataclass(frozen=True, eq=False, repr=False)
class View(Shown):
    """One step of a survey as the loop closer, the mapper and the localiser get it afterwards.

    features is None for views that were not stored as places. of_map: (6, 6) of map_from_body against the first view's
    (right perturbation), all loops heard: how unsure the map is there, where the loop closer says so."""

    index: int
    stamp_s: float
    camera: Camera
    motion: Motion
    map_from_body: np.ndarray
    covariance: np.ndarray
    scan: Scan | None
    features: Features | None
    obstacle: Scan | None = None
    of_map: np.ndarray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Revision(Shown):
    """What an odometry says of the whole survey once it is over: poses (N, 4, 4), a scan per view (None: they stay as they
    were taken), and its walls.

    covariance: (6, 6) of the last pose in the map (right perturbation), if the odometry knows that better than the sum of
    its motions does."""

    poses: np.ndarray
    scans: tuple[Scan | None, ...] | None
    walls: tuple[Wall, ...] = ()
    covariance: np.ndarray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class LoopEdge(Shown):
    """View `later` seen from view `earlier`: earlier_from_later 4x4 with 6x6 covariance; accepted or why not."""

    earlier: int
    later: int
    earlier_from_later: np.ndarray
    covariance: np.ndarray
    inliers: int
    accepted: bool = True
    reason: str = ""


@dataclass(frozen=True, eq=False, repr=False)
class Closure(Shown):
    """Corrected poses (N, 4, 4) of all views of a survey, and the loops they rest on.

    covariances: (N, 6, 6) of the poses against the first (right perturbations), NaN for views of which it is not said; None:
    of none."""

    poses: np.ndarray
    edges: tuple[LoopEdge, ...] = ()
    details: Mapping[str, float] = field(default_factory=dict)
    covariances: np.ndarray | None = None


@dataclass(frozen=True, eq=False, repr=False)
class PlanningProblem(Shown):
    """blocked (H, W) bool, row = y, True where the robot's centre may not be; cell (0, 0) has its centre at
    origin_m + resolution_m / 2, origin_m is the corner. start_m, goal_m: (2,) metres in the map frame."""

    blocked: np.ndarray
    resolution_m: float
    origin_m: tuple[float, float]
    start_m: np.ndarray
    goal_m: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Path(Shown):
    """points_m (N, 2) from start to goal, metres, empty on failure, as the planner found them: whoever asked pulls every
    planner's path tight alike, and then keeps in raw_m what it was given. keep_shape: it shall not, because the shape is
    the point (room to the walls). advice: after a failure, what to type to get further. sketch: (E, 2, 2) segments of the
    tree or roadmap, for pictures only, or a function that gives them and is called after the clock is read. learn_ms,
    plan_ms and details: the planner's own words, shown beside what is measured, and believed by nobody."""

    reason: PlanReason
    points_m: np.ndarray
    raw_m: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    learn_ms: float = 0.0
    plan_ms: float = 0.0
    sketch: np.ndarray | Callable[[], np.ndarray] | None = None
    details: Mapping[str, float] = field(default_factory=dict)
    keep_shape: bool = False
    advice: str = ""

    @property
    def found(self) -> bool:
        return self.reason is PlanReason.OK


@dataclass(frozen=True, eq=False)
class Step:
    """Everything about one captured view. truth: world_from_body 4x4 or None; it is for recorders and metrics only.
    timings_ms: stage -> milliseconds. events: what happened, in order."""

    index: int
    phase: str
    stamp_s: float
    observation: Observation
    motion: Motion
    belief: Belief
    scan: Scan | None
    truth: np.ndarray | None
    path: Path | None
    mission: int
    events: tuple[Event, ...]
    command: Twist | None
    timings_ms: Mapping[str, float]
    clearance_m: float = np.nan
    collided: bool = False

    @property
    def event(self) -> str:
        """The events as steps.csv has them, joined by `+`."""
        return "+".join(self.events)

    def __repr__(self) -> str:
        x_m, y_m, yaw_rad = planar(self.belief.map_from_body)
        return (f"Step(index={self.index}, phase={self.phase!r}, stamp_s={self.stamp_s:g}, x_m={x_m:.2f}, y_m={y_m:.2f}, "
                f"yaw_deg={np.degrees(yaw_rad):z.0f}, event={self.event!r}, ...)")
