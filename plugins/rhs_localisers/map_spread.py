"""How unsure a belief is because the map is: against the survey's start, which no fix in the map takes away.

The loop closer says of some views how unsure it is of their poses (View.of_map). A robot that begins where the survey ended
errs as that view does, and goes on to err so: odometry carries the error along, turned about the robot. A place named, or a
scan laid on walls, takes as much of it away as the filter's gain takes of the belief, and puts the error of the views beside
it there in its stead: where nothing is recognised in a bent map, the robot is not sure of the part that it drives through.
Source: what a filter leaves out that takes its map for the truth (Castellanos, Neira and Tardos, Limits to the consistency
of EKF-based SLAM, 2004); errors of which nobody knows how they go together: a convex mean bounds their variance.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rhs.api.geometry import compose_covariance, inverse
from rhs.api.records import View
from rhs.estimation.filters.pose_hypotheses import PLANE, Hypothesis

NONE = np.zeros((6, 6))  # a motion adds nothing to what the map errs by


class MapSpread:
    """Of one belief. covariance (6, 6): what it errs by with its map, besides what its filter says (right perturbation)."""

    def __init__(self, views: Iterable[View] = ()) -> None:
        said = [(view.map_from_body, view.of_map) for view in views if view.of_map is not None]
        self._poses = np.array([pose for pose, _ in said]).reshape(-1, 4, 4)
        self._covariances = np.array([covariance for _, covariance in said]).reshape(-1, 6, 6)
        self.begin(None)

    def at(self, map_from_body: np.ndarray) -> np.ndarray:
        """(6, 6) of the map beside a pose 4x4; zeros where the loop closer said nothing."""
        if not len(self._poses):
            return np.zeros((6, 6))
        nearest = int(np.argmin(np.linalg.norm(self._poses[:, :2, 3] - map_from_body[:2, 3], axis=1)))
        return compose_covariance(self._covariances[nearest], inverse(self._poses[nearest]) @ map_from_body, NONE)

    def begin(self, map_from_body: np.ndarray | None) -> None:
        """From this pose on; from None: from the next belief on."""
        self.covariance = np.zeros((6, 6)) if map_from_body is None else self.at(map_from_body)
        self._known = map_from_body is not None

    def move(self, previous_from_body: np.ndarray) -> None:
        """Odometry carries the error along."""
        self.covariance = compose_covariance(self.covariance, previous_from_body, NONE)

    def follow(self, before: Hypothesis | None, after: Hypothesis | None) -> None:
        """Places and scans made the best guess, as it was predicted, another one."""
        if after is None or not len(self._poses):
            self.begin(None)
        elif before is None or not self._known:
            self.begin(after.map_from_body)
        elif before is not after:
            self._correct(PLANE @ before.covariance @ PLANE.T, PLANE @ after.covariance @ PLANE.T, after.map_from_body)

    def _correct(self, before: np.ndarray, after: np.ndarray, map_from_body: np.ndarray) -> None:
        """before, after (3, 3): what the filter said of x, y and heading."""
        root = np.linalg.cholesky(before)
        back = np.linalg.inv(root)
        left, axes = np.linalg.eigh(back @ after @ back.T)  # one less the gain, in the axes of the filter
        if left[-1] > 1.0 + 1e-6:  # another guess
            self.begin(map_from_body)
            return
        left = np.clip(left, 0.0, 1.0)
        keeps, takes = (PLANE.T @ root @ (axes * np.sqrt(part)) @ axes.T @ back @ PLANE for part in (left, 1.0 - left))
        self.covariance = keeps @ self.covariance @ keeps.T + takes @ self.at(map_from_body) @ takes.T
