"""A loop closer for rhs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.geometry import planar, se2
from rhs.api.records import Closure, View


@dataclass
class Skeleton(Bounded):
    """A survey that ends near where it began is taken to end there: the gap is spread over the way. A real one looks at the
    views (their features and scans) before it believes that."""

    near_m: float = within(0.5, 0.0, 100.0)
    """an end this close to the beginning, as believed, is a loop, metres"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self)


class Part:
    """Built anew for every run."""

    def __init__(self, settings: Skeleton) -> None:
        self.settings = settings

    def close(self, views: Sequence[View]) -> Closure:
        """As many poses as views, the first unchanged."""
        poses = np.array([view.map_from_body for view in views]).reshape(-1, 4, 4)
        if len(poses) < 2:
            return Closure(poses)
        gap = planar(poses[-1]) - planar(poses[0])
        way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(poses[:, :2, 3], axis=0), axis=1))]
        if np.hypot(gap[0], gap[1]) > min(self.settings.near_m, 0.1 * way[-1]):
            return Closure(poses)
        shifts = way / way[-1]
        moved = [se2(-share * gap[0], -share * gap[1], 0.0) @ pose for share, pose in zip(shifts, poses, strict=True)]
        return Closure(np.array(moved))
