"""Settings of fast marching."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.contracts import Context, Planner
from rhs.api.errors import Bounded, within

from .shared_config import PlannerSettings


@dataclass
class FastMarchingAdvanced(Bounded):
    """Thresholds of `planner=fast_marching`."""

    slowest: float = within(0.1, 1e-3, 1.0)
    """speed of the wave in a cell beside a wall, when it slows down near walls; 1 in the open"""


@dataclass
class FastMarching(PlannerSettings):
    """Fast marching (Sethian 1996): the time a wave from the goal takes to every cell, a navigation function without
    local minima, descended from the start. Complete. Kept while goal and map stay the same."""

    preload = ("rhs_planners.fast_marching",)

    comfort_m: float = within(0.0, 0.0, 100.0)
    """the wave is slower this near to blocked cells, so paths keep away; 0: shortest paths"""
    advanced: FastMarchingAdvanced = field(default_factory=FastMarchingAdvanced)

    def build(self, context: Context) -> Planner:
        from .fast_marching import FastMarchingPlanner

        return FastMarchingPlanner(self)
