"""The pose graph of key scans: odometry, loops, the poses that agree with them best, and how sure they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from rhs.estimation.filters.pose_graph import Edges, joined, optimise
from rhs.estimation.filters.settings import Effort
from rhs.estimation.scans.planar_poses import between, flat, lifted

from .config import ScanGraph
from .keys import HEIGHT, Keys, covariances_of, edges_of

if TYPE_CHECKING:
    from .windows import Find

STRAIN_M, STRAIN_RAD = 0.1, 0.02  # a loop that says so little new is solved for later
EFFORT = Effort(iterations=15, settled=1e-4)
PLANE = np.array([0, 1, 5])
SAMPLES = 60  # key scans that are asked how sure they are


class Graph:
    """poses (K, 3) of the key scans as believed now; their odometry (odometry_edges); loops between them."""

    def __init__(self, keys: Keys, poses: np.ndarray, odometry: tuple[Edges, np.ndarray], settings: ScanGraph) -> None:
        self.keys, self.poses = keys, poses.copy()
        self.loops: list[Find] = []
        self.settings, self._kernel = settings.advanced, settings.kernel_sigma
        self.odometry, self._drift = odometry
        self.edges = self.odometry  # edges: that the poses agree with

    def add(self, finds: list[Find]) -> None:
        """Take loops in; the poses move when they say something new."""
        self.loops += finds
        strained = False
        for find in finds:
            off = between(find.pose, between(self.poses[find.earlier], self.poses[find.later]))
            strained |= bool(np.hypot(*off[:2]) > STRAIN_M or abs(off[2]) > STRAIN_RAD)
        if strained:
            self.settle()

    def loop_edges(self) -> Edges:
        """The loops as edges of the graph."""
        from .windows import find_spread

        return edges_of(np.array([find.earlier for find in self.loops], int),
                        np.array([find.later for find in self.loops], int),
                        np.array([find.pose for find in self.loops]).reshape(-1, 3),
                        np.array([find_spread(find, self.settings) for find in self.loops]).reshape(-1, 3, 3), robust=True)

    def settle(self) -> None:
        """Move the poses to where all edges agree best."""
        if self.loops:
            self.edges = joined(self.odometry, self.loop_edges())
            self.poses = solved(self.poses, self.edges, self._kernel)

    def way_sigma_m(self) -> float:
        """How sure the poses are, seen from the first one: standard deviation of position, rms along the way, metres."""
        covariances = self.edges.covariances.copy()
        covariances[: len(self.odometry)] = covariances_of(self._drift) + HEIGHT
        return way_sigma_m(self.poses, replace(self.edges, covariances=covariances), self._kernel)


def solved(poses: np.ndarray, edges: Edges, kernel: float) -> np.ndarray:
    """(K, 3) poses that the edges agree on best."""
    return flat(optimise(lifted(poses), edges, kernel=kernel, effort=EFFORT).poses)


def way_sigma_m(poses: np.ndarray, edges: Edges, kernel: float) -> float:
    """Root mean square of the standard deviations of position along the way, poses (K, 3), seen from its first one, metres.
    Edges marked robust count as little as the kernel makes them (Cauchy, `kernel` sigmas). Where scans see no motion along a
    corridor or an empty street the wheels alone say it, and where no loop takes that back the way may be metres off without
    one wall out of place."""
    first, second, count = np.asarray(edges.from_at), np.asarray(edges.to_at), len(poses)
    step = between(poses[first], poses[second])
    information = np.linalg.inv(edges.covariances[:, PLANE[:, None], PLANE])
    off = between(flat(edges.from_from_to), step)
    chi2 = np.einsum("ni,nij,nj->n", off, information, off)
    information /= np.where(edges.robust, 1.0 + chi2 / kernel**2, 1.0)[:, None, None]
    moved = -_seen_from(step)  # of the step, where its first pose moves in its own frame
    across = np.swapaxes(moved, 1, 2) @ information
    blocks = ((first, first, across @ moved), (first, second, across), (second, first, np.swapaxes(across, 1, 2)),
              (second, second, information))
    axis = np.arange(3)
    rows = [np.broadcast_to(3 * a[:, None, None] + axis[:, None], block.shape).ravel() for a, _, block in blocks]
    columns = [np.broadcast_to(3 * b[:, None, None] + axis, block.shape).ravel() for _, b, block in blocks]
    values = np.concatenate([block.ravel() for *_, block in blocks])
    whole = coo_matrix((values, (np.concatenate(rows), np.concatenate(columns))), (3 * count, 3 * count)).tocsc()
    asked = np.unique(np.linspace(1, count - 1, min(SAMPLES, count - 1)).astype(int)) - 1  # the first pose is held
    place = (3 * asked[:, None] + [0, 1]).ravel()
    right = np.zeros((3 * count - 3, len(place)))
    right[place, np.arange(len(place))] = 1.0
    variance = splu(whole[3:, 3:]).solve(right)[place, np.arange(len(place))]
    return float(np.sqrt(variance.sum() / len(asked)))


def _seen_from(step: np.ndarray) -> np.ndarray:
    """(N, 3, 3) adjoints of the inverse of motions (N, 3): a small motion of their first pose as their last one sees it."""
    c, s, x, y = np.cos(step[:, 2]), np.sin(step[:, 2]), step[:, 0], step[:, 1]
    one, none = np.ones(len(step)), np.zeros(len(step))
    return np.array([[c, s, s * x - c * y], [-s, c, c * x + s * y], [none, none, one]]).transpose(2, 0, 1)
