"""Monocular visual odometry: corners followed, an essential matrix to begin with, then PnP against a local map.

After Klein and Murray, PTAM (ISMAR 2007), Nister et al., "Visual odometry" (CVPR 2004) and ORB-SLAM's rules for beginning
a map and for key frames (Mur-Artal et al., TRO 2015). Deviations: points are followed by Lucas-Kanade, not matched; a turn
alone against an essential matrix takes the place of a homography; no loops, no relocalisation: a way that is lost goes on in
a new map, in whose unit the last speed is the same.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.frozen import freeze
from rhs.api.geometry import Camera, adjoint, inverse, orthonormal, se3
from rhs.api.records import Motion, Observation, Revision, Scan, Tracking
from rhs_odometry.tracks import tracks

from .config import MonocularVo
from .local_map import LocalMap, PoseFix, Seen
from .scale import UNKNOWN, Scale
from .two_views import first_pair, turn_of, turned

BACK_PX = 1.0  # a point followed back must come back this near
CELLS = 40  # corners lie at least an image width over this apart
SCALE_SHARE = {True: 0.05, False: 1.0}  # of the way by which it may be wrong, with its scale known or not
WIDE = np.diag([0.5**2] * 3 + [0.2**2] * 3)  # covariance of a motion that was not seen
BEAMS = 81  # of a scan, across the field of view, as the other odometries of one camera have them
LEVEL_RAD = 0.1  # a point belongs to the scan when it is seen this near to the camera's height
REACH = 3.0  # times the median distance: further points are hardly placed


@dataclass(frozen=True, eq=False)
class Anchor:
    """Where a view hangs: frame_from_camera (4x4, units) on a key frame of a map."""

    map: LocalMap
    frame: int
    frame_from_camera: np.ndarray

    def pose(self) -> np.ndarray:
        """map_from_camera as the map has it now."""
        return inverse(self.map.poses[self.frame]) @ self.frame_from_camera


class MonocularVoOdometry(Odometry):
    """See the module; one instance follows one camera."""

    def __init__(self, settings: MonocularVo, context: Context) -> None:
        self._settings, self._camera = settings, context.camera
        self._focal = float(np.sqrt(self._camera.fx * self._camera.fy))
        self._scale = Scale(self._camera.body_from_camera, settings.first_depth_m, settings.advanced.scale_frames)
        self._picture: np.ndarray | None = None
        self._ids, self._pixels, self._next = np.zeros(0, int), np.zeros((0, 2), np.float32), 0
        self._map: LocalMap | None = None
        self._waiting: list[tuple[int, Seen]] = []  # views since the reference, while there is no map
        self._at = np.eye(4)  # camera_from_map of the last view that was found
        self._speed = np.eye(4)  # now_from_previous of the camera, metres
        self._last_kept, self._lost = Seen(self._ids, np.zeros((0, 2))), 0
        self._kept_inliers = 0
        self._anchors: list[Anchor | None] = []
        self._motions: list[np.ndarray] = []  # previous_from_camera, metres, of every view
        self._metres: list[float] = []
        self._scans: list[Scan | None] = []

    @property
    def scale_from(self) -> str:  # type: ignore[override]  # known when it has been seen who tells
        return self._scale.source

    def update(self, observation: Observation) -> Motion:
        """Follow the points, find the camera, and make a key frame where it is time for one."""
        assert observation.image is not None
        picture = tracks.gray(observation.image)
        told = self._scale.hear(observation)
        self._anchors.append(None)
        self._metres.append(np.nan)
        self._scans.append(None)
        if self._picture is None:
            self._picture = picture
            self._begin()
            return self._said(np.eye(4), 1e-12 * np.eye(6), Tracking.OK, "first view")
        ids, pixels = self._follow(picture)
        seen = Seen(ids, self._rays(pixels))
        if self._map is None:
            return self._wait(picture, pixels, seen, told)
        fix = self._map.locate(seen, self._at)
        if fix is None:
            return self._lose(picture, len(ids), told)
        return self._found(picture, pixels, seen, fix)

    def revise(self) -> Revision | None:
        """The poses as the key frames lie in the end; views before a map began lie in it too."""
        known = [m for m in self._metres if np.isfinite(m)]
        if not known:
            return None
        metres, poses = known[0], [np.eye(4)]
        for k in range(1, len(self._motions)):
            metres = self._metres[k] if np.isfinite(self._metres[k]) else metres
            before, now, motion = self._anchors[k - 1], self._anchors[k], self._motions[k]
            if before is not None and now is not None and before.map is now.map:
                motion = scaled(inverse(before.pose()) @ now.pose(), metres)
            poses.append(orthonormal(poses[-1] @ motion))
        body = self._camera.body_from_camera
        return Revision(np.array([body @ pose @ inverse(body) for pose in poses]), tuple(self._scans))

    def _begin(self) -> None:
        """This view is the first of a new map."""
        self._map, self._waiting, self._lost = None, [], 0
        self._ids, self._pixels = np.zeros(0, int), np.zeros((0, 2), np.float32)
        self._top_up()
        self._last_kept = Seen(self._ids, self._rays(self._pixels))
        self._waiting.append((len(self._anchors) - 1, self._last_kept))
        self._scale.begin()

    def _wait(self, picture: np.ndarray, pixels: np.ndarray, seen: Seen, told: np.ndarray | None) -> Motion:
        """There is no map yet: begin it if this view and the first tell distances."""
        first = self._waiting[0][1]
        a = first.of(seen.ids)
        pair = first_pair(a, seen.rays, self._focal, self._settings)
        few = len(seen.ids) < 2 * self._settings.min_inliers
        before = self._waiting[-1][1]
        both = np.intersect1d(before.ids, seen.ids)
        turn = turn_of(before.of(both), seen.of(both)) if len(both) >= 3 else np.eye(3)
        self._picture, self._ids, self._pixels = picture, seen.ids, pixels
        if pair.reason:
            if few:
                self._begin()
            else:
                self._waiting.append((len(self._anchors) - 1, seen))
            status = Tracking.LOST if few else Tracking.DEGENERATE
            guess = self._from_told(told) if told is not None else se3(turn.T, np.zeros(3))
            return self._said(guess, WIDE, status, pair.reason)
        return self._start(Seen(seen.ids, a), seen, pair)

    def _start(self, first: Seen, seen: Seen, pair) -> Motion:
        """The map begins; the views in between are found in it."""
        began = self._waiting[0][0]
        self._map = made = LocalMap(first, seen, pair, focal=self._focal, settings=self._settings)
        way = float(np.linalg.norm(made.way_of_last()[:3, 3]))
        speed_m = float(np.linalg.norm(self._speed[:3, 3]))
        if self._scale.source == UNKNOWN and speed_m > 0.0:
            self._scale.metres = speed_m * (len(self._anchors) - 1 - began) / way
        self._scale.key_frame(way)
        self._anchors[began] = Anchor(made, 0, np.eye(4))
        guess = np.eye(4)
        for index, view in self._waiting[1:]:
            if (fix := made.locate(view, guess)) is not None:
                guess = fix.pose
                self._anchors[index] = Anchor(made, 0, inverse(fix.pose))
        self._top_up()
        self._keep(seen)
        self._at = made.poses[-1]
        self._hang(made, 1, self._at)
        so_far = np.eye(4)  # what was said of the way since the map's first view
        for motion in self._motions[began + 1:]:
            so_far = so_far @ motion
        motion = inverse(so_far) @ scaled(inverse(self._at), self._scale.metres)
        self._speed = np.eye(4)
        self._waiting = []
        return self._said(motion, WIDE, Tracking.DEGENERATE, "the map begins here")

    def _found(self, picture: np.ndarray, pixels: np.ndarray, seen: Seen, fix: PoseFix) -> Motion:
        assert self._map is not None
        known = self._map.known(seen)
        keep = ~known | fix.inliers  # what has a place and is seen elsewhere is followed no more
        seen = Seen(seen.ids[keep], seen.rays[keep])
        self._picture, self._ids, self._pixels, self._lost = picture, seen.ids, pixels[keep], 0
        relative = self._at @ inverse(fix.pose)
        self._at = fix.pose
        depth, count = self._map.depth(), int(fix.inliers.sum())
        self._hang(self._map, len(self._map.poses) - 1, fix.pose)
        if self._due(seen, count):
            self._top_up()
            self._map.add(Seen(self._ids, self._rays(self._pixels)), fix.pose)
            self._scale.key_frame(float(np.linalg.norm(self._map.way_of_last()[:3, 3])))
            self._keep(seen)
            self._at = self._map.poses[-1]
        motion = scaled(relative, self._scale.metres)
        self._speed = motion
        sigma = float(np.sqrt(np.linalg.eigvalsh(fix.covariance[:3, :3])[-1]))
        allowed = self._settings.max_sigma_share * depth
        weak = f"translation known to {sigma / depth:.3f} of the points' distance only" if sigma > allowed else ""
        status = Tracking.DEGENERATE if weak else Tracking.OK
        self._scans[-1] = scan = scan_of(self._map.ahead(seen, self._at), self._camera, self._scale.metres)
        return replace(self._said(motion, self._spread(fix.covariance, motion), status, weak, inliers=count), scan=scan)

    def _lose(self, picture: np.ndarray, followed: int, told: np.ndarray | None) -> Motion:
        """Not found: guess; the last view that was found is kept to go on from, for a while."""
        self._lost += 1
        guess, name = (self._speed, "the last motion") if told is None else (self._from_told(told), "what the wheels say")
        if self._lost > self._settings.advanced.give_up:
            self._picture = picture
            self._begin()
            name += "; a new map is begun"
        reason = f"too few of {followed} followed points agree, {self._settings.min_inliers} needed; took {name}"
        return self._said(guess, WIDE, Tracking.LOST, reason)

    def _hang(self, where: LocalMap, frame: int, camera_from_map: np.ndarray) -> None:
        self._anchors[-1] = Anchor(where, frame, where.poses[frame] @ inverse(camera_from_map))
        self._metres[-1] = self._scale.metres

    def _due(self, seen: Seen, inliers: int) -> bool:
        """Whether this view is to be a key frame."""
        advanced = self._settings.advanced
        if inliers < advanced.keep_share * self._kept_inliers:
            return True
        both = np.intersect1d(seen.ids, self._last_kept.ids)
        if len(both) < self._settings.min_inliers:
            return True
        a, b = self._last_kept.of(both), seen.of(both)
        off = self._focal * np.linalg.norm(turned(a, turn_of(a, b)) - b, axis=1)
        return bool(np.median(off) > advanced.keep_parallax_px * self._camera.width / 320)

    def _keep(self, seen: Seen) -> None:
        assert self._map is not None
        self._last_kept = Seen(self._ids, self._rays(self._pixels))
        self._kept_inliers = int(self._map.known(seen).sum())

    def _follow(self, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Ids and pixels of the points that are found in this picture, there and back."""
        assert self._picture is not None
        window = self._settings.window_px
        there, found = tracks.follow(self._picture, picture, self._pixels, self._pixels, window_px=window)
        back, again = tracks.follow(picture, self._picture, there, self._pixels, window_px=window)
        good = found & again & (np.linalg.norm(back - self._pixels, axis=1) < BACK_PX) if len(there) else found
        return self._ids[good], there[good]

    def _top_up(self) -> None:
        """New corners where no point is followed."""
        assert self._picture is not None
        spacing = max(4, self._camera.width // CELLS)
        new = tracks.corners(self._picture, self._pixels, count=self._settings.points - len(self._ids), spacing_px=spacing)
        self._ids = np.concatenate([self._ids, np.arange(self._next, self._next + len(new))])
        self._pixels = np.concatenate([self._pixels, new]).astype(np.float32)
        self._next += len(new)

    def _rays(self, pixels: np.ndarray) -> np.ndarray:
        return self._camera.rays(pixels.astype(float))[:, :2]

    def _from_told(self, body_motion: np.ndarray) -> np.ndarray:
        body = self._camera.body_from_camera
        return inverse(body) @ body_motion @ body

    def _spread(self, covariance: np.ndarray, motion: np.ndarray) -> np.ndarray:
        """Covariance of a motion of the camera, metres, from that of its pose in units: both its ends err."""
        size = np.diag([self._scale.metres] * 3 + [1.0] * 3)
        way = motion[:3, 3]
        out = 2.0 * size @ covariance @ size + 1e-10 * np.eye(6)
        out[:3, :3] += SCALE_SHARE[self._scale.known] ** 2 * np.outer(way, way)
        return out

    def _said(self, motion: np.ndarray, covariance: np.ndarray, status: Tracking, reason: str, *,
              inliers: int = 0) -> Motion:
        """The body's motion from the camera's."""
        self._motions.append(motion)
        body = self._camera.body_from_camera
        move = adjoint(body)
        spread = covariance if status is not Tracking.OK else move @ covariance @ move.T
        details = {"inliers": float(inliers), "tracks": float(len(self._ids)), "scale_known": float(self._scale.known)}
        return Motion(orthonormal(body @ motion @ inverse(body)), 0.5 * (spread + spread.T), status, reason, details=details)


def scaled(pose: np.ndarray, metres: float) -> np.ndarray:
    """The 4x4 pose with its translation in metres."""
    out = pose.copy()
    out[:3, 3] *= metres
    return out


def scan_of(points: np.ndarray, camera: Camera, unit_m: float) -> Scan:
    """Sparse: of points (N, 3) in the camera frame, in units of so many metres, in each bearing the nearest one at the
    camera's height; NaN where there is none."""
    aside = points @ camera.body_from_camera[:3, :3].T
    flat = np.hypot(aside[:, 0], aside[:, 1])
    level = (np.abs(np.arctan2(aside[:, 2], flat)) < LEVEL_RAD) & (flat > 1e-6)
    ends = camera.rays(np.array([[0.0, camera.cy], [camera.width - 1.0, camera.cy]])) @ camera.body_from_camera[:3, :3].T
    left, right = np.arctan2(ends[:, 1], ends[:, 0])
    bearings = np.linspace(right, left, BEAMS)
    beam = np.rint((np.arctan2(aside[:, 1], aside[:, 0]) - right) / (left - right) * (BEAMS - 1)).astype(int)
    use = level & (beam >= 0) & (beam < BEAMS)
    ranges = np.full(BEAMS, np.inf)
    np.minimum.at(ranges, beam[use], flat[use] * unit_m)
    reach_m = REACH * unit_m * float(np.median(points[:, 2])) if len(points) else unit_m
    ranges[~(ranges < reach_m)] = np.nan
    origin = camera.body_from_camera[:2, 3]
    return Scan(freeze(bearings), freeze(ranges), max(reach_m, 1e-3), (float(origin[0]), float(origin[1])))
