"""Settings of the tree planners: rrt, rrt_connect, rrt_star, informed_rrt_star."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_choice, check_range

from .shared_config import PlannerSettings


@dataclass
class Rrt(PlannerSettings):
    """Rapidly-exploring random tree (LaValle 1998), by OMPL. Stops at the first path."""

    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = 0.05
    """share of samples that are the goal itself"""
    iterations: int = 20_000
    """samples before the budget is spent"""

    def __post_init__(self):
        _check_tree(self, "rrt")
        check_range("planner.rrt", "goal_bias", self.goal_bias, low=0.0, high=1.0)

    def build(self, context):
        from .tree import TreePlanner, rrt

        return TreePlanner(self, context.rng, rrt)


@dataclass
class RrtConnect(PlannerSettings):
    """RRT-Connect (Kuffner and LaValle 2000): two trees that reach for each other. Stops at the first path."""

    backend: str = "native"
    """native: compiled whole, about five times faster; ompl: the same method by OMPL"""
    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    iterations: int = 10_000
    """samples before the budget is spent"""

    def __post_init__(self):
        _check_tree(self, "rrt_connect")
        check_choice("planner.rrt_connect", "backend", self.backend, ("native", "ompl"))

    def build(self, context):
        if self.backend == "ompl":
            from .tree import TreePlanner, rrt_connect

            return TreePlanner(self, context.rng, rrt_connect)
        from .native_rrt_connect import NativeRrtConnect

        return NativeRrtConnect(self, context.rng)


@dataclass
class RrtStar(PlannerSettings):
    """RRT* (Karaman and Frazzoli 2011), by OMPL: goes on improving until its iterations are used up."""

    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = 0.05
    """share of samples that are the goal itself"""
    iterations: int = 5000
    """samples, all of them used"""
    extensions: int = 4
    """as many samples again, this often, while there is no path: narrow gaps take some seeds longer"""

    def __post_init__(self):
        _check_tree(self, "rrt_star")
        check_range("planner.rrt_star", "extensions", self.extensions, low=0, high=1000)
        check_range("planner.rrt_star", "goal_bias", self.goal_bias, low=0.0, high=1.0)

    def build(self, context):
        from .tree import TreePlanner, rrt_star

        return TreePlanner(self, context.rng, rrt_star)


@dataclass
class InformedRrtStar(PlannerSettings):
    """Informed RRT* (Gammell, Srinivasa, Barfoot 2014), by OMPL: samples only where the path can still get shorter."""

    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = 0.05
    """share of samples that are the goal itself"""
    iterations: int = 5000
    """samples, all of them used"""
    extensions: int = 4
    """as many samples again, this often, while there is no path: narrow gaps take some seeds longer"""

    def __post_init__(self):
        _check_tree(self, "informed_rrt_star")
        check_range("planner.informed_rrt_star", "extensions", self.extensions, low=0, high=1000)
        check_range("planner.informed_rrt_star", "goal_bias", self.goal_bias, low=0.0, high=1.0)

    def build(self, context):
        from .tree import TreePlanner, informed_rrt_star

        return TreePlanner(self, context.rng, informed_rrt_star)


def _check_tree(settings, word: str) -> None:
    owner = f"planner.{word}"
    settings.check(owner)
    check_range(owner, "range_m", settings.range_m, low=0.0, high=1e4, unit="m")
    check_range(owner, "iterations", settings.iterations, low=1, high=10_000_000)
