"""Settings of the potential field."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.contracts import Context, Planner
from rhs.api.errors import within

from .shared_config import PlannerSettings


@dataclass
class PotentialField(PlannerSettings):
    """Potential field with a repulsive trail on visited cells, as in the thesis (section 3.2.5). The potential is in
    metres: its slope towards the goal is 1."""

    preload = ("rhs_planners.potential_field",)

    repulsion_m3: float = within(0.01, 0.0, 1e3)
    """gain: 0.5 * gain * (1/d - 1/reach)^2 at d metres from a blocked cell"""
    reach_m: float = within(0.2, 1e-3, 100.0)
    """blocked cells farther than this do not repel; two cells of 0.1 m"""
    trail_step_m: float = within(0.1, 1e-3, 100.0)
    """way between two cones of the trail; one cell where cells are larger"""
    trail: float = within(1.5, 0.0, 1e3)
    """height of a cone, in steps of the trail: 1 undoes one step to the goal; from 2 on the walk begins to wall
    itself in, below 1 it takes thousands of steps to leave a dead end"""
    trail_radius_m: float = within(0.3, 0.0, 100.0)
    """how far round the cell a cone reaches; below 3 steps the walk takes long"""
    steps: int = within(20_000, 1, 10_000_000)
    """of the trail, before the budget is spent: from cell to cell with cells of 0.1 m and larger"""

    def build(self, context: Context) -> Planner:
        from .potential_field import PotentialFieldPlanner

        return PotentialFieldPlanner(self)
