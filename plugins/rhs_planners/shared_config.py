"""Settings that every planner has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import Context, PartSettings, Planner
from rhs.api.errors import within


def scaled_to(free_cells: int, *, each: float, least: int, most: int = 1_000_000) -> int:
    """A budget that grows with the map: `each` for every free cell, between `least` and `most`. What a sampling planner
    needs is set by how small a share of the free space its narrowest gate is, and that shrinks as maps grow."""
    return min(max(least, round(each * free_cells)), most)


def in_two(first: int, total: int) -> list[int]:
    """Budgets of a first round and of the rest, before which somebody looks whether there is a way at all."""
    return [first, total - first] if total > first else [total]


def repeated(first: int, total: int) -> list[int]:
    """Budgets of the first round and of as many more as bring their sum to `total`: each begins only if there is no path."""
    return [first] * max(1, -(-total // first))


@dataclass
class PlannerSettings(PartSettings):
    """What all planners of this package share; see problem.begin."""

    preload: ClassVar[tuple[str, ...]]

    start_radius_m: float = within(0.3, 0.0, 10.0)
    """a start in a blocked cell is set off to a free one this near; one robot radius"""


@dataclass
class TreeSettings(PlannerSettings):
    """Of OMPL's planners, see tree.py. `rounds(free_cells)`: the steps that each round of the search may take."""

    preload = ("rhs_planners.tree",)
    method: ClassVar[str]  # which of tree.py makes the planner

    def tries(self, free_share: float) -> float:
        """By how much more steps are allowed where this share of the grid is free."""
        return 1.0

    def knob(self, rounds: list[int]) -> tuple[str, int]:
        """The setting that bounds the search, and the number it stands for."""
        return "iterations", sum(rounds)

    def build(self, context: Context) -> Planner:
        from . import tree

        return tree.TreePlanner(self, context.rng, getattr(tree, self.method))
