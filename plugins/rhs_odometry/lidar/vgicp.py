"""Odometry `vgicp_lidar`: voxelised generalised ICP (Koide et al., ICRA 2021) of clouds against a map, by small_gicp.

Each voxel of the map holds the mean and the spread of its points, and a point may slide along the surface it lies on. Points
laid onto points may not: the rings of a scanner lie on ground and walls where they lay before, however far it went. Without
wheels it begins where the surfaces of two clouds on end fit (Segal, Haehnel and Thrun, RSS 2009).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import small_gicp

from rhs.api.geometry import inverse, orthonormal

from .config import VgicpLidar
from .odometry import LidarOdometry

SWEEP = 10  # clouds between two looks for voxels to forget


class Vgicp(LidarOdometry):
    """Begins from the wheels, else from where two clouds on end fit."""

    settings: VgicpLidar
    _map: Any
    _before: Any  # points and tree of the last cloud

    def begin(self, points: np.ndarray) -> None:
        self._map = small_gicp.GaussianVoxelMap(self.voxel_m)
        self._map.set_lru(horizon=self.settings.advanced.kept_clouds, clear_cycle=SWEEP)
        self._before = self._prepared(points)
        self._map.insert(self._before[0], np.eye(4))

    def align(self, points: np.ndarray, before: np.ndarray, wheel: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        cloud = self._prepared(points)
        guess = self._fit(cloud) if wheel is None else wheel
        self._before = cloud
        found = small_gicp.align(self._map, cloud[0], init_T_target_source=before @ guess, num_threads=1,
                                 max_iterations=self.settings.iterations)
        pose = np.asarray(found.T_target_source, float)
        if not self._trouble(inverse(before) @ pose, guess):
            self._map.insert(cloud[0], pose)
        return pose, guess

    def correct(self, pose: np.ndarray) -> None:
        """The map holds no cloud that was not believed."""

    def _fit(self, cloud: Any) -> np.ndarray:
        """previous_from_body by the surfaces of this cloud and the last; the last motion again where they fit nowhere."""
        found = small_gicp.align(self._before[0], cloud[0], self._before[1], init_T_target_source=self.last, num_threads=1,
                                 registration_type="GICP", max_correspondence_distance=self.settings.advanced.partner_m)
        motion = np.asarray(found.T_target_source, float)
        return orthonormal(motion) if found.converged and np.isfinite(motion).all() else self.last

    def _prepared(self, points: np.ndarray) -> Any:
        return small_gicp.preprocess_points(points, self.voxel_m, self.settings.advanced.neighbours, 1)
