"""When may a robot say that it knows where it is? While places vouch for its pose since the last doubt.

One recognised place is not enough where paintings look alike, and a robot that turns on the spot sees the same look-alike
again and again; so after a doubt several places have to agree with its own motion over some way.
"""

from __future__ import annotations

import numpy as np

from rhs.geometry import planar, wrap

CONFIRMATIONS, WAY_M = 4, 1.0  # so many named places in a row, over so much way, agree with the motion
JUMP_M, JUMP_RAD = 0.75, np.radians(30.0)  # a belief that moved so far off its own motion is another belief


class Vouching:
    """Counts what speaks for the pose believed in. known: told where it is, or nothing is there to vouch."""

    def __init__(self, known: bool) -> None:
        self.vouched = known
        self._count, self._way_m = 0, 0.0

    def doubt(self) -> None:
        """What was known is known no longer."""
        self.vouched, self._count, self._way_m = False, 0, 0.0

    def travel(self, previous_from_body: np.ndarray) -> None:
        """The robot moved (4x4); way counts from the first confirmation on."""
        if self._count:
            self._way_m += float(np.hypot(*planar(previous_from_body)[:2]))

    def hear(self, agrees: bool) -> None:
        """A place was named: where the robot believes to be, or elsewhere. One named elsewhere does not overthrow what
        is vouched for, but those that vouch have to begin anew."""
        if not agrees:
            self._count, self._way_m = 0, 0.0
            return
        self._count += 1
        self.vouched = self.vouched or (self._count >= CONFIRMATIONS and self._way_m >= WAY_M)

    def follow(self, expected: np.ndarray, believed: np.ndarray) -> None:
        """Doubt when the belief (3,) is not where the one before and the motion put it (3,)."""
        gap = believed - expected
        if np.hypot(gap[0], gap[1]) > JUMP_M or abs(wrap(gap[2])) > JUMP_RAD:
            self.doubt()

    @property
    def chance(self) -> float:
        """Chance that the best belief is right at all: low while nothing confirmed it, rising with the way confirmed."""
        if self.vouched:
            return 1.0
        return 0.2 if not self._count else 0.6 + 0.35 * min(self._count / CONFIRMATIONS, self._way_m / WAY_M, 1.0)
