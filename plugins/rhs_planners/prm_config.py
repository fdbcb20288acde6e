"""Settings of the roadmap planners: prm and prm_star."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

from rhs.api.contracts import Context, Planner
from rhs.api.errors import check_choice, check_range, check_ranges

from .shared_config import PlannerSettings, scaled_to


@dataclass
class RoadmapAdvanced:
    """Thresholds of the roadmap planners."""

    other_map_share: float = 0.25
    """more changed cells than this share are another map, not an obstacle: the roadmap is learnt anew"""

    def __post_init__(self) -> None:
        check_ranges("", self, other_map_share=(0.0, 1.0))


@dataclass
class _Roadmap(PlannerSettings):
    _star: ClassVar[bool]
    preload = ("rhs_planners.prm", "rhs_planners.native_roadmap")

    backend: str = "native"
    """native: compiled, learns about eight times faster; ompl: the same method by OMPL"""
    milestones: int = 500
    """vertices learnt once per map; cover 100 x 100 cells with corridors, more are grown when needed"""
    growth: int = 250
    """vertices added when start and goal are not joined yet"""
    growth_rounds: int | None = None
    """how often a query may add them before its budget is spent; null: until there is a vertex for every 20 free
    cells, at least 20 times"""
    links: int = 12
    """vertices in sight that start and goal are joined to"""
    advanced: RoadmapAdvanced = field(default_factory=RoadmapAdvanced)

    def __post_init__(self):
        super().__post_init__()
        check_choice(self.owner, "backend", self.backend, ("native", "ompl"))
        check_ranges(self.owner, self, milestones=(1, 200_000), growth=(1, 200_000), links=(1, 1000))
        if self.growth_rounds is not None:
            check_range(self.owner, "growth_rounds", self.growth_rounds, low=0, high=10_000)

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

    owner, _star = "planner.prm", False


@dataclass
class PrmStar(_Roadmap):
    """PRM* (Karaman and Frazzoli 2011): as prm, with more neighbours per vertex as it grows, to approach the best."""

    owner, _star = "planner.prm_star", True
