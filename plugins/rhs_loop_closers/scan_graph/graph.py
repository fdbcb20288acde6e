"""The pose graph of key scans: odometry, loops, the poses that agree with them best, and how sure they are."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rhs.estimation.filters.pose_graph import Edges, joined, marginals, optimise
from rhs.estimation.filters.settings import Effort
from rhs.estimation.scans.planar_poses import between, flat, lifted

from .config import ScanGraph
from .keys import HEIGHT, Keys, covariances_of, edges_of

if TYPE_CHECKING:
    from .windows import Find

STRAIN_M, STRAIN_RAD = 0.1, 0.02  # a loop that says so little new is solved for later
EFFORT = Effort(iterations=15, settled=1e-4)
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

    def spread(self) -> tuple[np.ndarray, np.ndarray]:
        """(M,) some key scans along the way but the first, and (M, 6, 6) how sure their poses are, seen from it. Where scans
        see no motion along a corridor or an empty street the wheels alone say it, and where no loop takes that back the way
        may be metres off without one wall out of place."""
        covariances = self.edges.covariances.copy()
        covariances[: len(self.odometry)] = covariances_of(self._drift) + HEIGHT
        count = len(self.poses)
        asked = np.unique(np.linspace(1, count - 1, min(SAMPLES, count - 1)).astype(int))
        return asked, marginals(lifted(self.poses), replace(self.edges, covariances=covariances), asked, kernel=self._kernel)


def solved(poses: np.ndarray, edges: Edges, kernel: float) -> np.ndarray:
    """(K, 3) poses that the edges agree on best."""
    return flat(optimise(lifted(poses), edges, kernel=kernel, effort=EFFORT).poses)
