"""The map of the odometry `keyframe`: key frames, the points they anchor, and the edges between them.

A point is kept as its anchor camera saw it, a ray and an inverse depth, so it moves along when the pose graph moves
its key frame. Sightings from elsewhere sharpen the inverse depth (Civera et al., TRO 2008).
"""

from __future__ import annotations

from collections import OrderedDict

import cv2
import numpy as np

from rhs.api.geometry import inverse
from rhs.estimation.filters import pose_graph as posegraph
from rhs.estimation.filters.settings import Effort
from rhs_odometry.tracks import tracks

from .config import Keyframe
from .culling import Edge, spare, without
from .reprojection import Sightings, at_middle
from .surface import placed, rays_beside, warps

PACKING = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
           cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_PAETH]


class Pictures:
    """Gray image pyramids of key frames by number. budget_mb: of those that lie ready; what was used longest ago is packed
    without loss (PNG), to 0.13 MB at 640x480, and unpacked (3 ms there) when it is wanted again."""

    def __init__(self, budget_mb: float) -> None:
        self._budget = budget_mb * 1e6
        self._ready: OrderedDict[int, list[np.ndarray]] = OrderedDict()
        self._packed: dict[int, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._packed.keys() | self._ready.keys())

    def add(self, number: int, pyramid: list[np.ndarray]) -> None:
        self._ready[number] = pyramid
        most = int(self._budget / max(sum(level.nbytes for level in pyramid), 1))
        while len(self._ready) > max(most, 1):
            oldest, given = self._ready.popitem(last=False)
            if oldest not in self._packed:
                self._packed[oldest] = cv2.imencode(".png", given[0], PACKING)[1]

    def get(self, number: int) -> list[np.ndarray]:
        if number in self._ready:
            self._ready.move_to_end(number)
        else:
            self.add(number, tracks.pyramid(np.asarray(cv2.imdecode(self._packed[number], cv2.IMREAD_GRAYSCALE))))
        return self._ready[number]

    def drop(self, number: int) -> None:
        self._ready.pop(number, None)
        self._packed.pop(number, None)


class KeyframeMap:
    """Grows by key frames up to `held`, then gives one up for each new one (culling.py). Key frames and points go by their
    row; `serials` are the numbers of key frames that never change."""

    def __init__(self, settings: Keyframe | None = None) -> None:
        settings = settings or Keyframe()
        self._sigma, self._advanced = settings.inverse_depth_sigma, settings.advanced
        self._spacing = settings.keep_move_m, float(np.radians(settings.keep_turn_deg))
        self.poses = np.zeros((0, 4, 4))  # map_from_camera of each key frame
        self.serials = np.zeros(0, int)
        self.pictures = Pictures(self._advanced.picture_mb)  # by serial
        self.edges: list[Edge] = []
        self._hung: dict[int, tuple[int, np.ndarray]] = {}  # of those given up: serial of the host, host_from_keyframe
        self.anchor = np.zeros(0, int)  # key frame of each point
        self.pixels = np.zeros((0, 2), np.float32)  # where its key frame saw it
        self._beside = np.zeros((0, 4, 3))  # rays beside it there; NaN until they are asked for
        self.rays = np.zeros((0, 3))  # x/z, y/z, 1 in the anchor camera
        self.rho = np.zeros(0)
        self.sigma = np.zeros(0)
        self.slopes = np.zeros((0, 2))  # of inverse depth around the point, 1/m per pixel of its key frame

    @property
    def made(self) -> int:
        """How many key frames there have been, those given up included."""
        return len(self.serials) + len(self._hung)

    def picture(self, keyframe: int) -> list[np.ndarray]:
        """The image pyramid of a key frame."""
        return self.pictures.get(int(self.serials[keyframe]))

    def add_keyframe(self, map_from_camera: np.ndarray, picture: list[np.ndarray]) -> int:
        serial = self.made
        self.poses = np.concatenate([self.poses, map_from_camera[None]])
        self.serials = np.append(self.serials, serial)
        self.pictures.add(serial, picture)
        return len(self.poses) - 1

    def cull(self, followed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Give up key frames, and the points they anchor, until no more than `held` are left; never the first or the last,
        and one of a followed point only when there is no other. followed: their ids (N,). Returns which of these stay
        (N,) bool, and the ids of those that do as they are numbered afterwards."""
        stays = np.ones(len(followed), bool)
        while len(self.poses) > self._advanced.held:
            ends = np.isin(np.arange(len(self.poses)), [0, len(self.poses) - 1])
            needed = ends | np.isin(np.arange(len(self.poses)), self.anchor[followed[stays]])
            k = spare(self.poses, ends if needed.all() else needed, self._spacing)
            stays &= self.anchor[followed] != k
            followed = self._give_up(k)[followed]
        return stays, followed[stays]

    def _give_up(self, k: int) -> np.ndarray:
        """Forget a key frame and its points; returns the new number of each point."""
        serial = int(self.serials[k])
        host, host_from_k, self.edges = without(self.edges, k, self.poses)
        self._hung[serial] = int(self.serials[host]), host_from_k
        self.pictures.drop(serial)
        self.poses, self.serials = np.delete(self.poses, k, axis=0), np.delete(self.serials, k)
        stay = self.anchor != k
        rows = np.flatnonzero(stay)
        self.anchor = self.anchor[rows] - (self.anchor[rows] > k)
        for name in ("pixels", "_beside", "rays", "rho", "sigma", "slopes"):
            setattr(self, name, np.take(getattr(self, name), rows, axis=0))
        return np.maximum(np.cumsum(stay) - 1, 0)

    def stand(self, serials: np.ndarray) -> np.ndarray:
        """(N, 4, 4) where the key frames of serials (N,) stand now, those given up included."""
        known = dict(zip(self.serials.tolist(), self.poses, strict=True))
        for serial in np.unique(serials).tolist():
            chain = []
            while serial not in known:
                chain.append(serial)
                serial = self._hung[serial][0]
            for hung in reversed(chain):
                host, host_from_k = self._hung[hung]
                known[hung] = known[host] @ host_from_k
        return np.array([known[serial] for serial in serials.tolist()]).reshape(-1, 4, 4)

    def add_points(self, keyframe: int, pixels: np.ndarray, points: np.ndarray, slopes: np.ndarray,
                   depth_times: float = 1.0) -> np.ndarray:
        """Anchor new points, (N, 3) in its camera on surfaces of inverse depth slopes (N, 2), to a key frame; their ids.
        depth_times: noise of their depths, times what the settings say."""
        first = len(self.anchor)
        self.anchor = np.concatenate([self.anchor, np.full(len(pixels), keyframe)])
        self.pixels = np.concatenate([self.pixels, np.asarray(pixels, np.float32)])
        self._beside = np.concatenate([self._beside, np.full((len(pixels), 4, 3), np.nan)])
        self.rays = np.concatenate([self.rays, points / points[:, 2:]])
        self.rho = np.concatenate([self.rho, 1.0 / points[:, 2]])
        self.sigma = np.concatenate([self.sigma, np.full(len(pixels), depth_times * self._sigma)])
        self.slopes = np.concatenate([self.slopes, slopes])
        return np.arange(first, len(self.anchor))

    def reshape(self, keyframe: int, camera, twist: np.ndarray) -> None:
        """Carry the points of a key frame to its middle row by a shutter twist (6,) learnt after they were anchored."""
        ids = np.flatnonzero(self.anchor == keyframe)
        rows = (self.pixels[ids, 1] + 0.5) / camera.height - 0.5
        moved = at_middle(self.rays[ids] / self.rho[ids, None], rows, twist)
        self.rays[ids], self.rho[ids] = moved / moved[:, 2:], 1.0 / moved[:, 2]

    def points(self, ids: np.ndarray) -> np.ndarray:
        """(N, 3) positions in the map."""
        local = self.rays[ids] / self.rho[ids, None]
        poses = self.poses[self.anchor[ids]]
        return np.einsum("nij,nj->ni", poses[:, :3, :3], local) + poses[:, :3, 3]

    def seen_from(self, ids: np.ndarray, camera_from_map: np.ndarray) -> np.ndarray:
        """(N, 3) positions in a camera."""
        return placed(self.rays, self.rho, self.anchor, ids, camera_from_map @ self.poses)

    def warps(self, ids: np.ndarray, camera_from_map: np.ndarray, camera) -> np.ndarray:
        """(N, 2, 2) d pixel in the anchor / d pixel in a camera, the surface taken to be flat around the point."""
        poses = camera_from_map @ self.poses[self.anchor[ids]]
        fresh = ids[np.isnan(self._beside[ids, 0, 2])]
        self._beside[fresh] = rays_beside(self.pixels[fresh], camera)
        return warps(self._beside[ids], self.rho[ids], self.slopes[ids], now_from_then=poses, camera=camera)

    def sightings(self, ids: np.ndarray, rays: np.ndarray, depth_m: np.ndarray, rows: np.ndarray) -> Sightings:
        """What an image that sees points `ids` along rays (N, 3) at depths (N,) on rows (N,) says."""
        centres = self.poses[self.anchor[ids], :3, 3]
        return Sightings(self.points(ids), centres, self.rho[ids], self.sigma[ids], rays[:, :2], 1.0 / depth_m, rows)

    def sharpen(self, ids: np.ndarray, camera_from_map: np.ndarray, seen: np.ndarray, depth_times: float = 1.0) -> None:
        """Fuse points seen (N, 3) in a camera of known pose into the inverse depths kept; NaN where depth is unknown.
        depth_times: noise of these depths, times what the settings say."""
        known = np.isfinite(seen).all(axis=1)
        ids, seen = ids[known], seen[known]
        in_map = (seen - camera_from_map[:3, 3]) @ camera_from_map[:3, :3]
        poses = self.poses[self.anchor[ids]]
        z = np.einsum("ni,ni->n", in_map - poses[:, :3, 3], poses[:, :3, 2])
        good = z > 0.1
        ids, rho = ids[good], 1.0 / z[good]
        prior, reading = self.sigma[ids] ** -2, (depth_times * self._sigma) ** -2
        self.rho[ids] = (prior * self.rho[ids] + reading * rho) / (prior + reading)
        self.sigma[ids] = np.maximum((prior + reading) ** -0.5, self._advanced.sharpest * depth_times * self._sigma)

    def settle(self, effort: Effort) -> None:
        """Let the pose graph settle; the first key frame stays."""
        e = self.edges
        edges = posegraph.Edges(
            np.array([x.a for x in e]), np.array([x.b for x in e]), np.array([x.a_from_b for x in e]),
            np.array([x.covariance for x in e]), np.array([x.loop for x in e]),
        )
        self.poses = posegraph.optimise(self.poses, edges, effort=effort).poses

    def left_behind(self, k: int, left_m: float) -> np.ndarray:
        """(K,) bool: key frames from which the way to k is longer than this; a radian of turning counts as a metre."""
        step = np.linalg.norm(np.diff(self.poses[: k + 1, :3, 3], axis=0), axis=1)
        trace = np.einsum("nab,nab->n", self.poses[:k, :3, :3], self.poses[1 : k + 1, :3, :3])
        step += np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))
        way = np.concatenate([[0.0], np.cumsum(step)])
        out = np.zeros(len(self.poses), bool)
        out[: k + 1] = way[-1] - way > left_m
        return out

    def overlap(self, map_from_camera: np.ndarray, look, camera, *, exclude: set[int]) -> list[tuple[int, np.ndarray]]:
        """Key frames whose points should be in view, most first: (key frame, ids of those points).

        A point is in view when it projects into the image and the depth there is about its own (nothing before it).
        """
        allowed = ~np.isin(self.anchor, list(exclude))
        ids = np.flatnonzero(allowed)
        if len(ids) == 0:
            return []
        seen = self.visible(ids, inverse(map_from_camera), look, camera)
        ids = ids[seen]
        counts = np.bincount(self.anchor[ids], minlength=len(self.poses))
        order = np.argsort(-counts, kind="stable")
        return [(int(k), ids[self.anchor[ids] == k]) for k in order if counts[k] > 0]

    def visible(self, ids: np.ndarray, camera_from_map: np.ndarray, look, camera) -> np.ndarray:
        """(N,) bool: projects into the image, at about the depth measured there (or where none is)."""
        local = self.seen_from(ids, camera_from_map)
        pixels = camera.project(local)
        with np.errstate(invalid="ignore"):
            inside = (pixels[:, 0] > 8) & (pixels[:, 1] > 8) & (local[:, 2] > 0.1)
            inside &= (pixels[:, 0] < camera.width - 8) & (pixels[:, 1] < camera.height - 8)
        rows = np.flatnonzero(inside)
        apart = np.abs(1.0 / local[rows, 2] - 1.0 / look.depth_at(pixels[rows]))
        inside[rows[apart > self._advanced.visible_per_m]] = False
        return inside
