"""The map that scans are laid onto: the points of the last key scans."""

from __future__ import annotations

from collections import deque
from functools import cached_property

import numpy as np

from rhs.estimation.scans.planar_poses import between
from rhs.estimation.scans.point_map import Cloud, Fit, PointMap, gathered, without_passed
from rhs.estimation.scans.window_search import WindowSearch

from .config import ScanToMap

FAR_M, CLEAR_M = 10.0, 0.4  # what a beam must pass a wall by to have looked through it
FIELD_SIGMA_M = 0.1
CONFUSED = 0.1  # this share of walls looked through says nothing: doors, people, edges
MOST_POINTS = 120  # of a scan that is searched for
WITNESSES_M = (0.6, 1.2, 2.4, 4.8)  # key scans this far back say what moved since
MOVED_M = 0.2  # what a beam must pass by a thing by to say that it is gone
SETTLED = np.array([MOVED_M, 0.05, 0.01])  # the same of key scans beside one another: laid onto one map


class LocalMap:
    """Key scans of the last metres; drawn anew with each."""

    def __init__(self, settings: ScanToMap) -> None:
        self._settings = settings
        self._keys: deque[tuple[Cloud, np.ndarray, float]] = deque(maxlen=settings.map_scans)
        self._way_m = 0.0

    @property
    def begun(self) -> bool:
        """Whether there is a map."""
        return bool(self._keys)

    def add(self, cloud: Cloud, pose: np.ndarray) -> None:
        """One more key scan at a pose (3,)."""
        if self._keys:
            self._way_m += float(np.hypot(*(pose[:2] - self._keys[-1][1][:2])))
        self._keys.append((cloud, pose.copy(), self._way_m))
        while self._way_m - self._keys[0][2] > self._settings.map_m:
            self._keys.popleft()
        for at in self._witnesses():
            other, there, way_m = self._keys[at]
            self._keys[at] = without_passed(other, there, [(cloud, pose)], SETTLED), there, way_m
        poses = np.array([key[1] for key in self._keys])
        points = self._settings.advanced.points
        self.walls = PointMap(*gathered([key[0] for key in self._keys], poses, cell_m=points.cell_m))
        self.__dict__.pop("_search", None)

    def still(self, cloud: Cloud, pose: np.ndarray, prior: np.ndarray) -> Cloud:
        """The cloud without what moves: what stands where earlier key scans saw nothing, wherever within two sigmas of a
        prior (3, 3) information about the pose (3,) it is seen from."""
        sigma = np.diag(prior) ** -0.5
        slack = np.array([MOVED_M, 2.0 * max(sigma[0], sigma[1]), 2.0 * sigma[2]])
        return without_passed(cloud, pose, [self._keys[at][:2] for at in self._witnesses()], slack)

    def _witnesses(self) -> list[int]:
        """Places of key scans some way before the last one."""
        way_m = np.array([key[2] for key in self._keys])
        places = np.searchsorted(way_m, self._way_m - np.array(WITNESSES_M), side="right") - 1
        return sorted({int(at) for at in places if 0 <= at < len(way_m) - 1})

    def far_from_last(self, pose: np.ndarray) -> bool:
        """Whether a scan at this pose is to be a key scan."""
        moved = between(self._keys[-1][1], pose)
        return bool(np.hypot(*moved[:2]) > self._settings.key_m or abs(moved[2]) > self._settings.key_rad)

    def score(self, cloud: Cloud, fit: Fit) -> float:
        """The share of points on walls, less that of walls which the beams look through."""
        through, met = self.walls.seen_through(cloud, fit.pose, far_m=FAR_M, clear_m=CLEAR_M)
        return fit.share - max(0.0, through / max(through + met, 1) - CONFUSED)

    def search(self, cloud: Cloud, around: np.ndarray) -> np.ndarray | None:
        """The pose (3,) in the rescue window around another where the scan fits best; None when it fits nowhere."""
        rescue, points = self._settings.advanced.rescue, cloud.points
        if not len(points) or not len(self.walls.points):
            return None
        points = points[np.linspace(0, len(points) - 1, min(len(points), MOST_POINTS)).astype(int)]
        found = self._search.best(points, around, window_m=rescue.window_m, window_rad=rescue.window_rad,
                                  step_rad=rescue.step_rad, least=0.3, rivals=1.0)
        return None if found is None else found.pose

    @cached_property
    def _search(self) -> WindowSearch:
        return WindowSearch(self.walls.points, cell_m=self._settings.advanced.rescue.cell_m, sigma_m=FIELD_SIGMA_M)
