"""Settings of the tree planners: rrt, rrt_connect, rrt_star, informed_rrt_star."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import check_choice, check_range

from .shared_config import PlannerSettings, in_two, repeated, scaled_to

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Planner


@dataclass
class Rrt(PlannerSettings):
    """Rapidly-exploring random tree (LaValle 1998), by OMPL. Stops at the first path."""

    preload = ("rhs_planners.tree",)

    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = 0.05
    """share of samples that are the goal itself"""
    iterations: int = 0
    """samples before the budget is spent; 0: three for every free cell, at least 20,000"""

    def __post_init__(self):
        _check_first(self, "rrt")
        check_range("planner.rrt", "goal_bias", self.goal_bias, low=0.0, high=1.0)

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else in_two(20_000, scaled_to(free_cells, each=3.0, least=20_000))

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "iterations", sum(rounds)

    def build(self, context: Context) -> Planner:
        from .tree import TreePlanner, rrt

        return TreePlanner(self, context.rng, rrt)


@dataclass
class RrtConnect(PlannerSettings):
    """RRT-Connect (Kuffner and LaValle 2000): two trees that reach for each other. Stops at the first path."""

    preload = ("rhs_planners.native_rrt_connect",)

    backend: str = "native"
    """native: compiled whole, about five times faster; ompl: the same method by OMPL"""
    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    iterations: int = 0
    """samples before the budget is spent; 0: three for every free cell, at least 10,000"""

    def __post_init__(self):
        _check_first(self, "rrt_connect")
        check_choice("planner.rrt_connect", "backend", self.backend, ("native", "ompl"))

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else in_two(10_000, scaled_to(free_cells, each=3.0, least=10_000))

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "iterations", sum(rounds)

    def build(self, context: Context) -> Planner:
        if self.backend == "ompl":
            from .tree import TreePlanner, rrt_connect

            return TreePlanner(self, context.rng, rrt_connect)
        from .native_rrt_connect import NativeRrtConnect

        return NativeRrtConnect(self, context.rng)


@dataclass
class RrtStar(PlannerSettings):
    """RRT* (Karaman and Frazzoli 2011), by OMPL: goes on improving until its iterations are used up."""

    preload = ("rhs_planners.tree",)
    word: ClassVar[str] = "rrt_star"

    range_m: float = 0.0
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = 0.05
    """share of samples that are the goal itself"""
    iterations: int = 5000
    """samples, all of them used"""
    extensions: int | None = None
    """as many samples again, this often, while there is no path: narrow gaps take some seeds longer; null: until there
    were three for every free cell, at least 4 times"""

    def __post_init__(self):
        _check_star(self, self.word)
        check_range(f"planner.{self.word}", "goal_bias", self.goal_bias, low=0.0, high=1.0)

    def rounds(self, free_cells: int) -> list[int]:
        return extended(self.iterations, self.extensions, free_cells)

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "extensions", len(rounds) - 1

    def build(self, context: Context) -> Planner:
        from .tree import TreePlanner, rrt_star

        return TreePlanner(self, context.rng, rrt_star)


@dataclass
class InformedRrtStar(RrtStar):
    """Informed RRT* (Gammell, Srinivasa, Barfoot 2014), by OMPL: samples only where the path can still get shorter."""

    word: ClassVar[str] = "informed_rrt_star"

    def build(self, context: Context) -> Planner:
        from .tree import TreePlanner, informed_rrt_star

        return TreePlanner(self, context.rng, informed_rrt_star)


def _check_tree(settings, word: str) -> None:
    owner = f"planner.{word}"
    settings.check(owner)
    check_range(owner, "range_m", settings.range_m, low=0.0, high=1e4, unit="m")


def _check_first(settings, word: str) -> None:
    """Of a tree that stops at the first path."""
    _check_tree(settings, word)
    check_range(f"planner.{word}", "iterations", settings.iterations, low=0, high=10_000_000)


def _check_star(settings, word: str) -> None:
    """Of a tree that goes on improving."""
    _check_tree(settings, word)
    check_range(f"planner.{word}", "iterations", settings.iterations, low=1, high=10_000_000)
    if settings.extensions is not None:
        check_range(f"planner.{word}", "extensions", settings.extensions, low=0, high=10_000)


def extended(iterations: int, extensions: int | None, free_cells: int) -> list[int]:
    """The samples of each round: one that is used up, and more for as long as there is no path."""
    if extensions is not None:
        return [iterations] * (extensions + 1)
    return repeated(iterations, scaled_to(free_cells, each=3.0, least=5 * iterations))
