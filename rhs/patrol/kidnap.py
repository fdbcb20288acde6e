"""Carry the robot elsewhere without telling it: the hardest question a localiser can be asked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rhs.api.contracts import Source
from rhs.api.geometry import se2
from rhs.api.records import Event, Twist, View
from rhs.base.errors import RhsError

from .mission import Logbook

SOONEST, LATEST = 4, 16  # commands of a mission before the robot is carried away
DRAWS = 50
SIDEWAYS_M, TURNED_RAD = 0.3, np.radians(40.0)


class Kidnapper:
    """Once per mission, at a seeded moment, puts the robot near a seeded view of the survey.

    The new pose is drawn round the surveyed views (up to 0.3 m to the side, 40 degrees turned) until the source has room for
    the robot there and where its next command leads, in half of the cases turned round: nobody sets a robot down against a
    wall. Where there never is room, the robot stays.
    """

    def __init__(self, rng: np.random.Generator, views: Sequence[View]) -> None:
        self.rng, self.views = rng, views
        self.done_for = 0
        self.moment = self._draw_moment()
        self.fresh = False

    def maybe(self, source: Source, book: Logbook, command: Twist) -> None:
        """Kidnap now if it is time, before the command."""
        mission = book.missions[-1]
        if mission.mission > self.done_for and mission.steps >= self.moment:
            self.done_for, self.moment = mission.mission, self._draw_moment()
            self.fresh = self._carried_off(source, command)

    def _carried_off(self, source: Source, command: Twist) -> bool:
        """Whether a place with room was found; a surveyed pose may be wrong, and something may stand there since."""
        stood = source.truth()
        for _ in range(DRAWS):
            pose = self._draw_pose()
            try:
                source.teleport(pose @ se2(*command.travel))
                source.teleport(pose)
            except RhsError:
                continue
            return True
        if stood is not None:
            source.teleport(stood)
        return False

    def news(self) -> list[Event]:
        """[KIDNAPPED] once after each kidnap, for the step's event."""
        fresh, self.fresh = self.fresh, False
        return [Event.KIDNAPPED] if fresh else []

    def _draw_moment(self) -> int:
        return int(self.rng.integers(SOONEST, LATEST + 1))

    def _draw_pose(self) -> np.ndarray:
        view = self.views[int(self.rng.integers(len(self.views)))]
        turned = self.rng.uniform(-TURNED_RAD, TURNED_RAD) + np.pi * self.rng.integers(2)
        return view.map_from_body @ se2(0.0, self.rng.uniform(-SIDEWAYS_M, SIDEWAYS_M), float(turned))
