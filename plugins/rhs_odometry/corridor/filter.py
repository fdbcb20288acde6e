"""The corridor filter: a window of poses, a list of walls whose plan nobody gave, and one update per view.

The thesis's measurement (back-project on the wall, re-project into the next view) made fit for corners: two views become
a window, the one section becomes a list of walls with right angles as a soft prior, and a track is triangulated before
it is attached to a wall.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field

import numpy as np

from rhs.api.geometry import Camera
from rhs.estimation.filters.kalman import correct_information

from ..tracks.track_frames import TrackFrame
from .config import CorridorAdvanced, FloorRules
from .fit import TrackFit, WindowCameras, cameras_of, fit_free, fit_on_planes
from .floor_level import FloorLevel
from .motion import ConstantVelocity, GivenMotion, SpinWatch
from .state import SPEED, TURN, WIDTH, CorridorState, Plane
from .update import free_rows, plane_rows
from .walls import Attachment, WallFinder, attach, merge_one, record_hits
from .width import agrees, find_pair, fits, use_pair
from .window import TrackWindow


@dataclass(frozen=True)
class FilterSettings:
    """What the corridor filter is given; see CorridorEkf for meanings and reasons."""

    window: int = 12
    """views a track may span"""
    pixel_sigma: float = 1.0
    """noise of a track, pixels"""
    tilt_sigma_rad: float = 1e-4
    """pitch and roll of a view, radians (1 sigma)"""
    angle_sigma_rad: float = 0.003
    """how far walls may be from the right angle, radians (1 sigma): the prior that holds the heading"""
    linearisations: int = 1
    """passes over the tracks of a view"""
    width_known: bool = True
    """the width may set the scale of everything at the first pair"""
    advanced: CorridorAdvanced = field(default_factory=CorridorAdvanced)
    """the thresholds"""
    walls: bool = True
    """walls are looked for and hold the heading; without them no view tells it (see CorridorState.carried)"""
    floor: FloorRules = field(default_factory=FloorRules)
    """without walls: which points are the floor's"""


@dataclass(frozen=True)
class Tally:
    """What happened to the tracks of one view: due, used on walls, used as free points, refused, strong, stray."""

    due: int = 0
    on_walls: int = 0
    free: int = 0
    refused: int = 0
    strong: int = 0
    stray: int = 0


class CorridorFilter:
    """Filter over TrackFrames. After `step`, `state` holds the newest pose last; `history` the poses before the window."""

    def __init__(
        self, camera: Camera, state: CorridorState, motion: GivenMotion | ConstantVelocity, settings: FilterSettings
    ) -> None:
        self.state, self.tally = state, Tally()
        self.history: list[np.ndarray] = []
        self._camera, self._motion, self._settings = camera, motion, settings
        self._origin = np.array([*state.clones[0, :2], camera.height_m])
        self._sigma = settings.pixel_sigma / (0.5 * (camera.fx + camera.fy))
        self._advanced = settings.advanced
        self._tracks = TrackWindow(camera, settings.window, least_views=settings.advanced.least_views)
        self._spin = SpinWatch(camera, settings.advanced.motion)
        self._start_speed = float(state.base[SPEED]), float(np.sqrt(state.covariance[SPEED, SPEED]))
        self._finder = WallFinder(settings.advanced.walls, camera.height_m)
        self._floor = FloorLevel(settings.floor)
        self._view, self._stamp_s, self._scaled = -1, 0.0, False

    def step(self, frame: TrackFrame) -> None:
        """One view: move, triangulate the tracks that fall due, update once, update the list of walls."""
        self._view += 1
        self._move(frame)
        rays, seen = self._tracks.push(frame)
        self.tally = self._measure(rays[:, -self.state.window :], seen[:, -self.state.window :])
        if self._view % 2 == 0:
            self._find_wall()
        self._use_width()
        if self._view % 5 == 0:
            merge_one(self.state, self._advanced.walls)

    def poses(self) -> np.ndarray:
        """(views, 5) x, y, yaw, pitch, roll of all views so far: those left behind as they left the window."""
        return np.vstack([*self.history, self.state.clones])

    @property
    def viewed(self) -> int:
        """Views so far."""
        return self._view + 1

    def _move(self, frame: TrackFrame) -> None:
        seconds, self._stamp_s = frame.stamp_s - self._stamp_s, frame.stamp_s
        if self._view == 0:
            return
        if self.state.window == self._settings.window:
            self.history.append(self.state.drop_oldest_clone())
        if isinstance(self._motion, ConstantVelocity) and self._spin.goes_on(self.state.clones, frame):
            self.state.forget(SPEED, *self._start_speed)
            self.state.forget(TURN, 0.0, self._advanced.motion.turn_sigma_radps)
        expected = self._motion.expect(frame, self.state.base, seconds)
        self.state.append_clone(expected, self._settings.tilt_sigma_rad)

    def _measure(self, rays: np.ndarray, seen: np.ndarray) -> Tally:
        """One update by the tracks. The first estimate of the poses may be too poor to triangulate from (a camera that sways
        by degrees); then the tracks are looked at again from where they themselves put the camera (iterated filter)."""
        if not len(rays):
            return Tally()
        before, prior = copy(self.state), self.state.covariance
        shift = np.zeros(len(prior))
        for again in reversed(range(self._settings.linearisations)):
            cameras = cameras_of(self.state.clones, self._camera.body_from_camera)
            fit = fit_free(cameras, rays, seen, self._sigma)
            found = attach(self.state, fit, self._advanced.walls)
            if not self._settings.walls:
                found = found.only(self._floor.lies_on(self.state, fit))
            information, vector, used, points = self._rows(cameras, rays, seen, (fit, found, shift))
            change = correct_information(prior, information, vector)
            shift, self.state = change.delta, copy(before)
            self.state.add(shift, prior if again else change.covariance)
        if not self._settings.walls:
            self._floor.remember()
            self.state.covariance = self.state.carried(shift)
        hit = np.where(used == 1, found.wall, -1)
        self.state.planes = record_hits(self.state.planes, hit, points, fit.anchor)
        self._finder.remember(points[found.strong & (used == 2)], self._view)
        return Tally(
            due=len(rays),
            on_walls=int((used == 1).sum()),
            free=int((used == 2).sum()),
            refused=int((used == 0).sum()),
            strong=int(found.strong.sum()),
            stray=int(found.stray.sum()),
        )

    def _rows(
        self, cameras: WindowCameras, rays: np.ndarray, seen: np.ndarray, how: tuple[TrackFit, Attachment, np.ndarray]
    ):
        """Sums of all rows that pass their gate; (T,) use: 1 on a wall, 2 as a free point, 0 refused; points (T, 3).

        how: free points, walls, and the (D,) way the state has been moved since its prior."""
        fit, found, shift = how
        size, points = len(self.state.covariance), fit.points()
        information, vector, used = np.zeros((size, size)), np.zeros(size), np.zeros(len(rays), int)
        on = np.flatnonzero(found.wall >= 0)
        if len(on):
            walls = [self.state.planes[j] for j in found.wall[on]]
            flat = fit_on_planes(cameras, rays[on], seen[on], self._sigma, walls)
            rows = plane_rows(self.state, cameras, rays[on], seen[on], (flat, found.wall[on], self._sigma))
            rows = rows.moved_back(shift)
            good = flat.good & rows.passed(self._advanced.gate_probability)
            used[on[good]] = 1
            points[on[good]] = flat.points()[good]
            information, vector = rows.sums(good)
        rest = np.flatnonzero((used == 0) & fit.good)
        if len(rest):
            one = TrackFit(*(getattr(fit, k)[rest] for k in ("angles", "rho", "anchor", "rho_sigma", "cost", "good")))
            rows = free_rows(self.state, cameras, rays[rest], seen[rest], one, self._sigma)
            rows = rows.moved_back(shift)
            good = rows.passed(self._advanced.gate_probability)
            used[rest[good]] = 2
            more = rows.sums(good)
            information, vector = information + more[0], vector + more[1]
        if np.count_nonzero(used) < self._advanced.agreeing_share * len(used):
            return np.zeros_like(information), np.zeros_like(vector), np.zeros_like(used), points
        return information, vector, used, points

    def _find_wall(self) -> None:
        plane = self._finder.find(self.state.planes)
        if plane is None:
            return
        angle = self._settings.angle_sigma_rad if not plane.is_floor else 1e-4
        self.state.add_plane(plane, (self._advanced.walls.offset_sigma_m, angle))

    def _use_width(self) -> None:
        rules = self._advanced.width
        pair = find_pair(self.state, rules)
        if pair is None:
            return
        width = float(self.state.base[WIDTH])
        if self._settings.width_known and not self._scaled:
            self._rescale(width / pair.gap_m)
            pair = find_pair(self.state, rules)
        if pair is not None and fits(pair, width, rules) and agrees(self.state, pair, rules):
            use_pair(self.state, pair, rules)
            self._scaled = True

    def _rescale(self, factor: float) -> None:
        """The first known width sets the scale of everything measured so far: a change of gauge, not a measurement."""
        self.state.rescale(factor, self._origin)
        self._finder.rescale(factor, self._origin)
        for pose in self.history:
            pose[:2] = self._origin[:2] + factor * (pose[:2] - self._origin[:2])
        self._scaled = True


def floor_plane(height_sigma_m: float) -> tuple[Plane, tuple[float, float]]:
    """The floor z = 0 with the uncertainty of the camera's height above it, ready for CorridorState.add_plane."""
    return Plane(2, 0.0, 0.0, 0.0, 0.0, 0.0), (height_sigma_m, 1e-4)
