"""Settings of the potential field."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.errors import check_range

from .shared_config import PlannerSettings


@dataclass
class PotentialField(PlannerSettings):
    """Potential field with a repulsive trail on visited cells, as in the thesis (section 3.2.5). The potential is in
    metres: its slope towards the goal is 1."""

    repulsion_m3: float = 0.01  # gain: 0.5 * gain * (1/d - 1/reach)^2 at d metres from a blocked cell
    reach_m: float = 0.2  # blocked cells farther than this do not repel; two cells of 0.1 m
    trail_m: float = 0.2  # added to the potential round a cell each time it is visited; lifts it above its neighbours
    trail_radius_m: float = 0.3  # how far round; below 3 cells the walk takes ten times as long to leave a dead end
    steps: int = 20_000  # of the walk, from cell to cell, before the budget is spent

    def __post_init__(self):
        owner = "planner.potential_field"
        self.check(owner)
        check_range(owner, "repulsion_m3", self.repulsion_m3, low=0.0, high=1e3, unit="m^3")
        check_range(owner, "reach_m", self.reach_m, low=1e-3, high=100.0, unit="m")
        check_range(owner, "trail_m", self.trail_m, low=0.0, high=1e3, unit="m")
        check_range(owner, "trail_radius_m", self.trail_radius_m, low=0.0, high=100.0, unit="m")
        check_range(owner, "steps", self.steps, low=1, high=100_000_000)

    def build(self, context):
        from .potential_field import PotentialFieldPlanner

        return PotentialFieldPlanner(self)
