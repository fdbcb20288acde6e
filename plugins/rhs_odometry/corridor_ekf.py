"""The odometry `corridor_ekf`: the corridor filter between a front end and the rest of the program."""

from __future__ import annotations

import numpy as np

from rhs.contracts import Context
from rhs.geometry import Camera, se2
from rhs.records import Revision, Scan, Wall
from rhs.structure import cast_on_walls

from .corridor_ekf_config import CorridorEkf
from .corridor_filter import CorridorFilter, FilterSettings, floor_plane
from .corridor_map import walls_of
from .corridor_motion import Inertia, MotionNoise, Told
from .corridor_state import SCALE, WIDTH, CorridorState
from .corridor_walls import WallRules
from .one_eye import Estimate, OneEye, StructureAlarm, beams, embed
from .one_eye_parts import one_eye
from .track_frames import TrackFrame

UNKNOWN_WIDTH = (2.6, 0.6)  # metres, prior of an unknown width: narrow corridors of houses to wide ones of offices
UNKNOWN_HEIGHT_SIGMA_M = 0.5
DRAWN_M = 4.0  # finished walls are drawn from no further: there half a degree is one cell, and no cell of a wall is missed


def build_corridor_ekf(settings: CorridorEkf, context: Context) -> OneEye:
    core = corridor_core(settings, context.camera, np.array(context.world.start))
    return one_eye(settings, context, core)


def corridor_core(settings: CorridorEkf, camera: Camera, start: np.ndarray) -> CorridorCore:
    """The filter for a camera that begins at the (3,) pose x m, y m, yaw rad of the map."""
    width = (settings.width_m, settings.width_sigma_m) if settings.width_m > 0 else UNKNOWN_WIDTH
    tilt, heading = np.radians(settings.wobble_sigma_deg), np.radians(settings.start_heading_sigma_deg)
    base_sigma = np.array([settings.speed_sigma_mps, 0.05, settings.motion_scale_sigma, width[1]])
    state = CorridorState(
        np.array([settings.speed_mps, 0.0, 1.0, width[0]]),
        base_sigma,
        np.array([*start, 0.0, 0.0]),
        np.array([1e-3, 1e-3, heading, tilt, tilt]),
    )
    state.add_plane(*floor_plane(settings.height_sigma_m if settings.height_known else UNKNOWN_HEIGHT_SIGMA_M))
    noise = MotionNoise(forward=settings.forward_noise, turn=settings.turn_noise)
    motion = Inertia(noise) if settings.motion == "none" else Told(noise, wheels=settings.motion == "wheel")
    rules = WallRules(angle_sigma_rad=float(np.radians(settings.right_angle_sigma_deg)))
    from_width = settings.width_m > 0 and not settings.height_known
    core = FilterSettings(settings.window, settings.pixel_sigma_px, tilt, from_width, rules)
    return CorridorCore(CorridorFilter(camera, state, motion, core), camera, settings.scan_range_m)


class CorridorCore:
    """TrackFilter over a CorridorFilter: adds the alarm, scans of the walls, and the revised survey."""

    def __init__(self, core: CorridorFilter, camera: Camera, scan_range_m: float) -> None:
        self.filter = core
        self._bearings, self._range_m = beams(camera), scan_range_m
        self._alarm = StructureAlarm()

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
        covariance = motion_covariance(state)
        if not trusted:
            covariance = covariance + self.filter.expected_noise()
        reason = "" if trusted else f"the structure ends: {share:.0%} of the points with depth lie on no known wall"
        return Estimate(se2(*state.clones[-1, :3]), embed(covariance), trusted, reason, details)

    def scan(self) -> Scan | None:
        """What the walls known so far would give from here."""
        return self._cast(self.filter.state.clones[-1])

    def revise(self) -> Revision | None:
        """Poses as they left the window, and all scans cast on the walls as they are now. Now that the walls are known,
        a scan covers the full circle: what the camera saw ahead before stands beside it later."""
        poses, walls = self.filter.poses(), self.walls()
        circle, reach = np.linspace(-np.pi, np.pi, 720, endpoint=False), min(self._range_m, DRAWN_M)
        cast = [cast_on_walls(walls, se2(*p[:3]), circle, reach) if walls else None for p in poses]
        return Revision(np.stack([se2(*p[:3]) for p in poses]), tuple(cast), walls)

    def pose_covariance(self) -> np.ndarray:
        """(3, 3) of x, y, yaw of the present pose in the map."""
        return self.filter.state.pose_covariance()[:3, :3]

    def walls(self) -> tuple[Wall, ...]:
        return walls_of(self.filter.state.planes, self.filter.poses()[:, :2])

    def _cast(self, pose: np.ndarray) -> Scan | None:
        walls = self.walls()
        return cast_on_walls(walls, se2(*pose[:3]), self._bearings, self._range_m) if walls else None


def motion_covariance(state: CorridorState) -> np.ndarray:
    """(3, 3) of the motion x, y, yaw between the last two poses, in the frame of the last one."""
    if state.window < 2:
        return 1e-12 * np.eye(3)
    last, before = state.clone_slice(-1), state.clone_slice(-2)
    rows = np.r_[before.start : before.start + 3, last.start : last.start + 3]
    joint = state.covariance[np.ix_(rows, rows)]
    dx, dy = state.clones[-1, :2] - state.clones[-2, :2]
    c, s = np.cos(state.clones[-1, 2]), np.sin(state.clones[-1, 2])
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    # error of the later pose minus that of the earlier one carried along: a turn of the earlier pose swings the motion
    carried = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    jacobian = np.hstack([-back @ carried, back])
    return jacobian @ joint @ jacobian.T
