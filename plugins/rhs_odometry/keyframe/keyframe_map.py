"""The map of the odometry `keyframe`: key frames, the points they anchor, and the edges between them.

A point is kept as its anchor camera saw it, a ray and an inverse depth, so it moves along when the pose graph moves
its key frame. Sightings from elsewhere sharpen the inverse depth (Civera et al., TRO 2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import inverse
from rhs.estimation.filters import pose_graph as posegraph
from rhs.estimation.filters.settings import Effort

from .config import KeyframeAdvanced
from .reprojection import Sightings, at_middle
from .surface import warps

USUAL = KeyframeAdvanced()


@dataclass(frozen=True, eq=False)
class Edge:
    """Key frame b seen from key frame a: a_from_b (4x4) with the covariance (6x6) of its right perturbation.
    loop: a was found again, not followed, so the edge may be wrong."""

    a: int
    b: int
    a_from_b: np.ndarray
    covariance: np.ndarray
    loop: bool = False


class KeyframeMap:
    """Grows by key frames; ids of points are row numbers that never change."""

    def __init__(self, inverse_depth_sigma: float, advanced: KeyframeAdvanced = USUAL) -> None:
        self._sigma, self._advanced = inverse_depth_sigma, advanced
        self.poses = np.zeros((0, 4, 4))  # map_from_camera of each key frame
        self.pictures: list[list[np.ndarray]] = []  # their gray image pyramids; of the oldest nothing
        self.edges: list[Edge] = []
        self.anchor = np.zeros(0, int)  # key frame of each point
        self.pixels = np.zeros((0, 2), np.float32)  # where its key frame saw it
        self.rays = np.zeros((0, 3))  # x/z, y/z, 1 in the anchor camera
        self.rho = np.zeros(0)
        self.sigma = np.zeros(0)
        self.slopes = np.zeros((0, 2))  # of inverse depth around the point, 1/m per pixel of its key frame

    def add_keyframe(self, map_from_camera: np.ndarray, picture: list[np.ndarray]) -> int:
        self.poses = np.concatenate([self.poses, map_from_camera[None]])
        self.pictures.append(picture)
        kept = self._advanced.pictures
        if len(self.pictures) > kept:
            self.pictures[-kept - 1] = []  # its points cannot be found any more
        return len(self.poses) - 1

    def add_points(self, keyframe: int, pixels: np.ndarray, points: np.ndarray, slopes: np.ndarray) -> np.ndarray:
        """Anchor new points, (N, 3) in its camera on surfaces of inverse depth slopes (N, 2), to a key frame; their ids."""
        first = len(self.anchor)
        self.anchor = np.concatenate([self.anchor, np.full(len(pixels), keyframe)])
        self.pixels = np.concatenate([self.pixels, np.asarray(pixels, np.float32)])
        self.rays = np.concatenate([self.rays, points / points[:, 2:]])
        self.rho = np.concatenate([self.rho, 1.0 / points[:, 2]])
        self.sigma = np.concatenate([self.sigma, np.full(len(pixels), self._sigma)])
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

    def warps(self, ids: np.ndarray, camera_from_map: np.ndarray, camera) -> np.ndarray:
        """(N, 2, 2) d pixel in the anchor / d pixel in a camera, the surface taken to be flat around the point."""
        poses = camera_from_map @ self.poses[self.anchor[ids]]
        return warps(self.pixels[ids], self.rho[ids], self.slopes[ids], now_from_then=poses, camera=camera)

    def sightings(self, ids: np.ndarray, rays: np.ndarray, depth_m: np.ndarray, rows: np.ndarray) -> Sightings:
        """What an image that sees points `ids` along rays (N, 3) at depths (N,) on rows (N,) says."""
        centres = self.poses[self.anchor[ids], :3, 3]
        return Sightings(self.points(ids), centres, self.rho[ids], self.sigma[ids], rays[:, :2], 1.0 / depth_m, rows)

    def sharpen(self, ids: np.ndarray, camera_from_map: np.ndarray, seen: np.ndarray) -> None:
        """Fuse points seen (N, 3) in a camera of known pose into the inverse depths kept; NaN where depth is unknown."""
        known = np.isfinite(seen).all(axis=1)
        ids, seen = ids[known], seen[known]
        in_map = (seen - camera_from_map[:3, 3]) @ camera_from_map[:3, :3]
        poses = self.poses[self.anchor[ids]]
        z = np.einsum("ni,ni->n", in_map - poses[:, :3, 3], poses[:, :3, 2])
        good = z > 0.1
        ids, rho = ids[good], 1.0 / z[good]
        prior, reading = self.sigma[ids] ** -2, self._sigma**-2
        self.rho[ids] = (prior * self.rho[ids] + reading * rho) / (prior + reading)
        self.sigma[ids] = np.maximum((prior + reading) ** -0.5, self._advanced.sharpest * self._sigma)

    def tie(self, edges: list[Edge]) -> None:
        """Take up measured relative poses."""
        self.edges.extend(edges)

    def settle(self) -> None:
        """Let the pose graph settle; the first key frame stays."""
        e = self.edges
        edges = posegraph.Edges(
            np.array([x.a for x in e]), np.array([x.b for x in e]), np.array([x.a_from_b for x in e]),
            np.array([x.covariance for x in e]), np.array([x.loop for x in e]),
        )
        self.poses = posegraph.optimise(self.poses, edges, effort=Effort(self._advanced.settle_rounds)).poses

    def overlap(self, map_from_camera: np.ndarray, look, camera, *, exclude: set[int]) -> list[tuple[int, np.ndarray]]:
        """Key frames whose points should be in view, most first: (key frame, ids of those points).

        A point is in view when it projects into the image and the depth there is about its own (nothing before it).
        """
        blind = range(max(len(self.pictures) - self._advanced.pictures, 0))
        allowed = ~np.isin(self.anchor, [*exclude, *blind])
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
        local = self.points(ids) @ camera_from_map[:3, :3].T + camera_from_map[:3, 3]
        pixels = camera.project(local)
        depth = look.depth_at(pixels)
        with np.errstate(invalid="ignore", divide="ignore"):
            inside = (pixels[:, 0] > 8) & (pixels[:, 1] > 8)
            inside &= (pixels[:, 0] < camera.width - 8) & (pixels[:, 1] < camera.height - 8)
            agrees = ~(np.abs(1.0 / local[:, 2] - 1.0 / depth) > self._advanced.visible_per_m)
        return inside & agrees & (local[:, 2] > 0.1)
