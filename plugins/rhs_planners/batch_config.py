"""Settings of the planners that sort batches of samples: bit_star, fmt."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_range

from .shared_config import PlannerSettings


@dataclass
class BitStar(PlannerSettings):
    """BIT* (Gammell, Srinivasa, Barfoot 2015), by OMPL: best-first search over batches of samples."""

    batch: int = 100
    """samples per batch, OMPL's default"""
    iterations: int = 20_000
    """steps of the search, all of them used; 5000 miss the gap of map 4 in two seeds of five"""

    def __post_init__(self):
        self.check("planner.bit_star")
        check_range("planner.bit_star", "batch", self.batch, low=1, high=100_000)
        check_range("planner.bit_star", "iterations", self.iterations, low=1, high=10_000_000)

    def build(self, context):
        from .tree import TreePlanner, bit_star

        return TreePlanner(self, context.rng, bit_star, logged=True)


@dataclass
class Fmt(PlannerSettings):
    """FMT*, fast marching tree (Janson, Schmerling, Clark, Pavone 2015), by OMPL: one batch, one sweep,
    then single samples where the sweep ended before the goal."""

    samples: int = 2000
    """in the one batch; 1000 miss the narrow passage of map 4 in a fifth of the seeds"""
    iterations: int = 10_000
    """samples and steps of the sweep together, before the budget is spent"""

    def __post_init__(self):
        self.check("planner.fmt")
        check_range("planner.fmt", "samples", self.samples, low=1, high=200_000)
        check_range("planner.fmt", "iterations", self.iterations, low=1, high=10_000_000)

    def build(self, context):
        from .tree import TreePlanner, fmt

        return TreePlanner(self, context.rng, fmt)
