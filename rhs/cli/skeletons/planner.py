"""A planner for rhs."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rhs.api import Bounded, within
from rhs.api.contracts import Context
from rhs.api.records import Path, PlanningProblem, PlanReason

Cell = tuple[int, int]  # column, row


@dataclass
class Skeleton(Bounded):
    """Breadth-first search over the cells."""

    most_cells: int = within(1_000_000, 1, 1_000_000_000)
    """cells that are looked at before it gives up"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: Context) -> Part:
        return Part(self, context.rng)


class Part:
    """Built anew for every run; randomness comes from `rng` alone."""

    def __init__(self, settings: Skeleton, rng: np.random.Generator) -> None:
        self.settings, self.rng = settings, rng

    def plan(self, problem: PlanningProblem) -> Path:
        """Cell by cell from the start, to the four neighbours, until the goal is reached."""
        origin, side = np.array(problem.origin_m), problem.resolution_m
        ends = np.floor((np.array([problem.start_m, problem.goal_m]) - origin) / side)[:, ::-1]  # row, column
        for cell, blocked in zip(ends, (PlanReason.START_BLOCKED, PlanReason.GOAL_BLOCKED), strict=True):
            if not ((cell >= 0) & (cell < problem.blocked.shape)).all():  # of NaN neither is true
                return Path(PlanReason.OUTSIDE, np.empty((0, 2)))
            if problem.blocked[tuple(cell.astype(int))]:
                return Path(blocked, np.empty((0, 2)))
        first, last = (tuple(cell) for cell in ends.astype(int).tolist())
        before, reason = self._search(problem.blocked, first, last)
        if reason is not PlanReason.OK:
            return Path(reason, np.empty((0, 2)))
        cells = [last]
        while cells[-1] != first:
            cells.append(before[cells[-1]])
        centres = origin + (np.array(cells[::-1])[:, ::-1] + 0.5) * side
        return Path(PlanReason.OK, np.vstack([problem.start_m, centres, problem.goal_m]))

    def _search(self, blocked: np.ndarray, first: Cell, last: Cell) -> tuple[dict[Cell, Cell], PlanReason]:
        """The cell before each cell that was reached, and how it ended."""
        before, waiting = {first: first}, deque([first])
        while waiting and last not in before:
            if len(before) > self.settings.most_cells:
                return before, PlanReason.BUDGET_SPENT
            row, column = waiting.popleft()
            for cell in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
                inside = 0 <= cell[0] < blocked.shape[0] and 0 <= cell[1] < blocked.shape[1]
                if inside and not blocked[cell] and cell not in before:
                    before[cell] = (row, column)
                    waiting.append(cell)
        return before, PlanReason.OK if last in before else PlanReason.DISCONNECTED
