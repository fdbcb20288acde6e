"""How sure the pose graph is of the way. Where scans see no motion along a corridor or an empty street the wheels alone say
it, and where no loop takes that back the way may be metres off without one wall out of place."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.linalg import splu

from rhs.estimation.filters.pose_graph import Edges
from rhs.estimation.scans.planar_poses import between, flat

PLANE = np.array([0, 1, 5])
SAMPLES = 60  # key scans that are asked


def way_sigma_m(poses: np.ndarray, edges: Edges, kernel: float) -> float:
    """Root mean square of the standard deviations of position along the way, poses (K, 3), seen from its first one, metres.
    Edges marked robust count as little as the kernel makes them (Cauchy, `kernel` sigmas)."""
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
