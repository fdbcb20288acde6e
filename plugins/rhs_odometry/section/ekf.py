"""The odometries `section_ekf` and `tube_ekf`: the thesis's filter between a front end and the rest of the program."""

from __future__ import annotations

from collections import deque

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import Camera, adjoint, exp_so3, inverse, se2, se3
from rhs.api.records import Revision, Scan, Wall
from rhs.estimation.scans.wall_rays import cast_on_walls

from ..corridor.fit import WindowCameras, fit_free
from ..corridor.window import TrackWindow
from ..tracks.monocular import Estimate, MonocularOdometry, StructureAlarm, beams, monocular_odometry
from ..tracks.track_frames import TrackFrame, common
from .config import SectionEkf
from .filter import (
    AXIS,
    CENTRE,
    ERROR_STATES,
    POSITION,
    SIZE,
    SPEED,
    SPIN,
    TURN,
    Rectangular,
    Round,
    SectionFilter,
    SectionState,
)


def build_section_ekf(settings: SectionEkf, context: Context) -> MonocularOdometry:
    core = section_core(settings, context.camera, np.array(context.world.start))
    return monocular_odometry(settings, context, core, f"half width {settings.half_size_m:g} m", settings.advanced.follow)


def section_core(settings: SectionEkf, camera: Camera, start: np.ndarray) -> SectionCore:
    """The filter for a camera that begins at the (3,) pose x m, y m, yaw rad, in the middle of a section along it."""
    believed = se2(*start) @ se3(exp_so3(np.radians(settings.start_error_deg)), np.array(settings.start_error_m))
    eye = believed @ camera.body_from_camera
    axes = se2(0.0, 0.0, start[2])[:3, :3]
    half_height = settings.half_size_m * (settings.aspect if settings.shape == "rectangular" else 1.0)
    state = SectionState(
        eye[:3, 3],
        eye[:3, :3],
        settings.speed_mps * axes[:, 0],
        np.zeros(3),
        np.array([start[0], start[1], half_height]),
        axes,
        float(np.log(settings.half_size_m)),
    )
    sigma = np.zeros(ERROR_STATES)
    sigma[POSITION], sigma[TURN] = settings.start_sigma_m, np.radians(settings.start_sigma_deg)
    a = settings.advanced
    sigma[SPIN] = a.spin_sigma_radps
    sigma[CENTRE], sigma[AXIS], sigma[SIZE] = a.centre_sigma_m, a.axis_sigma_rad, settings.size_sigma
    shape = Rectangular(settings.aspect) if settings.shape == "rectangular" else Round()
    covariance = np.diag(sigma**2)
    drift = settings.drift_sigma_mps**2
    covariance[SPEED, SPEED] = axes @ np.diag([settings.speed_sigma_mps**2, drift, drift]) @ axes.T
    return SectionCore(SectionFilter(camera, shape, state, covariance, settings), camera, settings)


class SectionCore:
    """TrackFilter over a SectionFilter: chooses the points, draws the sketch of the walls, and doubts."""

    def __init__(self, core: SectionFilter, camera: Camera, settings: SectionEkf) -> None:
        self.filter = core
        self._camera, self._pairs, self._range_m = camera, settings.pairs, settings.scan_range_m
        self._sigma = settings.pixel_sigma_px / camera.fx
        self._bearings = beams(camera)
        self._before: TrackFrame | None = None
        self._seconds = 0.25
        a = self._advanced = settings.advanced
        self._window = TrackWindow(camera, a.alarm_views)
        self._recent: deque[np.ndarray] = deque(maxlen=a.alarm_views)
        self._alarm = StructureAlarm(a.alarm)

    def step(self, frame: TrackFrame) -> Estimate:
        before, self._before = self._before, frame
        if before is not None:
            a, b = common(before, frame)
            keep = np.linspace(0, len(a) - 1, min(self._pairs, len(a))).astype(int)
            self._seconds = max(frame.stamp_s - before.stamp_s, 1e-3)
            self.filter.step(a[keep], b[keep], self._seconds)
        share = self._doubt(frame)
        state = self.filter.state
        details = {
            "accepted_share": self.filter.accepted,
            "stray_share": share,
            "speed_mps": float(np.linalg.norm(state.speed)),
            "half_size_m": float(np.exp(state.log_size)),
        }
        trusted = not self._alarm.ringing
        reason = "" if trusted else f"the section ends: {share:.0%} of the points with depth do not lie on it"
        return Estimate(self._pose(), self._motion_covariance(trusted), trusted, reason, details)

    def scan(self) -> Scan | None:
        pose = self._pose()
        return cast_on_walls(self.walls(), pose, self._bearings, self._range_m)

    def revise(self) -> Revision | None:
        """A filter without memory has nothing to say afterwards."""
        return None

    def walls(self) -> tuple[Wall, ...]:
        """The two side walls of the section round the present position."""
        state = self.filter.state
        size, axes = float(np.exp(state.log_size)), state.axes
        line_m, here = self._advanced.line_m, state.centre + axes[:, 0] * (axes[:, 0] @ (state.position - state.centre))
        return tuple(
            Wall((here - line_m * axes[:, 0] + side * axes[:, 1])[:2], (here + line_m * axes[:, 0] + side * axes[:, 1])[:2])
            for side in (size, -size)
        )

    def pose_covariance(self) -> np.ndarray:
        """(3, 3) of x, y, yaw of the present pose in the map."""
        covariance, rotation = self.filter.covariance, self.filter.state.rotation
        yaw = (rotation @ covariance[TURN, TURN] @ rotation.T)[2, 2]
        out = np.zeros((3, 3))
        out[:2, :2], out[2, 2] = covariance[POSITION, POSITION][:2, :2], yaw
        return out

    def _pose(self) -> np.ndarray:
        state = self.filter.state
        return se3(state.rotation, state.position) @ inverse(self._camera.body_from_camera)

    def _motion_covariance(self, trusted: bool) -> np.ndarray:
        """(6, 6) in the body frame: what one view adds. The speed is what carries the uncertainty from view to view."""
        covariance, rotation = self.filter.covariance, self.filter.state.rotation
        camera = np.zeros((6, 6))
        camera[:3, :3] = rotation.T @ covariance[SPEED, SPEED] @ rotation * self._seconds**2
        camera[3:, 3:] = covariance[SPIN, SPIN] * self._seconds**2
        move = adjoint(self._camera.body_from_camera)
        wider = 1.0 if trusted else self._advanced.doubt**2
        return wider * (move @ camera @ move.T) + 1e-10 * np.eye(6)

    def _doubt(self, frame: TrackFrame) -> float:
        """Triangulate the tracks that fall due by themselves, and count those whose depth is not the section's."""
        state = self.filter.state
        self._recent.append(se3(state.rotation, state.position))
        rays, seen = self._window.push(frame)
        n = len(self._recent)
        rays, seen = rays[:, -n:], seen[:, -n:]
        if not len(rays) or n < 4:
            return self._alarm.watch(0, 0)
        poses = np.stack(list(self._recent))
        centre = poses[:, :3, 3]
        cameras = WindowCameras(poses[:, :3, :3], centre, centre, np.zeros((n, 3, 3)))
        fit = fit_free(cameras, rays, seen, self._sigma)
        a = self._advanced
        strong = fit.good & (fit.rho > 1.0 / a.farthest_m) & (fit.rho_sigma < a.strong_share * fit.rho)
        rho = self._section_rho(fit.anchor, fit.directions())
        stray = strong & ~(np.abs(rho - fit.rho) < a.stray_sigmas * fit.rho_sigma + a.stray_share * fit.rho)
        return self._alarm.watch(int(stray.sum()), int(strong.sum()))

    def _section_rho(self, anchors: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(T,) inverse distance at which rays of the map (T, 3) from anchors (T, 3) pierce the section."""
        state, section = self.filter.state, self.filter.section
        size = float(np.exp(state.log_size))
        reach = [section.meet(state.axes.T @ (a - state.centre), (d @ state.axes)[None], size)[0]
                 for a, d in zip(anchors, directions, strict=True)]
        with np.errstate(divide="ignore", invalid="ignore"):
            return 1.0 / np.array(reach)
