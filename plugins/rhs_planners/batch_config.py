"""Settings of the planners that sort batches of samples: bit_star, fmt."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rhs.api.errors import check_range

from .shared_config import PlannerSettings, repeated, scaled_to

if TYPE_CHECKING:
    from rhs.api.contracts import Context, Planner


@dataclass
class BitStar(PlannerSettings):
    """BIT* (Gammell, Srinivasa, Barfoot 2015), by OMPL: best-first search over batches of samples."""

    preload = ("rhs_planners.tree",)

    batch: int = 100
    """samples per batch, OMPL's default"""
    iterations: int = 0
    """steps of the search, all of them used; 0: 20,000 (5000 miss the gap of map 4 in two seeds of five), and while
    there is no path as many again, until there were three for every free cell"""

    def __post_init__(self):
        self.check("planner.bit_star")
        check_range("planner.bit_star", "batch", self.batch, low=1, high=100_000)
        check_range("planner.bit_star", "iterations", self.iterations, low=0, high=10_000_000)

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else repeated(20_000, scaled_to(free_cells, each=3.0, least=20_000))

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "iterations", sum(rounds)

    def build(self, context: Context) -> Planner:
        from .tree import TreePlanner, bit_star

        return TreePlanner(self, context.rng, bit_star, logged=True)


@dataclass
class Fmt(PlannerSettings):
    """FMT*, fast marching tree (Janson, Schmerling, Clark, Pavone 2015), by OMPL: one batch, one sweep,
    then single samples where the sweep ended before the goal."""

    preload = ("rhs_planners.tree",)

    samples: int = 2000
    """in the one batch; 1000 miss the narrow passage of map 4 in a fifth of the seeds"""
    iterations: int = 0
    """samples, also those that fall on blocked cells, and steps of the sweep together, before the budget is spent; 0:
    10,000, and while there is no path four times as many for a new batch of twice as many samples, until there were
    three for every free cell"""

    def __post_init__(self):
        self.check("planner.fmt")
        check_range("planner.fmt", "samples", self.samples, low=1, high=200_000)
        check_range("planner.fmt", "iterations", self.iterations, low=0, high=10_000_000)

    def rounds(self, free_cells: int) -> list[int]:
        rounds = [self.iterations or 10_000]
        while not self.iterations and sum(rounds) < scaled_to(free_cells, each=3.0, least=10_000):
            rounds.append(4 * rounds[-1])
        return rounds

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        return "iterations", sum(rounds)

    def build(self, context: Context) -> Planner:
        from .tree import TreePlanner, fmt

        return TreePlanner(self, context.rng, fmt, anew=True)
