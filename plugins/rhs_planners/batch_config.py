"""Settings of the planners that sort batches of samples: bit_star, fmt."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import within

from .shared_config import TreeSettings, repeated, scaled_to

FREE_SHARE, MOST_TRIES = 0.25, 100.0  # of a grid, for which 10,000 steps are enough; of the steps, where less is free


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
