"""The laser scanner of a simulated robot: faces of the scene cut by the plane of its beams, and each beam's nearest cut."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.records import Scan

LEAST_M = 1e-9  # nothing is nearer to the middle of the scanner


class LaserScanner:
    """Beams evenly over `fov_rad`, ahead in their middle, `height_m` above the floor under the robot's middle, level as the
    robot is. Ideal: what noise there is, the sensor puts on."""

    def __init__(self, beams: int, fov_rad: float, height_m: float, range_m: float) -> None:
        around = fov_rad > 2.0 * np.pi - 1e-9  # the last beam would be the first one
        self.bearings_rad = np.linspace(-0.5 * fov_rad, 0.5 * fov_rad, beams, endpoint=not around)
        self.height_m, self.range_m = height_m, range_m
        self.bearings_rad.flags.writeable = False

    def scan(self, vertices_m: np.ndarray, faces: np.ndarray, world_from_body: np.ndarray) -> Scan:
        """What it sees from there (4x4) of convex faces (F, 4), indices of vertices (V, 3), the fourth -1 for a triangle."""
        body_from_world = inverse(world_from_body)
        in_body = vertices_m @ body_from_world[:3, :3].T + body_from_world[:3, 3] - (0.0, 0.0, self.height_m)
        ranges_m = nearest_m(cuts(in_body, faces), self.bearings_rad)
        ranges_m[ranges_m > self.range_m] = np.inf
        ranges_m.flags.writeable = False
        return Scan(self.bearings_rad, ranges_m, self.range_m)


def cuts(vertices_m: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(S, 2, 2) metres: where the faces cross the plane z = 0."""
    corners = np.where(faces[:, 3:4] < 0, faces[:, [0, 1, 2, 2]], faces[:, :4])
    above = vertices_m[corners, 2] >= 0.0
    corners = corners[above.any(axis=1) & ~above.all(axis=1)]
    above = vertices_m[corners, 2] >= 0.0
    crossed = above != np.roll(above, -1, axis=1)  # of the edge from each corner to the next; two of a convex face
    begin, end = vertices_m[corners[crossed]], vertices_m[np.roll(corners, -1, axis=1)[crossed]]
    share = begin[:, 2] / (begin[:, 2] - end[:, 2])
    return (begin[:, :2] + share[:, None] * (end - begin)[:, :2]).reshape(-1, 2, 2)


def nearest_m(segments_m: np.ndarray, bearings_rad: np.ndarray) -> np.ndarray:
    """(B,) metres along each of these beams, evenly spread from the origin, to the nearest segment (S, 2, 2); inf: none."""
    angles = np.arctan2(segments_m[..., 1], segments_m[..., 0])
    turn = (np.diff(angles, axis=1)[:, 0] + np.pi) % (2.0 * np.pi) - np.pi  # the short way round: the origin is in none
    low = angles[:, 0] + np.minimum(turn, 0.0)
    step = bearings_rad[1] - bearings_rad[0]
    found = np.full(len(bearings_rad), np.inf)
    for around in (-2.0 * np.pi, 0.0, 2.0 * np.pi):
        first = np.clip(np.ceil((low + around - bearings_rad[0]) / step), 0, len(found)).astype(int)
        last = np.clip(np.floor((low + np.abs(turn) + around - bearings_rad[0]) / step), -1, len(found) - 1).astype(int)
        count = np.maximum(last - first + 1, 0)
        which = np.repeat(np.arange(len(count)), count)
        beams = np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + first[which]
        np.minimum.at(found, beams, _along_m(segments_m[which], bearings_rad[beams]))
    return found


def _along_m(segments_m: np.ndarray, bearings_rad: np.ndarray) -> np.ndarray:
    """(K,) metres along each beam to the line of its segment (K, 2, 2)."""
    begin, way = segments_m[:, 0], segments_m[:, 1] - segments_m[:, 0]
    across = np.cos(bearings_rad) * way[:, 1] - np.sin(bearings_rad) * way[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (begin[:, 0] * way[:, 1] - begin[:, 1] * way[:, 0]) / across
    return np.where(along > LEAST_M, along, np.inf)  # one seen edge on, whose line the beam is, is seen by its neighbours
