"""Settings of the tree planners: rrt, rrt_connect, rrt_star, informed_rrt_star."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.contracts import Context, Planner
from rhs.api.errors import one_of, within

from .shared_config import TreeSettings, in_two, repeated, scaled_to


@dataclass
class Rrt(TreeSettings):
    """Rapidly-exploring random tree (LaValle 1998), by OMPL. Stops at the first path."""

    method = "rrt"

    range_m: float = within(0.0, 0.0, 1e4)
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = within(0.05, 0.0, 1.0)
    """share of samples that are the goal itself"""
    iterations: int = within(0, 0, 10_000_000)
    """samples before the budget is spent; 0: three for every free cell, at least 20,000"""

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else in_two(20_000, scaled_to(free_cells, each=3.0, least=20_000))


@dataclass
class RrtConnect(TreeSettings):
    """RRT-Connect (Kuffner and LaValle 2000): two trees that reach for each other. Stops at the first path."""

    preload = ("rhs_planners.native_rrt_connect",)
    method = "rrt_connect"

    backend: str = one_of("native", "ompl")
    """native: compiled whole, about five times faster; ompl: the same method by OMPL"""
    range_m: float = within(0.0, 0.0, 1e4)
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    iterations: int = within(0, 0, 10_000_000)
    """samples before the budget is spent; 0: three for every free cell, at least 10,000"""

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else in_two(10_000, scaled_to(free_cells, each=3.0, least=10_000))

    def build(self, context: Context) -> Planner:
        if self.backend == "ompl":
            return super().build(context)
        from .native_rrt_connect import NativeRrtConnect

        return NativeRrtConnect(self, context.rng)


@dataclass
class RrtStar(TreeSettings):
    """RRT* (Karaman and Frazzoli 2011), by OMPL: goes on improving until its iterations are used up."""

    method = "rrt_star"

    range_m: float = within(0.0, 0.0, 1e4)
    """longest edge; 0 for a fifth of the map's diagonal, OMPL's own choice"""
    goal_bias: float = within(0.05, 0.0, 1.0)
    """share of samples that are the goal itself"""
    iterations: int = within(5000, 1, 10_000_000)
    """samples, all of them used"""
    extensions: int | None = within(None, 0, 10_000)
    """as many samples again, this often, while there is no path: narrow gaps take some seeds longer; null: until there
    were three for every free cell, at least 4 times"""

    def rounds(self, free_cells: int) -> list[int]:
        """The samples of each round: one that is used up, and more for as long as there is no path."""
        if self.extensions is not None:
            return [self.iterations] * (self.extensions + 1)
        return repeated(self.iterations, scaled_to(free_cells, each=3.0, least=5 * self.iterations))

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "extensions", len(rounds) - 1


@dataclass
class InformedRrtStar(RrtStar):
    """Informed RRT* (Gammell, Srinivasa, Barfoot 2014), by OMPL: samples only where the path can still get shorter."""

    method = "informed_rrt_star"
