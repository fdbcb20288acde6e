"""What every monocular odometry shares: tracks in, the motion of the believed pose out; and the tracks file if wanted."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Protocol

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.geometry import Camera, inverse, orthonormal, se2
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking

from .klt import KltTracker
from .settings import AlarmSettings, KltSettings
from .track_frames import TrackFrame, Tracks, save_tracks

# Metres and degrees between views: nobody tells how far it went, so that points must be looked for where they were.
SHORT_STEPS = (0.125, 6.5)


@dataclass(frozen=True, eq=False)
class Estimate:
    """What a filter believes after a view. map_from_body 4x4; motion_covariance (6, 6) of the body's motion since the
    previous view, in the body frame; trusted: False where the filter itself doubts its model, and why."""

    map_from_body: np.ndarray
    motion_covariance: np.ndarray
    trusted: bool = True
    reason: str = ""
    details: Mapping[str, float] = field(default_factory=dict)


class TrackFilter(Protocol):
    """A filter over tracks. The first frame defines the start and moves nothing."""

    def step(self, frame: TrackFrame) -> Estimate: ...

    def scan(self) -> Scan | None: ...

    def revise(self) -> Revision | None: ...


class MonocularOdometry(Odometry):
    """An odometry made of a front end and a filter.

    start (4x4): the map pose that others believe in at the first view. A filter that begins elsewhere (started wrongly on
    purpose) shows that in its second motion, so that the sum of the motions is always the filter's own belief. few_tracks:
    fewer followed points than this and the view says nothing."""

    def __init__(self, front: KltTracker | None, core: TrackFilter, start: np.ndarray, *, few_tracks: int = 8) -> None:
        self._front, self._filter, self._few = front, core, few_tracks
        self._pose, self._begun = start, False
        self.keep: list[TrackFrame] | None = None  # a list here collects the frames of the survey
        self.scale_from = "nothing"  # for the row: what its metres come from
        self.at_end: Callable[[list[TrackFrame]], None] | None = None

    def update(self, observation: Observation) -> Motion:
        """Follow the points, filter them, and say how the believed pose moved (corrections of the past included)."""
        assert self._front is not None, "this odometry was made for tracks, not for images"
        return self.update_tracks(self._front.track(observation))

    def update_tracks(self, frame: TrackFrame) -> Motion:
        """The same from tracks followed before."""
        if self.keep is not None:
            self.keep.append(frame)
        estimate = self._filter.step(frame)
        details = {"tracks": float(len(frame.ids)), **estimate.details}
        if not self._begun:
            self._begun = True
            return Motion(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view", details=details)
        motion = orthonormal(inverse(self._pose) @ estimate.map_from_body)
        self._pose = estimate.map_from_body
        status, reason = Tracking.OK, ""
        if len(frame.ids) < self._few:
            status, reason = Tracking.LOST, f"{len(frame.ids)} points followed, {self._few} needed; went on blindly"
        elif not estimate.trusted:
            status, reason = Tracking.DEGENERATE, estimate.reason
        return Motion(motion, estimate.motion_covariance, status, reason, scan=self._filter.scan(), details=details)

    def revise(self) -> Revision | None:
        """The filter's last word on the survey; the frames, if they were kept, are handed over."""
        if self.keep is not None and self.at_end is not None:
            self.at_end(self.keep)
            self.keep = None
        return self._filter.revise()


def monocular_odometry(
    settings: Any, context: Context, core: TrackFilter, scale_from: str, follow: KltSettings
) -> MonocularOdometry:
    """settings: a config with `points` and `save_tracks`. scale_from: what the filter's metres come from, for the row.
    follow: how points are followed."""
    eye = MonocularOdometry(KltTracker(follow, settings.points), core, se2(*context.world.start),
                            few_tracks=settings.advanced.few_tracks)
    eye.scale_from = scale_from
    if getattr(settings, "motion", "none") == "none":
        eye.keeps_moving = SHORT_STEPS
    if settings.save_tracks:
        eye.keep, eye.at_end = [], partial(_save, context)
    return eye


def _save(context: Context, frames: Sequence[TrackFrame]) -> None:
    unknown = np.full((len(frames), 4, 4), np.nan)
    save_tracks(context.folder / "tracks.npz", Tracks(context.camera, np.array(context.world.start), frames, unknown))


class StructureAlarm:
    """Says when the structure ends: many points with a depth of their own that lie on no known wall.

    The share over the last views must stay above the threshold for some. The share of accepted measurements cannot tell:
    it stays at 0.95 while the thesis's filter is four metres wrong.
    """

    def __init__(self, settings: AlarmSettings = AlarmSettings()) -> None:  # noqa: B008 (frozen)
        self._settings = settings
        self._counts: deque[tuple[int, int]] = deque(maxlen=settings.views)
        self._above = 0

    def watch(self, strays: int, strong: int) -> float:
        """Count one view; returns the present share, NaN where too few points have depth."""
        self._counts.append((strays, strong))
        total = sum(s for _, s in self._counts)
        share = sum(s for s, _ in self._counts) / total if total >= self._settings.least else float("nan")
        self._above = self._above + 1 if share > self._settings.threshold else 0
        return share

    @property
    def ringing(self) -> bool:
        return self._above >= self._settings.patience


def embed(planar_covariance: np.ndarray, tilt_sigma_rad: float = 1e-3) -> np.ndarray:
    """(6, 6) covariance of a pose on the floor from its (3, 3) of x, y, yaw."""
    out = np.diag([0.0, 0.0, 1e-6, tilt_sigma_rad**2, tilt_sigma_rad**2, 0.0])
    index = np.ix_([0, 1, 5], [0, 1, 5])
    out[index] = planar_covariance + 1e-12 * np.eye(3)
    return out


def beams(camera: Camera, count: int = 81) -> np.ndarray:
    """(count,) bearings across the camera's horizontal field of view, radians, left positive."""
    edges = camera.rays(np.array([[0.0, camera.cy], [camera.width - 1.0, camera.cy]]))
    right, left = (float(np.arctan2(-x, 1.0)) for x in edges[::-1, 0])
    return np.linspace(right, left, count)
