"""The local map: key frames, the points that were triangulated from them, and their refinement over a window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from rhs.api.geometry import inverse, se3, transform

from .bundle import Sightings, adjust, fit_pose, residuals
from .config import MonocularVo
from .two_views import TwoViews, parallax, triangulated


@dataclass(frozen=True, eq=False)
class Seen:
    """What a view sees: ids (N,) of followed points and their rays (N, 2)."""

    ids: np.ndarray
    rays: np.ndarray

    def of(self, ids: np.ndarray) -> np.ndarray:
        """(N, 2) rays of ids that are all seen."""
        at = np.argsort(self.ids)
        return self.rays[at[np.searchsorted(self.ids, ids, sorter=at)]]


@dataclass(frozen=True, eq=False)
class PoseFix:
    """camera_from_map (4x4), its covariance (6, 6; left perturbation), inliers (N,) bool over the points asked."""

    pose: np.ndarray
    covariance: np.ndarray
    inliers: np.ndarray


class LocalMap:
    """points: id -> (3,) in the frame of the first key frame, in units of their median distance there."""

    def __init__(self, first: Seen, second: Seen, pair: TwoViews, *, focal: float, settings: MonocularVo) -> None:
        """first, second: the same ids in the same order."""
        self._focal, self._settings = focal, settings
        self.poses = [np.eye(4), pair.b_from_a]  # camera_from_map of every key frame
        self._frames = [first, second]  # of the window alone: the last of them
        self.points = dict(zip(first.ids[pair.good].tolist(), pair.points[pair.good], strict=True))
        self._refine(fixed=1)

    def known(self, seen: Seen) -> np.ndarray:
        """(N,) bool: which of the seen points have a place."""
        return np.array([i in self.points for i in seen.ids.tolist()], bool)

    def ahead(self, seen: Seen, camera_from_map: np.ndarray) -> np.ndarray:
        """(N, 3) places of the seen points in the camera's frame."""
        at = np.array([self.points[i] for i in seen.ids[self.known(seen)].tolist()]).reshape(-1, 3)
        return transform(camera_from_map, at)

    def depth(self) -> float:
        """Median distance of the points that the last key frame sees."""
        ids = self._frames[-1].ids[self.known(self._frames[-1])]
        at = np.array([self.points[i] for i in ids.tolist()]).reshape(-1, 3)
        return float(np.median(at @ self.poses[-1][2, :3] + self.poses[-1][2, 3])) if len(at) else 1.0

    def locate(self, seen: Seen, guess: np.ndarray) -> PoseFix | None:
        """Where a view was taken (PnP with RANSAC, then robust least squares); None where too few points agree."""
        known = self.known(seen)
        points = np.array([self.points[i] for i in seen.ids[known].tolist()]).reshape(-1, 3)
        rays, settings = seen.rays[known], self._settings
        if len(points) < settings.min_inliers:
            return None
        gate = settings.advanced.gate_px
        pose = guess
        if np.median(np.linalg.norm(residuals(guess, points, rays, self._focal), axis=1)) > gate:
            found, turn, way, _ = cv2.solvePnPRansac(points, np.ascontiguousarray(rays, float), np.eye(3), None,
                                                     iterationsCount=200, reprojectionError=gate / self._focal)
            if not found:
                return None
            pose = se3(cv2.Rodrigues(turn)[0], way.ravel())
        inliers = np.ones(len(points), bool)
        information = np.eye(6)
        for _ in range(2):
            pose, information = fit_pose(pose, points[inliers], rays[inliers], focal=self._focal,
                                         huber_px=settings.advanced.huber_px)
            inliers = np.linalg.norm(residuals(pose, points, rays, self._focal), axis=1) < gate
            if inliers.sum() < settings.min_inliers:
                return None
        off = residuals(pose, points[inliers], rays[inliers], self._focal)
        variance = max(settings.pixel_sigma**2, float(np.mean(off**2)))
        whole = np.zeros(len(seen.ids), bool)
        whole[np.flatnonzero(known)[inliers]] = True
        return PoseFix(pose, variance * np.linalg.inv(information), whole)

    def add(self, seen: Seen, pose: np.ndarray) -> None:
        """A new key frame: what it shows under a wide enough angle becomes points, then the window is refined."""
        self.poses.append(pose)
        self._frames.append(seen)
        self._frames = self._frames[-self._settings.advanced.window:]
        self._grow()
        young = len(self.poses) == len(self._frames)  # the first pair is no better than the rest while all are at hand
        self._refine(fixed=1 if young else 2)

    def _grow(self) -> None:
        """Points of followed corners that have no place yet, from the oldest key frame of the window that saw them."""
        now, pose = self._frames[-1], self.poses[-1]
        left = now.ids[~self.known(now)]
        for frame, earlier in zip(self._frames[:-1], self.poses[-len(self._frames):-1], strict=True):
            ids = np.intersect1d(left, frame.ids)
            a, b = frame.of(ids), now.of(ids)
            at = triangulated(earlier, pose, a, b)
            with np.errstate(invalid="ignore"):
                good = parallax(earlier, pose, at) > np.radians(self._settings.advanced.new_parallax_deg)
                for view, rays in ((earlier, a), (pose, b)):
                    good &= np.linalg.norm(residuals(view, at, rays, self._focal), axis=1) < self._settings.advanced.gate_px
            self.points.update(zip(ids[good].tolist(), at[good], strict=True))
            left = np.setdiff1d(left, ids)  # those that did not fit wait for a wider angle

    def _refine(self, *, fixed: int) -> None:
        """Bundle adjustment of the window; its `fixed` oldest key frames stay."""
        ids, seen = self._sightings()
        twice = np.bincount(seen.row, minlength=len(ids)) > 1
        points = np.array([self.points[i] for i in ids.tolist()]).reshape(-1, 3)
        count = len(self._frames)
        poses = np.array(self.poses[-count:])
        ahead = np.einsum("nj,nj->n", poses[seen.of, 2, :3], points[seen.row]) + poses[seen.of, 2, 3] > 1e-3
        use = twice[seen.row] & ahead
        if use.sum() < 2 * self._settings.min_inliers:
            return
        used = replace(seen, of=seen.of[use], row=(np.cumsum(twice) - 1)[seen.row[use]], ray=seen.ray[use])
        poses, better = adjust(poses, points[twice], used, fixed=min(fixed, count - 1),
                               rounds=self._settings.advanced.rounds)
        self.poses[-count:] = list(poses)
        points[twice] = better
        self._keep(ids, points, poses, seen)

    def _sightings(self) -> tuple[np.ndarray, Sightings]:
        """Ids of the points that the window sees, and where."""
        known = [self.known(frame) for frame in self._frames]
        seen = [frame.ids[k] for frame, k in zip(self._frames, known, strict=True)]
        ids, row = np.unique(np.concatenate(seen), return_inverse=True)
        of = np.repeat(np.arange(len(seen)), [len(s) for s in seen])
        rays = np.concatenate([frame.rays[k] for frame, k in zip(self._frames, known, strict=True)])
        return ids, Sightings(of, row, rays, self._focal, self._settings.advanced.huber_px)

    def _keep(self, ids: np.ndarray, points: np.ndarray, poses: np.ndarray, seen: Sightings) -> None:
        """Take the refined points but for those that some key frame of the window sees elsewhere."""
        bad = np.zeros(len(ids), bool)
        for n, pose in enumerate(poses):
            mine = seen.of == n
            off = np.linalg.norm(residuals(pose, points[seen.row[mine]], seen.ray[mine], self._focal), axis=1)
            bad[seen.row[mine][~(off < self._settings.advanced.gate_px)]] = True
        held = set(np.concatenate([f.ids for f in self._frames]).tolist())
        self.points = {i: p for i, p in self.points.items() if i in held}
        for i, point, wrong in zip(ids.tolist(), points, bad, strict=True):
            if wrong:
                self.points.pop(i, None)
            else:
                self.points[i] = point

    def way_of_last(self) -> np.ndarray:
        """4x4: the last key frame's camera in that of the one before."""
        return self.poses[-2] @ inverse(self.poses[-1])
