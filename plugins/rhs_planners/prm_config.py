"""Settings of the roadmap planners: prm and prm_star."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

from rhs.api.contracts import Context, Planner
from rhs.api.errors import Bounded, one_of, within

from .shared_config import PlannerSettings, scaled_to


@dataclass
class RoadmapAdvanced(Bounded):
    """Thresholds of the roadmap planners."""

    other_map_share: float = within(0.25, 0.0, 1.0)
    """more changed cells than this share are another map, not an obstacle: the roadmap is learnt anew"""


@dataclass
class _Roadmap(PlannerSettings):
    _star: ClassVar[bool]
    preload = ("rhs_planners.prm", "rhs_planners.native_roadmap")

    backend: str = one_of("native", "ompl")
    """native: compiled, learns about eight times faster; ompl: the same method by OMPL"""
    milestones: int = within(500, 1, 200_000)
    """vertices learnt once per map; cover 100 x 100 cells with corridors, more are grown when needed"""
    growth: int = within(250, 1, 200_000)
    """vertices added when start and goal are not joined yet"""
    growth_rounds: int | None = within(None, 0, 10_000)
    """how often a query may add them before its budget is spent; null: until there is a vertex for every 20 free
    cells, at least 20 times"""
    links: int = within(12, 1, 1000)
    """vertices in sight that start and goal are joined to"""
    advanced: RoadmapAdvanced = field(default_factory=RoadmapAdvanced)

    def rounds(self, free_cells: int) -> int:
        if self.growth_rounds is not None:
            return self.growth_rounds
        return max(20, scaled_to(free_cells, each=0.05, least=0, most=50_000) // self.growth)

    def build(self, context: Context) -> Planner:
        from .prm import RoadmapPlanner

        if self.backend == "ompl":
            from .ompl_roadmap import OmplGrower

            return RoadmapPlanner(self, context.rng, partial(OmplGrower, star=self._star))
        from .native_roadmap import NativeGrower

        return RoadmapPlanner(self, context.rng, partial(NativeGrower, star=self._star))


@dataclass
class Prm(_Roadmap):
    """Probabilistic roadmap (Kavraki, Svestka, Latombe, Overmars 1996), kept for every later query."""

    _star = False


@dataclass
class PrmStar(_Roadmap):
    """PRM* (Karaman and Frazzoli 2011): as prm, with more neighbours per vertex as it grows, to approach the best."""

    _star = True
