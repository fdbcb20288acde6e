"""Settings of the planners. Light to import: what plans is loaded when a planner is built."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

from rhs.api.contracts import Context, PartSettings, Planner
from rhs.api.errors import Bounded, one_of, within

FREE_SHARE, MOST_TRIES = 0.25, 100.0  # of a grid, for which FMT*'s 10,000 steps are enough; of them, where less is free


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


@dataclass
class AStar(PlannerSettings):
    """A* over eight neighbours without cutting corners (Hart, Nilsson, Raphael 1968): complete, shortest on the grid."""

    preload = ("rhs_planners.grid_search",)
    any_angle: ClassVar[bool] = False

    expansions: int = within(100_000_000, 1, 10**12)
    """cells taken up before the budget is spent; above any map's number of cells"""

    def build(self, context: Context) -> Planner:
        from .grid_search import GridSearch

        return GridSearch(self)


@dataclass
class ThetaStar(AStar):
    """Theta* (Nash, Daniel, Koenig, Felner 2007): A* whose paths may leave the grid's directions. Complete."""

    any_angle = True


@dataclass
class FastMarchingAdvanced(Bounded):
    """Thresholds of `planner=fast_marching`."""

    slowest: float = within(0.1, 1e-3, 1.0)
    """speed of the wave in a cell beside a wall, when it slows down near walls; 1 in the open"""


@dataclass
class FastMarching(PlannerSettings):
    """Fast marching (Sethian 1996): the time a wave from the goal takes to every cell, a navigation function without
    local minima, descended from the start. Complete. Kept while goal and map stay the same."""

    preload = ("rhs_planners.fast_marching",)

    comfort_m: float = within(0.0, 0.0, 100.0)
    """the wave is slower this near to blocked cells, so paths keep away; 0: shortest paths"""
    advanced: FastMarchingAdvanced = field(default_factory=FastMarchingAdvanced)

    def build(self, context: Context) -> Planner:
        from .fast_marching import FastMarchingPlanner

        return FastMarchingPlanner(self)


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
class RrtStar(Rrt):
    """RRT* (Karaman and Frazzoli 2011), by OMPL: goes on improving until its iterations are used up."""

    method = "rrt_star"

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


@dataclass
class BitStar(TreeSettings):
    """BIT* (Gammell, Srinivasa, Barfoot 2015), by OMPL: best-first search over batches of samples."""

    method = "bit_star"

    batch: int = within(100, 1, 100_000)
    """samples per batch, OMPL's default"""
    iterations: int = within(0, 0, 10_000_000)
    """steps of the search, all of them used; 0: 20,000 (5000 miss the gap of map 4 in two seeds of five), and while
    there is no path as many again, until there were three for every free cell"""

    def rounds(self, free_cells: int) -> list[int]:
        return [self.iterations] if self.iterations else repeated(20_000, scaled_to(free_cells, each=3.0, least=20_000))


@dataclass
class Fmt(TreeSettings):
    """FMT*, fast marching tree (Janson, Schmerling, Clark, Pavone 2015), by OMPL: one batch, one sweep,
    then single samples where the sweep ended before the goal."""

    method = "fmt"

    samples: int = within(2000, 1, 200_000)
    """in the one batch; 1000 miss the narrow passage of map 4 in a fifth of the seeds"""
    iterations: int = within(0, 0, 10_000_000)
    """samples, also those that fall on blocked cells, and steps of the sweep together, before the budget is spent; 0:
    10,000, and while there is no path four times as many for a new batch of twice as many samples, until there were
    three for every free cell; of a grid of which less than a quarter is free as many times more as samples fall on walls"""

    def rounds(self, free_cells: int) -> list[int]:
        rounds = [self.iterations or 10_000]
        while not self.iterations and sum(rounds) < scaled_to(free_cells, each=3.0, least=10_000):
            rounds.append(4 * rounds[-1])
        return rounds

    def tries(self, free_share: float) -> float:
        """The sweep begins when the batch is full, which takes the longer the fewer samples fall on free cells."""
        return 1.0 if self.iterations else min(max(1.0, FREE_SHARE / free_share), MOST_TRIES)
