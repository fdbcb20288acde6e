"""A task for rhs: what a run does with the parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.task import Job, TaskContext, Value


@dataclass
class Skeleton(Bounded):
    """Lead the camera along its route and sum up what the odometry says: the columns way_m and turned_rad."""

    most_views: int = within(1000, 1, 1_000_000)
    """views after which it stops"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()
    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor", "odometry")

    def build(self, context: TaskContext) -> Job:
        return Work(self, context)


class Work:
    """What can be refused is refused while it is built; what fails in `run` is a row with a reason."""

    def __init__(self, settings: Skeleton, context: TaskContext) -> None:
        self.settings, self.context, self.parts = settings, context, context.parts()

    def run(self) -> Mapping[str, Value]:
        """The columns of the row that the task itself knows; those of metrics follow from the run folder."""
        way_m = turned_rad = 0.0
        led = self.context.lead(self.parts)
        for step in self.context.follow(led, "survey", self.parts.source.views_expected):
            motion = step.motion.previous_from_body
            way_m += float(np.linalg.norm(motion[:3, 3]))
            turned_rad += abs(float(np.arctan2(motion[1, 0], motion[0, 0])))
            if step.index + 1 >= self.settings.most_views:
                break
        return {"way_m": way_m, "turned_rad": turned_rad}
