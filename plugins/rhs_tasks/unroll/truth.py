"""What the wall of a tube truly looks like, and how well an unrolling found its way along it: for the judge alone."""

from __future__ import annotations

from typing import Any

import numpy as np

from rhs.api.geometry import inverse, rotation_z, se3
from rhs.estimation.views.features import gray

from .mosaic import Mosaic
from .settings import Unrolling
from .unrolling import Unroller, tube_of


class TextureJudge:
    """Knows the texture from the source itself (one that provides `texture`)."""

    def __init__(self, settings: Unrolling, source: Any) -> None:
        self._settings, self._source = settings, source
        self._tube, self._unit_m = tube_of(settings), settings.size_m
        if hasattr(source, "tube"):  # who has a texture may know its tube, too: then that is the truth, whatever was told
            self._tube, self._unit_m = source.tube, 1.0
        self._first: np.ndarray | None = None
        self._last = np.eye(4)

    def look(self, capture: Any, truth: np.ndarray | None) -> None:
        """Remember where the views were truly taken."""
        if truth is None:
            return
        eye = truth @ self._source.camera.body_from_camera
        self._first = eye if self._first is None else self._first
        self._last = eye

    def along_error_percent(self, along_m: float) -> float:
        """Of the believed way along the tube at the last view, share of the true one."""
        if self._first is None:
            return float("nan")
        upright = self._first_upright(np.eye(3))
        point = (inverse(upright) @ self._last)[:3, 3] / self._unit_m
        true_m = float(self._tube.locate(point[None])[0][0]) * self._unit_m
        return 100.0 * abs(along_m - true_m) / true_m if true_m > 0 else float("nan")

    def _first_upright(self, turn: np.ndarray) -> np.ndarray:
        """The middle of the section at the first view (4x4), turned by (3, 3)."""
        assert self._first is not None
        return se3(turn, self._first[:3, 3] - turn @ [0.0, self._settings.start_left_m, self._settings.start_up_m])

    def heading_error_deg(self, unroller: Unroller, along_m: float) -> float:
        """Largest error of the tube's direction up to there; NaN where nobody knows the true one."""
        if not hasattr(self._source, "tube"):
            return float("nan")
        at = np.linspace(0.0, along_m, 200)
        ours = np.array([unroller.tube.pose(s / self._settings.size_m)[:2, 0] for s in at])
        true = np.array([self._source.tube.pose(s)[:2, 0] for s in at])
        cross, dot = true[:, 0] * ours[:, 1] - true[:, 1] * ours[:, 0], (true * ours).sum(axis=1)
        return float(np.degrees(np.abs(np.arctan2(cross, dot)).max()))

    def texture(self, mosaic: Mosaic) -> np.ndarray:
        """(rows, columns) true grey on the mosaic's pixels, NaN where unknown."""
        flat = mosaic.grid(mosaic.first, mosaic.columns) * self._settings.size_m
        return self._source.texture(*flat.T).reshape(mosaic.rows, mosaic.columns).astype(np.float32)


class DepthJudge(TextureJudge):
    """Paints the truth from ideal views, their true depth and true poses: for worlds that nobody unrolled before."""

    REACH = 0.15  # a pixel counts when it lies this near the wall of the section (sizes): not beyond doors and corners

    def __init__(self, settings: Unrolling, source: Any) -> None:
        super().__init__(settings, source)
        self._points: list[np.ndarray] = []  # (N, 4) along, around, grey, weight

    def look(self, capture: Any, truth: np.ndarray | None) -> None:
        super().look(capture, truth)
        if truth is None or capture.depth is None or capture.image is None or self._first is None:
            return
        size, camera = self._settings.size_m, self._source.camera
        v, u = (a.ravel() for a in np.indices(capture.depth.shape))
        points = camera.points(np.stack([u, v], axis=1).astype(float), capture.depth.ravel())
        yaw = np.arctan2(self._first[1, 2], self._first[0, 2])  # the camera looks along the tube at first
        tube_from_camera = inverse(self._first_upright(rotation_z(yaw))) @ truth @ camera.body_from_camera
        there = (points @ tube_from_camera[:3, :3].T + tube_from_camera[:3, 3]) / size
        along, left, up = self._tube.locate(np.nan_to_num(there))
        near = np.isfinite(points).all(1) & (np.abs(self._tube.section.slack(left, up)) < self.REACH)
        ahead = np.linalg.norm(points, axis=1) / size
        near &= ahead < 1.5 * self._settings.far_sizes
        rows = np.stack([along, self._tube.section.around(left, up), gray(capture.image).ravel(), ahead**-6.0], axis=1)
        self._points.append(rows[near].astype(np.float32))

    def texture(self, mosaic: Mosaic) -> np.ndarray:
        total, weight = np.zeros((mosaic.rows, mosaic.columns)), np.zeros((mosaic.rows, mosaic.columns))
        row_size = self._tube.section.perimeter_m / mosaic.rows
        for points in self._points:
            column = np.floor(points[:, 0] / mosaic.pixel).astype(int) - mosaic.first
            row = np.floor(points[:, 1] / row_size).astype(int) % mosaic.rows
            inside = (column >= 0) & (column < mosaic.columns)
            at = row[inside], column[inside]
            np.add.at(total, at, points[inside, 2] * points[inside, 3])
            np.add.at(weight, at, points[inside, 3])
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(weight > 0, total / weight, np.nan).astype(np.float32)
