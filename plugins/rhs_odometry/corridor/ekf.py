"""The odometry `corridor_ekf`: the corridor filter between a front end and the rest of the program."""

from __future__ import annotations

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, adjoint, inverse, se2
from rhs.api.records import Revision, Scan, Wall

from ..tracks.monocular import Estimate, MonocularOdometry, StructureAlarm, beams, embed, monocular_odometry
from ..tracks.track_frames import TrackFrame
from .config import CorridorAdvanced, CorridorEkf
from .filter import CorridorFilter, FilterSettings, floor_plane
from .motion import ConstantVelocity, GivenMotion, MotionNoise
from .scan import Drawn, believed_scan, mouths_of
from .state import SCALE, WIDTH, CorridorState
from .wall_map import walls_of


def build_corridor_ekf(settings: CorridorEkf, context: Context) -> MonocularOdometry:
    if settings.height_known and context.camera.height_m <= 0.0:
        raise ConfigError("odometry=corridor_ekf follows a camera that a robot carries through corridors at a known height, "
                          "and nothing says how high this one is; type source.camera_mount=[0,0,HEIGHT_M,0,0,0] if it was "
                          "so, or sensor=rgbd where the recording has depth")
    core = corridor_core(settings, context.camera, np.array(context.world.start))
    return monocular_odometry(settings, context, core, scale_from(settings), settings.advanced.follow)


def scale_from(settings: CorridorEkf) -> str:
    """What the metres come from, strongest first; a command or wheels are believed to motion_scale_sigma only."""
    sources = {"camera height": settings.height_known, f"width {settings.width_m:g} m": settings.width_m > 0,
               settings.motion: settings.motion != "none"}
    return " + ".join(name for name, used in sources.items() if used)


def corridor_core(settings: CorridorEkf, camera: Camera, start: np.ndarray) -> CorridorCore:
    """The filter for a camera that begins at the (3,) pose x m, y m, yaw rad of the map."""
    a = settings.advanced
    known = settings.width_m > 0
    width = (settings.width_m, settings.width_sigma_m) if known else (a.width.unknown_m, a.width.unknown_sigma_m)
    tilt, heading = np.radians(settings.wobble_sigma_deg), np.radians(settings.start_heading_sigma_deg)
    base_sigma = np.array([settings.speed_sigma_mps, 0.05, settings.motion_scale_sigma, width[1]])
    state = CorridorState(
        np.array([settings.speed_mps, 0.0, 1.0, width[0]]),
        base_sigma,
        np.array([*start, 0.0, 0.0]),
        np.array([1e-3, 1e-3, heading, tilt, tilt]),
    )
    state.add_plane(*floor_plane(settings.height_sigma_m if settings.height_known else a.unknown_height_sigma_m))
    noise = MotionNoise(settings.forward_noise, settings.turn_noise, a.motion)
    motion = ConstantVelocity(noise) if settings.motion == "none" else GivenMotion(noise, wheels=settings.motion == "wheel")
    angle = float(np.radians(settings.right_angle_sigma_deg))
    from_width = known and not settings.height_known
    passes = 2 if settings.wobble_sigma_deg > a.sways_deg else 1
    core = FilterSettings(settings.window, settings.pixel_sigma_px, tilt, angle, passes, from_width, a)
    return CorridorCore(CorridorFilter(camera, state, motion, core), camera, settings.scan_range_m, a)


class CorridorCore:
    """TrackFilter over a CorridorFilter: adds the alarm, scans of the walls, and the revised survey."""

    def __init__(self, core: CorridorFilter, camera: Camera, scan_range_m: float, advanced: CorridorAdvanced) -> None:
        self.filter, self._advanced = core, advanced
        self._bearings, self._range_m = beams(camera), scan_range_m
        self._alarm, self._ledger = StructureAlarm(advanced.alarm), Ledger(advanced.least_step_m, advanced.least_turn_rad)
        self._start = self.filter.state.clones[0, :3].copy()
        self._view, self._sketch = 0, tuple[Drawn, ...]()

    def step(self, frame: TrackFrame) -> Estimate:
        self.filter.step(frame)
        state, tally = self.filter.state, self.filter.tally
        share = self._alarm.watch(tally.stray, tally.strong)
        details = {
            "due": float(tally.due),
            "on_walls": float(tally.on_walls),
            "free_points": float(tally.free),
            "refused": float(tally.refused),
            "stray_share": share,
            "walls": float(sum(not p.is_floor for p in state.planes)),
            "scale": float(state.base[SCALE]),
            "width_m": float(state.base[WIDTH]),
            "sigma_m": float(np.sqrt(np.trace(state.pose_covariance()[:2, :2]))),
            "sigma_yaw_rad": float(np.sqrt(state.pose_covariance()[2, 2])),
        }
        trusted = not self._alarm.ringing
        doubt = 1.0 if trusted else self._advanced.doubt**2
        covariance = self._ledger.motion(state.clones[-1, :3], doubt * self.pose_covariance())
        reason = "" if trusted else f"the structure ends: {share:.0%} of the points with depth lie on no known wall"
        return Estimate(se2(*state.clones[-1, :3]), embed(covariance), trusted, reason, details)

    def scan(self) -> Scan | None:
        """What the walls known so far would give from here."""
        if self._view % self._advanced.drawing.again == 0:
            self._sketch = self._drawn()
        self._view += 1
        pose = se2(*self.filter.state.clones[-1, :3])
        if not self._sketch:
            return None
        return believed_scan(self._sketch, (), pose, self._bearings, self._range_m, sight_m=self._advanced.drawing.sight_m)

    def revise(self) -> Revision | None:
        """Poses as they left the window, and all scans cast on the walls as they are now. Now that the walls are known,
        a scan covers the full circle: what the camera saw ahead before stands beside it later."""
        poses, drawn = self.filter.poses(), self._drawn()
        poses[0, :3] = self._start  # others turn the whole survey so that it begins there; the walls know better
        circle, reach = np.linspace(-np.pi, np.pi, 720, endpoint=False), min(self._range_m, self._advanced.drawing.drawn_m)
        mouths, placed = mouths_of(drawn, self._advanced.drawing), [se2(*p[:3]) for p in poses]
        sight_m = self._advanced.drawing.sight_m
        cast = [believed_scan(drawn, mouths, pose, circle, reach, sight_m=sight_m) if drawn else None for pose in placed]
        last = _turned(self.pose_covariance(), self.filter.state.clones[-1, 2])  # along its own axes
        return Revision(np.stack(placed), tuple(cast), tuple(d.wall for d in drawn), embed(last))

    def pose_covariance(self) -> np.ndarray:
        """(3, 3) of x, y, yaw of the present pose in the map."""
        return self.filter.state.pose_covariance()[:3, :3]

    def walls(self) -> tuple[Wall, ...]:
        return tuple(d.wall for d in self._drawn())

    def _drawn(self) -> tuple[Drawn, ...]:
        return walls_of(self.filter.state.planes, self.filter.poses()[:, :2], self._advanced.drawing)


class Ledger:
    """Turns the covariance of a pose in the map into covariances of motions for those who add motions up.

    The filter's pose is held by walls and right angles, so its errors of one step are partly taken back in later ones;
    adding up what each step could be wrong by would claim several degrees where half a degree is true. Each motion is
    given as little as keeps the sum at or above the covariance of the pose itself."""

    def __init__(self, least_m: float = 2e-4, least_rad: float = 5e-5) -> None:
        self._least = np.diag([least_m, least_m, least_rad]) ** 2  # no motion is known better
        self._pose: np.ndarray | None = None
        self._sum = np.zeros((3, 3))

    def motion(self, pose: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """(3, 3) for the motion to `pose` (x, y, yaw), in its own frame. covariance: (3, 3) of the pose in the map."""
        own = _turned(covariance, pose[2])
        if self._pose is None:
            self._pose, self._sum = pose.copy(), own
            return np.zeros((3, 3))
        motion = inverse(se2(*self._pose)) @ se2(*pose)
        carry = adjoint(inverse(motion))[np.ix_([0, 1, 5], [0, 1, 5])]
        before = carry @ self._sum @ carry.T
        values, axes = np.linalg.eigh(own - before)
        step = axes @ np.diag(np.maximum(values, 0.0)) @ axes.T + self._least
        self._pose, self._sum = pose.copy(), before + step
        return step


def _turned(covariance: np.ndarray, yaw_rad: float) -> np.ndarray:
    """A (3, 3) covariance of x, y, yaw in the map, seen along the axes of a body with that heading."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return back @ covariance @ back.T
