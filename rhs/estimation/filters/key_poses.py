"""A long chain of poses by a few of them: the pose graph of a drive of any length is of bounded size.

Between two key poses with nothing but odometry in between, the motions add up to one motion with one covariance, and what
the graph changes of it goes to the poses between in proportion to what their motions were unsure of. To first order in
that change this is what the graph of all poses comes to (elimination of a chain, as in factor graphs: Dellaert, Kaess,
Factor Graphs for Robot Perception (2017), ch. 3; the pre-integration of Forster et al. (2017) is the same for an IMU).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rhs.api.geometry import inverse

from .pose_graph import Edges, adjoints, chain, exp_poses, log_poses


def key_rows(count: int, most: int, *also: np.ndarray) -> np.ndarray:
    """(K,) rows of `count` poses that become nodes: all where they are at most `most`, else so many evenly spaced, the last
    one and `also`, those that more than odometry holds."""
    if count <= most:
        return np.arange(count)
    every = -(-count // most)
    return np.unique(np.concatenate([np.arange(0, count, every), [count - 1], *also]).astype(int))


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """Poses (N, 4, 4) of an odometry, covariances (N - 1, 6, 6) of its motions, and the rows (K,) of the key poses."""

    poses: np.ndarray
    covariances: np.ndarray
    rows: np.ndarray

    def chain(self) -> Edges:
        """The odometry from each key pose to the next."""
        if len(self.rows) == len(self.poses):
            return chain(self.poses, self.covariances)
        sums = np.empty((len(self.rows) - 1, 6, 6))
        for total, (first, last) in zip(sums, pairwise(self.rows), strict=True):
            motions, unsure = self._stretch(first, last)
            back = adjoints(inverse(motions[-1:]))[0]
            total[...] = back @ unsure[-1] @ back.T
        return chain(self.poses[self.rows], 0.5 * (sums + np.swapaxes(sums, 1, 2)))

    def filled(self, solved: np.ndarray, share: float = 0.0) -> np.ndarray:
        """(N, 4, 4): the key poses where the graph put them (K, 4, 4), the others between them. share: of which the
        odometry's metres are too short."""
        if len(self.rows) == len(self.poses):
            return solved
        out = np.empty_like(self.poses)
        out[0] = solved[0]
        for (first, last), begin, end in zip(pairwise(self.rows), solved[:-1], solved[1:], strict=True):
            motions, unsure = self._stretch(first, last)
            motions[:, :3, 3] *= 1.0 + share
            change = adjoints(motions[-1:])[0] @ log_poses(inverse(motions[-1:]) @ inverse(begin)[None] @ end)[0]
            parts = unsure @ np.linalg.solve(unsure[-1], change)
            local = np.einsum("nij,nj->ni", adjoints(inverse(motions)), parts)
            out[first + 1 : last + 1] = begin @ motions @ exp_poses(local)
            out[last] = end
        return out

    def _stretch(self, first: int, last: int) -> tuple[np.ndarray, np.ndarray]:
        """Of the poses after `first` up to `last` (S): the motions (S, 4, 4) from `first`, and the covariances (S, 6, 6)
        summed up to there, in the frame of `first`."""
        motions = inverse(self.poses[first : first + 1]) @ self.poses[first + 1 : last + 1]
        turned = adjoints(motions)
        return motions, np.cumsum(turned @ self.covariances[first:last] @ np.swapaxes(turned, 1, 2), axis=0)
