"""Odometry `vgicp_lidar`: voxelised generalised ICP (Koide et al., ICRA 2021) of clouds against a map, by small_gicp.

Each voxel of the map holds the mean and the spread of its points, and a point may slide along the surface it lies on. Points
laid onto points may not: the rings of a scanner lie on ground and walls where they lay before, however far it went. Without
wheels it begins where the surfaces of two clouds on end fit (Segal, Haehnel and Thrun, RSS 2009).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import small_gicp

from rhs.api.geometry import orthonormal

from .config import VgicpLidar
from .odometry import LidarOdometry

SWEEP = 10  # clouds between two looks for voxels to forget


class Vgicp(LidarOdometry):
    """Begins from the wheels, else from where two clouds on end fit."""

    settings: VgicpLidar
    _map: Any
    _before: Any  # points and tree of the last cloud
    _now: Any  # of this one
    _made_of: np.ndarray | None = None  # the points of `_now`

    def begin(self, points: np.ndarray) -> None:
        self._map = small_gicp.GaussianVoxelMap(self.voxel_m)
        self._map.set_lru(horizon=self.settings.advanced.kept_clouds, clear_cycle=SWEEP)
        self._before = self._prepared(points)
        self._map.insert(self._before[0], np.eye(4))

    def guess(self, points: np.ndarray) -> np.ndarray:
        """By the surfaces of this cloud and the last; the last motion again where they fit nowhere."""
        self._now, self._made_of = self._prepared(points), points
        before, tree = self._before
        found = small_gicp.align(before, self._now[0], tree, init_T_target_source=self.last, num_threads=1,
                                 registration_type="GICP", max_correspondence_distance=self.settings.advanced.partner_m)
        motion = np.asarray(found.T_target_source, float)
        return orthonormal(motion) if found.converged and np.isfinite(motion).all() else self.last

    def align(self, points: np.ndarray, before: np.ndarray, guess: np.ndarray) -> np.ndarray:
        if points is not self._made_of:
            self._now, self._made_of = self._prepared(points), points
        self._before = self._now
        found = small_gicp.align(self._map, self._now[0], init_T_target_source=before @ guess, num_threads=1,
                                 max_iterations=self.settings.iterations)
        return np.asarray(found.T_target_source, float)

    def settle(self, pose: np.ndarray, *, aligned: bool) -> None:
        if aligned:
            self._map.insert(self._now[0], pose)

    def _prepared(self, points: np.ndarray) -> Any:
        return small_gicp.preprocess_points(points, self.voxel_m, self.settings.advanced.neighbours, 1)
