"""Where in its cell a thing was seen: a cell of 5 cm alone says it to 3.5 cm, and a narrow gap leaves hardly more."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rhs.api.geometry import planar
from rhs.api.records import Scan

if TYPE_CHECKING:
    from rhs.estimation.scans.votes import Votes  # compiled code

MOST_VIEWS = 4  # that the mean is of: views from near come last and see best


class Ends:
    """Of each cell of a grid the mean of the beams' ends in it, by views, as in a normal distributions transform (Biber and
    Strasser 2003). x_m, y_m (H, W) float32: of that mean from the cell's middle; views (H, W) float32: it is the mean of."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self.arrays = self.x_m, self.y_m, self.views = tuple(np.zeros(shape, np.float32) for _ in range(3))

    def look(self, layer: Votes, pose: np.ndarray, scan: Scan, hits: np.ndarray, exact: bool,
             within_m: float = 4.8) -> tuple[np.ndarray, np.ndarray]:
        """Count one scan in the layer, seen from the pose (4, 4) of its frame, and note where its beams end, those that hit
        (N,) bool; exact: they are more so than a cell. (The layer's votes before, the cells (K, 2) seen)."""
        before = layer.votes.copy()
        if exact:
            self._note(layer, pose, scan, hits & (scan.ranges_m <= min(within_m, scan.max_range_m)))
        return before, layer.look(pose, scan, hits=hits, within_m=within_m)

    def _note(self, layer: Votes, pose: np.ndarray, scan: Scan, ended: np.ndarray) -> None:
        """Take the beams that ended (N,) bool. Where the layer has no votes yet the mean begins anew."""
        bearings_rad, ranges_m = scan.bearings_rad[ended] + planar(pose)[2], scan.ranges_m[ended]
        start = pose[:2, :2] @ np.asarray(scan.origin_xy_m) + pose[:2, 3] - layer.origin_m
        ways = ranges_m[:, None] * np.stack([np.cos(bearings_rad), np.sin(bearings_rad)], axis=1)
        at = (start + ways) / layer.resolution_m
        columns, rows = np.floor(at).astype(int).T
        inside = (rows >= 0) & (columns >= 0) & (rows < self.views.shape[0]) & (columns < self.views.shape[1])
        flat, of, count = np.unique(np.ravel_multi_index((rows[inside], columns[inside]), self.views.shape),
                                    return_inverse=True, return_counts=True)
        views = np.where(layer.votes.ravel()[flat] > 0.0, np.minimum(self.views.ravel()[flat], MOST_VIEWS - 1), 0.0) + 1.0
        for mean_m, part in ((self.x_m, at[inside, 0] - columns[inside]), (self.y_m, at[inside, 1] - rows[inside])):
            seen_m = layer.resolution_m * (np.bincount(of, weights=part, minlength=len(flat)) / count - 0.5)
            mean_m.ravel()[flat] += (seen_m - mean_m.ravel()[flat]) / views
        self.views.ravel()[flat] = views

    def forget(self, cells: np.ndarray) -> None:
        """Things in these cells (K, 2) stand in their middles."""
        for array in self.arrays:
            array[cells[:, 0], cells[:, 1]] = 0.0
