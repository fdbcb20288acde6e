"""The smooth error of a depth camera, learnt from points that it sees at two places of its image.

The inverse depth of a structured-light camera is off by a little that depends on the pixel (Teichman, Miller and Thrun,
"Unsupervised intrinsic calibration of depth sensors via SLAM", RSS 2013; Herrera, Kannala and Heikkilae, PAMI 2012). A bowl of
0.1 pixels of disparity looks like a turn as the picture shifts, and so makes ways along a wall too short or too long by
per cents. Here it is a bilinear grid over the image, with a prior; every key frame that sees the points of earlier ones adds
what they say of it, whatever its own pose (Schur complement).
"""

from __future__ import annotations

import cv2
import numpy as np

from rhs.api.geometry import Camera, inverse

from ..advanced import BendSettings


class DepthBend:
    """nodes (R * C,): 1/m to add to the inverse depth that is read, at the nodes of a grid over the image."""

    def __init__(self, settings: BendSettings, camera: Camera) -> None:
        self._settings, self._camera = settings, camera
        self._shape = settings.rows, settings.columns
        count = settings.rows * settings.columns
        self._information, self._vector = np.eye(count) / max(settings.sigma_per_m, 1e-9) ** 2, np.zeros(count)
        self.nodes = np.zeros(count)

    def at(self, pixels: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        """(N,) 1/m that nodes of some time add at pixels (N, 2)."""
        out: np.ndarray = self._shares(pixels) @ nodes
        return out

    def straightened(self, depth: np.ndarray) -> np.ndarray:
        """An (H, W) depth image in metres without what is known of its error."""
        if not self.nodes.any():
            return depth
        height, width = depth.shape
        u, v = np.linspace(0.0, self._shape[1] - 1.0, width), np.linspace(0.0, self._shape[0] - 1.0, height)
        columns, rows = np.meshgrid(u.astype(np.float32), v.astype(np.float32))
        more = cv2.remap(self.nodes.reshape(self._shape).astype(np.float32), columns, rows, cv2.INTER_LINEAR)
        with np.errstate(divide="ignore", invalid="ignore"):
            out = depth / (1.0 + depth * more)
        return np.where(out > 0.0, out, np.nan).astype(np.float32)

    def learn(self, then: tuple[np.ndarray, np.ndarray], now: tuple[np.ndarray, np.ndarray], now_from_then: np.ndarray,
              *, pixel_sigma: float, inverse_depth_sigma: float, student_dof: float) -> None:
        """Points seen then and now, N each: pixels (N, 2) and inverse depths (N,) as they were read; now_from_then (N, 4, 4)."""
        known = np.isfinite(then[1]) & np.isfinite(now[1])
        if known.sum() < self._settings.least_points:
            return
        (before, rho), (after, seen), poses = (x[known] for x in then), (x[known] for x in now), now_from_then[known]
        shares, shares_now = self._shares(before), self._shares(after)
        c, f = self._camera, float(np.sqrt(self._camera.fx * self._camera.fy))
        mended = np.maximum(rho + shares @ self.nodes, 1e-3)
        q = np.einsum("nij,nj->ni", poses[:, :3, :3], c.rays(before.astype(float)) / mended[:, None]) + poses[:, :3, 3]
        x, y, iz = q[:, 0] / q[:, 2], q[:, 1] / q[:, 2], 1.0 / q[:, 2]
        off = np.column_stack([f * (np.column_stack([x, y]) - c.rays(after.astype(float))[:, :2]), iz - seen])
        zero = np.zeros(len(x))
        by_point = np.stack([np.stack([f * iz, zero, -f * x * iz], 1), np.stack([zero, f * iz, -f * y * iz], 1),
                             np.stack([zero, zero, -iz * iz], 1)], 1)  # (N, 3, 3)
        by_pose = np.concatenate([by_point, np.cross(q[:, None, :], by_point)], axis=2)  # dq = t + w x q
        by_rho = -np.einsum("nij,nj->ni", by_point, q - poses[:, :3, 3]) / mended[:, None]
        by_nodes = by_rho[:, :, None] * shares[:, None, :]
        by_nodes[:, 2] -= shares_now
        raw = off - np.einsum("nik,k->ni", by_rho[:, :, None] * shares[:, None, :], self.nodes)
        variance = np.array([pixel_sigma**2, pixel_sigma**2, inverse_depth_sigma**2])
        spread = np.eye(3) * variance + inverse_depth_sigma**2 * by_rho[:, :, None] * by_rho[:, None, :]
        weight = np.linalg.inv(spread)
        best = off.copy()
        best[:, 2] -= shares_now @ self.nodes
        squared = np.einsum("ni,nij,nj->n", best, weight, best)
        weight *= ((student_dof + 3.0) / (student_dof + squared))[:, None, None]
        pose_side, node_side = (np.einsum("nki,nkl->nil", by, weight) for by in (by_pose, by_nodes))
        hpp, hpc, hcc = (np.einsum("nik,nkj->ij", side, by) for side, by in
                         ((pose_side, by_pose), (pose_side, by_nodes), (node_side, by_nodes)))
        gp, gc = np.einsum("nik,nk->i", pose_side, raw), np.einsum("nik,nk->i", node_side, raw)
        shrunk = np.linalg.solve(hpp + 1e-3 * np.eye(6), np.column_stack([hpc, gp]))
        self._information += (hcc - hpc.T @ shrunk[:, :-1]) / self._settings.correlated
        self._vector -= (gc - hpc.T @ shrunk[:, -1]) / self._settings.correlated
        self.nodes = np.linalg.solve(self._information, self._vector)

    def _shares(self, pixels: np.ndarray) -> np.ndarray:
        """(N, R * C) of each node at pixels (N, 2)."""
        rows, columns = self._shape
        u = np.clip(pixels[:, 0] / (self._camera.width - 1) * (columns - 1), 0.0, columns - 1.0)
        v = np.clip(pixels[:, 1] / (self._camera.height - 1) * (rows - 1), 0.0, rows - 1.0)
        across = np.maximum(1.0 - np.abs(u[:, None] - np.arange(columns)), 0.0)
        down = np.maximum(1.0 - np.abs(v[:, None] - np.arange(rows)), 0.0)
        return (down[:, :, None] * across[:, None, :]).reshape(len(pixels), rows * columns)
