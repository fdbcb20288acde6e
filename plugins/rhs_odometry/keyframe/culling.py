"""Which key frame a full map gives up, and what becomes of its edges.

The one given up has the nearest neighbour: what it sees is what that one sees. It then hangs on the key frame it was
measured against best, rigidly, and its other edges are carried over to that one. Compare the culling of key frames in
ORB-SLAM (Mur-Artal, Montiel and Tardos, TRO 2015, section VI-E) and the marginalisation of pose graphs (Carlevaris-
Bianco and Eustice, IROS 2013), of which this is the cheapest: nothing fills in, and of two edges between the same key
frames the surer one stays, since their errors are not independent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.geometry import adjoint, inverse


@dataclass(frozen=True, eq=False)
class Edge:
    """Key frame b seen from key frame a: a_from_b (4x4) with the covariance (6x6) of its right perturbation.
    loop: a was found again, not followed, so the edge may be wrong."""

    a: int
    b: int
    a_from_b: np.ndarray
    covariance: np.ndarray
    loop: bool = False

    def turned(self) -> Edge:
        """The same, a seen from b."""
        move = adjoint(self.a_from_b)
        covariance = move @ self.covariance @ move.T
        return Edge(self.b, self.a, inverse(self.a_from_b), 0.5 * (covariance + covariance.T), self.loop)


def spare(poses: np.ndarray, kept: np.ndarray, spacing: tuple[float, float]) -> int:
    """Which of (N, 4, 4) poses is best done without: not one of kept (N,) bool, nearest to another one in units of spacing
    (metres, radians); of two the later."""
    rotations = poses[:, :3, :3].reshape(-1, 9)
    x, y, z = (along[:, None] - along for along in np.ascontiguousarray(poses[:, :3, 3].T))
    apart_m = np.sqrt(x * x + y * y + z * z)
    angle = np.arccos(np.clip(0.5 * (rotations @ rotations.T - 1.0), -1.0, 1.0))
    apart = apart_m / spacing[0] + angle / spacing[1]
    np.fill_diagonal(apart, np.inf)
    alone = np.where(kept, np.inf, apart.min(axis=1))
    return len(alone) - 1 - int(alone[::-1].argmin())


def without(edges: list[Edge], k: int, poses: np.ndarray) -> tuple[int, np.ndarray, list[Edge]]:
    """The host that key frame k hangs on from now on, host_from_k (4x4) as the poses (N, 4, 4) have settled, and all edges
    with k gone: those of k are carried over to the host, and numbers above k move down by one."""
    own = [e if e.b == k else e.turned() for e in edges if k in (e.a, e.b)]  # each a_from_k
    tie = min(own, key=lambda e: float(np.trace(e.covariance)))
    host, host_from_k = tie.a, inverse(poses[tie.a]) @ poses[k]
    best: dict[tuple[int, int, bool], Edge] = {}
    carried = [_carried(e, tie, host_from_k) for e in own if e.a != host]
    for edge in [e for e in edges if k not in (e.a, e.b)] + carried:
        edge = edge if edge.a < edge.b else edge.turned()
        name = edge.a - (edge.a > k), edge.b - (edge.b > k), edge.loop
        if name not in best or np.trace(edge.covariance) < np.trace(best[name].covariance):
            best[name] = edge
    return host, host_from_k, [e if (e.a, e.b) == (a, b) else Edge(a, b, e.a_from_b, e.covariance, e.loop)
                               for (a, b, _), e in best.items()]


def _carried(edge: Edge, tie: Edge, host_from_k: np.ndarray) -> Edge:
    """An edge a_from_k made into one to the host of k, which the edge `tie` ties it to."""
    move = adjoint(host_from_k)
    covariance = move @ (edge.covariance + tie.covariance) @ move.T
    a_from_host = edge.a_from_b @ inverse(host_from_k)
    return Edge(edge.a, tie.a, a_from_host, 0.5 * (covariance + covariance.T), edge.loop or tie.loop)
