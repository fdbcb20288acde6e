"""Odometry `keyframe`: follow the points of a small map, make key frames, find old ones again, keep a pose graph.

Per view (compare Klein and Murray, PTAM, ISMAR 2007; Kerl et al., DVO-SLAM, IROS 2013):
1. guess the motion from wheels, the command or the last motion;
2. look their patches up where the guess puts them, or follow them there, and fit the pose (tracker.py, patches.py,
   reprojection.py);
3. when too few fit, match ORB features with the last view and try again from there; else the view is lost;
4. sharpen the points that fit, forget the others;
5. when little of the last key frame is left, make a new one; look for old ones that are in view again, measure the
   new one against them, and let the pose graph settle (rhs.estimation.filters.pose_graph).
All of it is causal: a pose is reported once, with what was known then. revise() gives the settled ones.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterable

import numpy as np

from rhs.api.contracts import Context, Odometry
from rhs.api.geometry import adjoint, inverse, log_se3, log_so3, orthonormal
from rhs.api.records import Motion, Observation, Revision, Tracking
from rhs.estimation.filters.kalman import gate
from rhs.estimation.filters.settings import Effort
from rhs.estimation.views import features as vision

from ..features.floor import HELD, Floor, on_floor
from ..features.procrustes import weakness
from ..fused.fallback import guess_motion
from .culling import Edge
from .going_on import Adrift, GoingOn
from .keyframe_map import KeyframeMap
from .laying import Direct, Laid
from .relocation import Relocation, matched
from .reprojection import PoseFit
from .tracker import PreparedView, Tracker

FIRST = 1e-12 * np.eye(6)


class KeyframeOdometry(Odometry):
    """See the module. Poses inside are map_from_camera, the map being the first camera."""

    def __init__(self, settings, context: Context) -> None:
        import cv2

        cv2.setNumThreads(1)
        camera = context.camera
        self._settings, self._camera, self._rng = settings, camera, context.rng
        a = self._advanced = settings.advanced
        self._least = np.diag([a.least_edge_m] * 3 + [a.least_edge_rad] * 3) ** 2
        on_floor = settings.planar and camera.height_m > 0.0  # a hand-held camera stands on nothing
        self._floor = Floor(a.sway) if on_floor else None
        self._map = KeyframeMap(settings)
        self._effort = Effort(a.settle_rounds, a.floor_settled) if on_floor else Effort(a.settle_rounds)
        self._tracker = Tracker(settings, camera, self._map)
        self._disagrees = gate(6, a.wheels_probability)
        self._going_on = GoingOn(self._advanced.guess, camera)
        self._ahead = np.eye(4)  # from the camera's last pose to where it is thought to be, views having been skipped
        self._spread = FIRST  # covariance of the last pose
        self._reported = np.eye(4)  # the last pose as it was reported; the graph may have moved it since
        self._relocation = Relocation(a, camera, self._map)
        self._direct = Direct(settings, camera, self._map, on_floor=on_floor)
        self._adrift: Adrift | None = None  # since the camera lost its way, until it is found again in the map
        self._unseen = np.zeros((6, 6))  # by how much less sure than the last key frame the camera is, where no points tell
        self._full, self._fresh = 0, False  # points followed when the last key frame was made; no view came since
        self._hangs_on = array("l")  # per view: serial of its key frame,
        self._hangs = array("d")  # and the upper 12 numbers of keyframe_from_camera

    def update(self, observation: Observation) -> Motion:
        """Motion of the body since the previous observation."""
        look = self._tracker.ready(observation)
        if self._tracker.look is None:
            self._tracker.restart(look, np.eye(4))
            self._new_keyframe(look, [])
            return self._report(FIRST, Tracking.OK, "first view")
        name, body_motion, body_wide = guess_motion(observation, self._going_on.motion, self._advanced.guess)
        held = self._floor is None and name == "same again"
        guess, wide = self._tracker.pose @ self._ahead @ self._in_camera(body_motion), self._moved_to_camera(body_wide)
        since = self._going_on.since(body_wide) if held else wide
        before, followed = self._tracker.pose, (self._tracker.ids, self._tracker.pixels)
        fit = self._fit(look, guess, body_wide if name == "wheel" else None)
        if (held or (self._floor is not None and name == "wheel")) and self._direct.wanted(fit, len(followed[0])):
            fit, laid = self._laid(look, fit, guess, (since, wide) if held else (self._level(wide),), followed)
            if fit is None and laid is not None:
                return self._felt(look, laid)
        if fit is None:
            reason = f"{len(self._tracker.ids)} points found, {self._settings.min_inliers} needed; took {name}"
            if held and self._tracker.seeable(look) < 2 * self._settings.min_inliers and not weakness(since, self._settings):
                self._tracker.ids, self._tracker.pixels = followed
                return self._skipped(orthonormal(guess), since, reason)
            return self._lost(look, orthonormal(guess), wide, reason, name == "same again")
        self._tracker.accept(look, fit)
        if self._floor is not None:
            self._put_on_floor(self._floor, before, fit)
        followed_to = self._tracker.pose
        spread = fit.misfit * fit.covariance  # what is said of it; the graph weighs its edges by the noise told
        self._going_on.measured(inverse(before) @ followed_to, spread + self._spread)
        self._ahead = np.eye(4)
        if held and self._fresh:
            self._miss_no_noise(fit, len(followed[0]))
        self._fresh = False
        if self._wants_keyframe():
            self._new_keyframe(look, [self._measured(fit, len(self._map.poses) - 1, len(self._map.poses))])
        both, self._spread = spread + self._spread + self._corrected(followed_to), spread
        if self._unfound():
            return self._report(both, Tracking.LOST, "followed, but not found again in the map", fit)
        weak = weakness(spread, self._settings)
        return self._report(both, Tracking.DEGENERATE if weak else Tracking.OK, weak, fit)

    def _corrected(self, followed_to: np.ndarray) -> np.ndarray:
        """(6, 6) what a motion is less sure by because the map, settling, moved the camera from where it was followed to:
        the correction is of the past, not of this step, and a covariance without it would contradict the wheels."""
        shift = log_se3(inverse(followed_to) @ self._tracker.pose)
        return np.outer(shift, shift)

    def _unfound(self) -> bool:
        """Whether nobody knows where the camera is: it lost its way and had nothing to guess by. Patience ends one day."""
        if self._adrift is None:
            return False
        self._adrift.views += 1
        if self._adrift.views > self._advanced.relocate_views:
            self._adrift = None
        return self._adrift is not None and self._adrift.blind

    def revise(self) -> Revision | None:
        """Every view where its key frame finally stands; scans stay as they were."""
        if not self._hangs_on:
            return None
        b, relative = self._camera.body_from_camera, np.tile(np.eye(4), (len(self._hangs_on), 1, 1))
        relative[:, :3] = np.array(self._hangs).reshape(-1, 3, 4)
        poses = b @ self._map.stand(np.array(self._hangs_on)) @ relative @ inverse(b)
        return Revision(poses, None)

    def _fit(self, look: PreparedView, guess: np.ndarray, wide: np.ndarray | None) -> PoseFit | None:
        """The pose of the view, or None when nothing measures it. wide (6, 6): covariance of a guess by wheels, of the body;
        where points contradict it, somebody's who walks by were followed, and those that are where it puts them count."""
        ids, pixels = self._tracker.ids, self._tracker.pixels
        fit = self._tracker.follow(look, guess)
        if wide is not None and self._contradicts(fit, guess, wide):
            followed = self._tracker.ids, self._tracker.pixels
            self._tracker.ids, self._tracker.pixels = ids, pixels
            again = self._tracker.find(look, guess)
            if again.inliers.sum() >= self._settings.min_inliers and not self._contradicts(again, guess, wide):
                return again
            self._tracker.ids, self._tracker.pixels = followed
        if self._trusted(fit, len(ids)):
            return fit
        motion = self._rescue(look)
        if motion is not None:
            followed = self._tracker.ids, self._tracker.pixels
            self._tracker.ids, self._tracker.pixels = ids, pixels
            again = self._tracker.find(look, self._tracker.pose @ motion)
            if again.inliers.sum() >= fit.inliers.sum():
                fit = again
            else:
                self._tracker.ids, self._tracker.pixels = followed
        return fit if fit.inliers.sum() >= self._settings.min_inliers else None

    def _laid(self, look: PreparedView, fit: PoseFit | None, guess: np.ndarray, wides: tuple[np.ndarray, ...],
              followed: tuple[np.ndarray, np.ndarray]) -> tuple[PoseFit | None, Laid | None]:
        """What points and all pixels say together, and what the pixels say; without these the fit as it is."""
        laid = self._direct.lay(look, self._tracker, guess if fit is None else inverse(fit.camera_from_map), guess, wides)
        if laid is not None and self._floor is not None:
            off = log_se3(inverse(guess) @ laid.map_from_camera)
            laid = laid if off @ np.linalg.solve(wides[-1], off) < self._disagrees else None
        return (fit if laid is None else self._direct.joined(look, self._tracker, fit, laid, followed)), laid

    def _miss_no_noise(self, fit: PoseFit, followed: int) -> None:
        """Points of a key frame that the very next view does not find were noise: that they are gone makes no other one."""
        if self._direct.noise(fit, followed):
            self._full = max(len(self._tracker.ids), int(self._advanced.least_full * self._settings.points))

    def _felt(self, look: PreparedView, laid: Laid) -> Motion:
        """Go on by all pixels where there are no points to follow."""
        weak = weakness(laid.adding, self._settings)
        if self._adrift is not None:
            self._adrift.spread = self._adrift.spread + laid.adding
        elif weak:
            self._adrift = Adrift(self._map.made, laid.adding, blind=False)
        self._unseen = self._unseen + laid.adding
        pose = laid.map_from_camera
        if self._floor is not None and not self._floor.sways:
            pose = self._flat(pose, np.linalg.inv(laid.covariance))
        self._begin_again(look, pose, laid.adding, self._unseen)
        self._going_on.felt()
        self._ahead = np.eye(4)
        if self._unfound():
            return self._report(laid.adding, Tracking.LOST, "followed, but not found again in the map")
        return self._report(laid.adding, Tracking.DEGENERATE if weak else Tracking.OK, weak or "by all pixels")

    def _begin_again(self, look: PreparedView, pose: np.ndarray, spread: np.ndarray, since: np.ndarray) -> None:
        """A new key frame as soon as there is something to follow. spread, since (6, 6): of the motion from the last view
        and from the last key frame."""
        self._tracker.restart(look, pose)
        self._spread = spread
        if self._tracker.seeable(look) >= self._settings.min_inliers:
            k = len(self._map.poses)
            self._new_keyframe(look, [Edge(k - 1, k, inverse(self._map.poses[-1]) @ pose, since)])

    def _contradicts(self, fit: PoseFit, guess: np.ndarray, wide: np.ndarray) -> bool:
        """Whether the fit is further from the wheels' guess than these err."""
        off = log_se3(inverse(guess) @ inverse(fit.camera_from_map))
        squared = off @ np.linalg.solve(self._moved_to_camera(wide) + fit.covariance, off)
        return bool(squared > self._disagrees)

    def _trusted(self, fit: PoseFit, followed: int) -> bool:
        enough = max(2 * self._settings.min_inliers, self._advanced.trusted_share * followed)
        return bool(fit.inliers.sum() >= enough)

    def _rescue(self, look: PreparedView) -> np.ndarray | None:
        """previous_from_camera by matching ORB features with depth, however far the camera moved."""
        assert self._tracker.look is not None
        now, then = (vision.orb_features(view.observation, self._advanced.rescue_features)
                     for view in (look, self._tracker.look))
        found = matched(now, then, self._advanced, float(self._camera.fx), self._rng)
        return found.a_from_b if found is not None and found.count >= self._settings.min_inliers else None

    def _wants_keyframe(self) -> bool:
        """Whether little of the last key frame is left; a camera on a floor makes do with less."""
        s, tracker, a = self._settings, self._tracker, self._advanced
        moved = inverse(self._map.poses[-1]) @ tracker.pose
        stretch = a.floor_stretch if self._floor is not None else 1.0
        least = min(s.keep_share * self._full, max(s.keep_share / stretch * self._full, a.floor_points))
        return bool(
            len(tracker.ids) < least
            or np.linalg.norm(log_so3(moved[:3, :3])) > np.radians(s.keep_turn_deg) * stretch
            or np.linalg.norm(moved[:3, 3]) > s.keep_move_m * stretch
            or (self._adrift is not None and self._adrift.views % a.relocate_every == 0)
        )

    def _new_keyframe(self, look: PreparedView, edges: list[Edge]) -> None:
        """Make this view a key frame tied by edges and by old key frames seen again; settle; top up the points."""
        tracker, self._unseen = self._tracker, np.zeros((6, 6))
        k = self._map.add_keyframe(tracker.pose, look.picture)
        self._relocation.note(k, look.depth)
        self._map.edges += edges
        if self._adrift is None:
            loops = self._revisit(look, k)
        else:
            loops = self._find_again(look, k, self._adrift)
        if loops:
            self._map.edges += loops
            self._map.settle(self._effort)
            tracker.pose = self._map.poses[k]
        tracker.top_up(look, k)
        self._full, self._fresh = len(tracker.ids), True
        stays, tracker.ids = self._map.cull(tracker.ids)
        tracker.pixels = tracker.pixels[stays]

    def _find_again(self, look: PreparedView, k: int, adrift: Adrift) -> list[Edge]:
        """Edges from key frames of before the way was lost; all that was seen since then is put where they say."""
        tracker, known = self._tracker, int(np.searchsorted(self._map.serials, adrift.since))
        followed, here = (tracker.ids, tracker.pixels), tracker.pose
        poses = [here]
        if known > 0:
            poses += self._relocation.candidates(look.observation, here, known, self._rng)
        for pose in poses:
            tracker.pose = pose
            edges = self._revisit(look, k, range(known, k))
            if edges and (adrift.blind or self._reachable(here, edges[0], adrift)):
                there = self._map.poses[edges[0].a] @ edges[0].a_from_b
                self._map.poses[known:] = orthonormal(there @ inverse(here)) @ self._map.poses[known:]
                self._adrift = None
                return edges
            tracker.ids, tracker.pixels = followed
        tracker.pose = here
        return []

    def _reachable(self, here: np.ndarray, edge: Edge, adrift: Adrift) -> bool:
        """Whether the wheels, or the command, can have erred by what the edge would move the view."""
        gap = log_se3(inverse(here) @ self._map.poses[edge.a] @ edge.a_from_b)
        squared = gap @ np.linalg.solve(adrift.spread + edge.covariance, gap)
        return bool(squared < gate(6, self._advanced.relocate_probability))

    def _edge(self, fit: PoseFit, a: int, k: int, *, loop: bool = False) -> list[Edge]:
        """The edge, unless few points or a vague pose make it: what is nearly unknown cannot be linearised."""
        few = fit.inliers.sum() < self._advanced.min_edge or fit.inliers.mean() < self._advanced.edge_share
        return [] if few or weakness(fit.covariance, self._settings) else [self._measured(fit, int(a), k, loop=loop)]

    def _measured(self, fit: PoseFit, a: int, k: int, *, loop: bool = False) -> Edge:
        """The edge that a fit measures, on the floor when the camera stands on a robot."""
        a_from_k = inverse(self._map.poses[a]) @ inverse(fit.camera_from_map)
        covariance = self._advanced.correlated * fit.covariance + self._least
        if self._floor is not None and not self._floor.sways:
            b = self._camera.body_from_camera
            there, back = adjoint(b), adjoint(inverse(b))
            information = np.linalg.inv(there @ covariance @ there.T)
            flat, spread = on_floor(b @ a_from_k @ inverse(b), information)
            a_from_k, covariance = inverse(b) @ flat @ b, back @ spread @ back.T
        return Edge(a, k, a_from_k, 0.5 * (covariance + covariance.T), loop)

    def _revisit(self, look: PreparedView, k: int, without: Iterable[int] = ()) -> list[Edge]:
        """Look for old key frames that should be in view again; their points are followed from now on."""
        tracker, edges, least = self._tracker, [], self._advanced.min_edge
        anchors, counts = np.unique(self._map.anchor[tracker.ids], return_counts=True)
        followed = {int(a) for a in anchors[counts >= least]}
        candidates = self._map.overlap(tracker.pose, look, self._camera, exclude=followed | {k} | set(without))
        chosen = candidates[: self._settings.revisit]
        if self._floor is None and self._adrift is None:  # a hand comes back to places that its last key frames hide
            old = self._map.left_behind(k, self._advanced.left_m)
            chosen += [(a, ids) for a, ids in candidates if old[a]][: self._settings.revisit]
        for a, ids in dict(chosen).items():
            if len(ids) < 2 * least:
                continue
            edge = self._seen_again(look, k, a, ids, tracker.pose)
            if not edge and self._floor is None and self._adrift is None:
                edge = self._recognised(look, k, a)
            edges += edge
        return edges

    def _seen_again(self, look: PreparedView, k: int, a: int, ids: np.ndarray, pose: np.ndarray) -> list[Edge]:
        """The edge to key frame a by its points ids, looked up from a pose of this view; what fits is followed now."""
        tracker = self._tracker
        ids, pixels = tracker.seek(look, ids, pose)
        fit = tracker.fit(look, ids, pixels, inverse(pose))
        edge = self._edge(fit, a, k, loop=True)
        if edge:
            tracker.add(ids[fit.inliers], pixels[fit.inliers])
        return edge

    def _recognised(self, look: PreparedView, k: int, a: int) -> list[Edge]:
        """The same where a hand has drifted further than patches are looked for: key-points say where to look."""
        pose = self._relocation.by(look.observation, a, self._rng)
        if pose is None:
            return []
        ids = np.flatnonzero(self._map.anchor == a)
        ids = ids[self._map.visible(ids, inverse(pose), look, self._camera)]
        return self._seen_again(look, k, a, ids, pose) if len(ids) >= 2 * self._advanced.min_edge else []

    def _skipped(self, pose: np.ndarray, since: np.ndarray, reason: str) -> Motion:
        """Nothing measured, but it cannot have gone far: go on as before, and try the next view from the last good one.
        since (6, 6): covariance of the pose against the camera's last one."""
        self._ahead = inverse(self._tracker.pose) @ pose
        self._going_on.views += 1
        both, self._spread = since + self._spread, since
        self._unfound()
        return self._report(both, Tracking.LOST, reason, pose=pose)

    def _lost(self, look: PreparedView, pose: np.ndarray, spread: np.ndarray, reason: str, blind: bool) -> Motion:
        """Nothing measured: go on by the guess, and begin again from a new key frame as soon as there is something."""
        self._ahead = np.eye(4)
        self._going_on.forget()
        if self._adrift is None:
            self._adrift = Adrift(self._map.made, np.zeros((6, 6)), blind)
        self._adrift.spread = self._adrift.spread + spread
        self._adrift.blind |= blind
        self._adrift.views += 1
        self._begin_again(look, pose, spread, self._adrift.spread)
        return self._report(spread + self._corrected(pose), Tracking.LOST, reason)

    def _put_on_floor(self, floor: Floor, before: np.ndarray, fit: PoseFit) -> None:
        """A robot neither climbs nor tilts, unless it sways: take the planar pose nearest to the fitted one."""
        b = self._camera.body_from_camera
        there = adjoint(b)
        spread = there @ (fit.covariance + self._spread) @ there.T
        floor.note(b @ inverse(before) @ self._tracker.pose @ inverse(b), spread)
        if not floor.sways:
            self._tracker.pose = self._flat(self._tracker.pose, fit.information + 1e-3 * np.eye(6))

    def _flat(self, pose: np.ndarray, information: np.ndarray) -> np.ndarray:
        """The planar pose of the camera nearest to one (4, 4) with this information (6, 6)."""
        b = self._camera.body_from_camera
        flat, _ = on_floor(b @ pose @ inverse(b), adjoint(inverse(b)).T @ information @ adjoint(inverse(b)))
        return inverse(b) @ flat @ b

    def _level(self, wide: np.ndarray) -> np.ndarray:
        """The covariance (6, 6) of a guess of the camera's motion that is kept to the floor, unless it sways."""
        if self._floor is None or self._floor.sways:
            return wide
        move = adjoint(self._camera.body_from_camera)
        return np.asarray(np.linalg.inv(np.linalg.inv(wide) + move.T @ HELD @ move))

    def _in_camera(self, body_motion: np.ndarray) -> np.ndarray:
        b = self._camera.body_from_camera
        return inverse(b) @ body_motion @ b

    def _moved_to_camera(self, spread: np.ndarray) -> np.ndarray:
        """A covariance (6, 6) of the body's motion as one of the camera's."""
        move = adjoint(inverse(self._camera.body_from_camera))
        return move @ spread @ move.T

    def _report(self, covariance, status: Tracking, reason: str, fit=None, pose: np.ndarray | None = None) -> Motion:
        """The motion of the body since the pose reported last, and remember where this view hangs in the graph."""
        b, pose = self._camera.body_from_camera, self._tracker.pose if pose is None else pose
        motion = orthonormal(b @ inverse(self._reported) @ pose @ inverse(b))
        self._reported = pose
        k = len(self._map.poses) - 1
        self._hangs_on.append(int(self._map.serials[k]))
        self._hangs.extend((inverse(self._map.poses[k]) @ pose)[:3].ravel())
        move = adjoint(b)
        spread = move @ covariance @ move.T
        spread = 0.5 * (spread + spread.T) + FIRST
        details = {"keyframes": float(self._map.made), "held": float(k + 1), "followed": float(len(self._tracker.ids))}
        if fit is not None:
            details |= {"inliers": float(fit.inliers.sum()), "residual_px": fit.pixel_rms}
        sure = np.sqrt(np.diag(np.linalg.inv(spread)))
        return Motion(motion, spread, status, reason, sure, details=details)
