"""A tube whose centre line bends as it likes, and what is known of its curvature: numbers along it with their information.

The tube bends in its horizontal plane only. Lengths are in sizes of the section, curvatures in radians per size, positive
to the left. How views say what the curvature is: rhs.bend_finder.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rhs.api.geometry import rotation_z, se3
from rhs.estimation.filters.kalman import symmetric
from rhs.worlds.tubes import RectangularSection, RoundSection

KNOT = 0.5  # the curvature is one number every so many sizes, and linear between
GRAIN = 0.02  # the centre line is summed up in steps of so many sizes
MOST_BENT = 0.3  # what is thinkable before anything is seen, radians per size (1 sigma)
CHANGES = 0.06  # how much the curvature changes from number to number (1 sigma)


@dataclass(frozen=True, eq=False)
class Winding:
    """A section along a centre line whose curvature is `bends` (N,) at 0, KNOT, 2 KNOT, ...; further on it stays."""

    section: RoundSection | RectangularSection
    bends: np.ndarray

    @cached_property
    def line(self) -> np.ndarray:
        """(4, M) s, heading, x, y of the centre line, from before the first view to beyond the last bend."""
        s = np.arange(-3.0, KNOT * len(self.bends) + 12.0, GRAIN)
        bend = np.interp(s, KNOT * np.arange(len(self.bends)), self.bends)
        heading = np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * GRAIN)])
        heading -= np.interp(0.0, s, heading)
        middle = 0.5 * (heading[1:] + heading[:-1])
        x = np.concatenate([[0.0], np.cumsum(np.cos(middle) * GRAIN)])
        y = np.concatenate([[0.0], np.cumsum(np.sin(middle) * GRAIN)])
        return np.stack([s, heading, x - np.interp(0.0, s, x), y - np.interp(0.0, s, y)])

    def heading(self, along: np.ndarray) -> np.ndarray:
        """(N,) radians by which the tube has turned to the left up to there."""
        return np.interp(along, self.line[0], self.line[1])

    def pose(self, along: float) -> np.ndarray:
        """4x4 tube_from_section, as rhs.tubes.Tube has it."""
        s, *rest = self.line
        heading, x, y = (float(np.interp(along, s, value)) for value in rest)
        return se3(rotation_z(heading), np.array([x, y, 0.0]))

    def points(self, along: np.ndarray, around: np.ndarray) -> np.ndarray:
        """(N, 3) points of the wall from (N,) each."""
        s, *rest = self.line
        heading, x, y = (np.interp(along, s, value) for value in rest)
        left, up = self.section.wall(around)
        return np.stack([x - left * np.sin(heading), y + left * np.cos(heading), up], axis=1)


class Profile:
    """What is known of the curvature: its numbers, and the information that pairs of views gave of them."""

    def __init__(self) -> None:
        self._given, self._pull = np.zeros((0, 0)), np.zeros(0)

    def reach(self, along: float) -> None:
        """Make numbers up to there."""
        more = int(np.ceil(along / KNOT)) + 2 - len(self._pull)
        if more > 0:
            self._given, self._pull = np.pad(self._given, (0, more)), np.pad(self._pull, (0, more))

    @property
    def information(self) -> np.ndarray:
        """(N, N) of all that was given, and of what is thinkable."""
        n = len(self._pull)
        steps = np.diff(np.eye(n), axis=0)
        return self._given + np.eye(n) / (n * MOST_BENT**2) + steps.T @ steps / CHANGES**2

    @property
    def bends(self) -> np.ndarray:
        """(N,) radians per size."""
        return np.linalg.solve(self.information, self._pull)

    def prior(self, chosen: slice) -> tuple[np.ndarray, np.ndarray]:
        """Mean and information of some of the numbers, whatever the others are."""
        covariance = np.linalg.inv(self.information)[chosen, chosen]
        return self.bends[chosen], symmetric(np.linalg.inv(covariance))

    def add(self, chosen: slice, information: np.ndarray, pull: np.ndarray) -> None:
        """What a pair of views says of some of the numbers: information (n, n), and that times the numbers it says."""
        self._given[chosen, chosen] += information
        self._pull[chosen] += pull
