"""The odometry `ground_msckf`: one camera at a known height over a level floor, in any building.

A window of poses held by points followed through it (multi-state filter; Mourikis and Roumeliotis 2007), of which those
on the floor set the scale; no walls are assumed. The filter is that of corridor_ekf without its walls. The way ahead is
measured in the pictures (stixels.py), and so are the scans of the map.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse, orthonormal, se2
from rhs.api.records import Motion, Observation, Revision, Tracking
from rhs.estimation.views.settings import scaled_px

from ..corridor.config import CorridorAdvanced, WallRules
from ..corridor.ekf import Ledger
from ..corridor.filter import CorridorFilter, FilterSettings, floor_plane
from ..corridor.motion import GivenMotion, MotionNoise
from ..corridor.state import SCALE, CorridorState
from ..tracks.klt import KltTracker
from ..tracks.monocular import embed
from ..tracks.track_frames import TrackFrame, common
from .config import GroundMsckf, GroundMsckfAdvanced
from .stixels import Stixels

NO_WALLS = CorridorAdvanced(walls=WallRules(points=10_000, walls_before_floor=0), agreeing_share=0.5)
SHORT_STEPS = (0.125, 6.5)  # metres and degrees between two views that are compared; as its surveys have them
START_M, START_RAD = 1e-3, 1e-3  # the map begins where the camera stands: nothing is unknown there


def build_ground_msckf(settings: GroundMsckf, context: Context) -> GroundOdometry:
    if context.camera.height_m <= 0.0:
        raise ConfigError("odometry=ground_msckf follows a camera at a known height over a floor, and nothing says how high "
                          "this one is; type source.camera_mount=[0,0,HEIGHT_M,0,0,0] if it was so, or "
                          "odometry=monocular_vo, which needs no height")
    return GroundOdometry(settings, context.camera, np.array(context.world.start))


def ground_filter(settings: GroundMsckf, camera: Camera, start: np.ndarray) -> CorridorFilter:
    """The filter of a camera that begins at the (3,) pose x m, y m, yaw rad of the map."""
    tilt = float(np.radians(settings.wobble_sigma_deg))
    state = CorridorState(np.array([0.0, 0.0, 1.0, 1.0]), np.array([1e-3, 1e-3, settings.motion_scale_sigma, 1e-3]),
                          np.array([*start, 0.0, 0.0]), np.array([START_M, START_M, START_RAD, tilt, tilt]))
    state.add_plane(*floor_plane(settings.height_share * camera.height_m))
    motion = GivenMotion(MotionNoise(settings.forward_noise, settings.turn_noise, NO_WALLS.motion),
                         wheels=settings.motion == "wheel")
    passes = 2 if settings.wobble_sigma_deg > NO_WALLS.sways_deg else 1
    core = FilterSettings(settings.window, settings.pixel_sigma_px, tilt, 1.0, passes, False, NO_WALLS, walls=False,
                          floor=settings.advanced.floor)
    return CorridorFilter(camera, state, motion, core)


class GroundOdometry(Odometry):
    """Motions of the filter, scans of the stixels."""

    def __init__(self, settings: GroundMsckf, camera: Camera, start: np.ndarray) -> None:
        self.short_steps = SHORT_STEPS
        self.scale_from = f"camera height + {settings.motion}"
        self._settings, self._camera, self._start = settings, camera, se2(*start)
        self._front = KltTracker(settings.advanced.follow, settings.points)
        self._filter, self._stixels = ground_filter(settings, camera, start), Stixels(camera, settings.advanced.stixels)
        self._poses = np.zeros((0, 3))  # of all views, those in the window as they are believed now
        self._ledger = Ledger(settings.advanced.least_step_m, settings.advanced.least_turn_rad)
        self._measured: deque[int] = deque(maxlen=settings.advanced.measured_views)
        self._before: TrackFrame | None = None
        self._surveyed = 0  # views of the survey, when it is over

    def update(self, observation: Observation) -> Motion:
        frame = self._front.track(observation)
        before, self._before = self._before, frame
        followed = 0 if before is None else len(common(before, frame)[0])
        stands = before is not None and standing(before, frame, self._camera, self._settings.advanced)
        pose = self._pose()
        self._filter.step(halted(frame) if stands else replace(frame, stopped=bool(observation.contact)))
        clones = self._filter.state.clones[:, :3]
        self._poses = np.vstack([self._poses[: self._filter.viewed - len(clones)], clones])
        tally = self._filter.tally
        self._measured.append(tally.on_walls + tally.free)
        self._stixels.add(observation.image)
        if self._surveyed:
            # what came since the survey is on none of its pictures
            self._stixels.forget(max(len(self._poses) - self._settings.advanced.stixels.oldest, self._surveyed))
        scan = self._stixels.scan(len(self._poses) - 1, self._poses)
        if before is None:
            self._ledger.motion(clones[-1], self._filter.state.pose_covariance()[:3, :3])
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view", scan=scan, scan_measured=scan is not None,
                          details=self._details(followed, stands))
        motion = orthonormal(inverse(pose) @ self._pose())
        covariance = self._ledger.motion(clones[-1], self._filter.state.pose_covariance()[:3, :3])
        covariance = covariance + drift(self._settings, motion)
        status, reason = self._status(followed, len(before.ids))
        return Motion(motion, embed(covariance), status, reason, scan=scan, scan_measured=scan is not None,
                      details=self._details(followed, stands))

    def revise(self) -> Revision | None:
        """Poses as they left the window, and the scans that all views together give."""
        if not len(self._poses):
            return None
        self._surveyed = len(self._poses)
        poses = np.stack([se2(*pose) for pose in self._poses])
        poses[0] = self._start
        scans = [self._stixels.scan(view, self._poses, learn=False, later=True) for view in range(len(poses))]
        return Revision(poses, tuple(scans))

    def _pose(self) -> np.ndarray:
        return se2(*self._filter.state.clones[-1, :3])

    def _status(self, followed: int, of: int) -> tuple[Tracking, str]:
        """followed: points of the last view found in this one; of: how many it had."""
        advanced = self._settings.advanced
        if followed < advanced.few_tracks:
            return Tracking.LOST, f"{followed} points followed, {advanced.few_tracks} needed; went on blindly"
        if followed < advanced.followed_share * of:
            return Tracking.DEGENERATE, f"{followed} of {of} points followed, as of a camera that was carried off"
        if len(self._measured) == advanced.measured_views and sum(self._measured) < advanced.few_measured:
            return Tracking.DEGENERATE, (f"{sum(self._measured)} points measured in {advanced.measured_views} views, "
                                         f"{advanced.few_measured} needed; the {self._settings.motion} alone tells the way")
        return Tracking.OK, ""

    def _details(self, followed: int, stands: bool) -> dict[str, float]:
        state, tally = self._filter.state, self._filter.tally
        spread = state.pose_covariance()
        return {"tracks": float(followed), "due": float(tally.due), "on_floor": float(tally.on_walls),
                "free_points": float(tally.free), "refused": float(tally.refused), "scale": float(state.base[SCALE]),
                "stands": float(stands), "sigma_m": float(np.sqrt(np.trace(spread[:2, :2]))),
                "sigma_yaw_rad": float(np.sqrt(spread[2, 2]))}


def drift(s: GroundMsckf, motion: np.ndarray) -> np.ndarray:
    """(3, 3) covariance of one (4, 4) motion, x, y, yaw along its own axes, by what is lost in a step besides what the
    filter knows: errors of its points go together along their tracks, and each linearisation lets it believe in a little
    more heading than anybody saw (Huang, Mourikis and Roumeliotis 2010). No view takes it back: whoever adds motions up from
    a place that he knows again loses it anew."""
    turned, way_m = abs(float(np.arctan2(motion[1, 0], motion[0, 0]))), float(np.hypot(*motion[:2, 3]))
    on_the_spot = s.drift_spot**2 * turned if way_m < s.advanced.stixels.pivot_m else 0.0
    heading = s.drift_rad_per_m**2 * way_m + (s.drift_rad_per_rad * turned) ** 2 + on_the_spot
    return np.diag([s.drift_m_per_m**2 * way_m] * 2 + [heading])


def standing(before: TrackFrame, now: TrackFrame, camera: Camera, advanced: GroundMsckfAdvanced) -> bool:
    """Whether the pictures show that the camera did not move, whatever it was told."""
    a, b = common(before, now)
    if len(a) < advanced.still_points:
        return False
    moved = np.hypot(*(b - a).T) > scaled_px(advanced.still_px, camera.width)
    return bool(1.0 - moved.mean() >= advanced.still_share)


def halted(frame: TrackFrame) -> TrackFrame:
    """The view of a camera that did not move."""
    return replace(frame, command=np.array([0.0, 0.0, 0.0]), wheel=np.zeros(3))
