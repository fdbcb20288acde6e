"""The simplest planner there is: straight ahead, if nothing stands in between."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context
from rhs.api.errors import check_range
from rhs.api.records import Path, PlanningProblem, PlanReason


@dataclass
class StraightLine:
    """Goes straight to the goal, or not at all."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    step_m: float = 0.05
    """distance between the points at which the line is looked at, metres"""

    def __post_init__(self) -> None:
        check_range("planner.straight_line", "step_m", self.step_m, low=0.01, high=1.0, unit="m")

    def build(self, context: Context) -> "Ruler":
        return Ruler(self.step_m)


class Ruler:
    """The planner itself."""

    def __init__(self, step_m: float) -> None:
        self.step_m = step_m

    def plan(self, problem: PlanningProblem) -> Path:
        """The line from start to goal, or why there is none."""
        count = int(np.linalg.norm(problem.goal_m - problem.start_m) / self.step_m) + 2
        line = np.linspace(problem.start_m, problem.goal_m, count)
        cells = np.floor((line - problem.origin_m) / problem.resolution_m).astype(int)[:, ::-1]
        ends = np.array([problem.start_m, problem.goal_m])
        reason = self._judge(cells, problem.blocked)
        return Path(reason, ends, ends) if reason is PlanReason.OK else Path(reason, ends[:0], ends[:0])

    @staticmethod
    def _judge(cells: np.ndarray, blocked: np.ndarray) -> PlanReason:
        if np.any(cells < 0) or np.any(cells >= blocked.shape):
            return PlanReason.OUTSIDE
        hit = blocked[tuple(cells.T)]
        if hit[0]:
            return PlanReason.START_BLOCKED
        if hit[-1]:
            return PlanReason.GOAL_BLOCKED
        return PlanReason.DISCONNECTED if hit.any() else PlanReason.OK
