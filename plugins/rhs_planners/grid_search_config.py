"""Settings of the grid searches: astar, theta_star."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Context, Planner
from rhs.api.errors import within

from .shared_config import PlannerSettings


@dataclass
class AStar(PlannerSettings):
    """A* over eight neighbours without cutting corners (Hart, Nilsson, Raphael 1968): complete, shortest on the grid."""

    preload = ("rhs_planners.grid_search",)
    any_angle: ClassVar[bool] = False

    expansions: int = within(100_000_000, 1, 10**12)
    """cells taken up before the budget is spent; above any map's number of cells"""

    def build(self, context: Context) -> Planner:
        from .grid_search import GridSearch

        return GridSearch(self)


@dataclass
class ThetaStar(AStar):
    """Theta* (Nash, Daniel, Koenig, Felner 2007): A* whose paths may leave the grid's directions. Complete."""

    any_angle = True
