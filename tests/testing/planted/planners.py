"""Planners that search breadth first over cell centres, right and wrong."""

from __future__ import annotations

import random
from collections import deque
from dataclasses import replace

import numpy as np

from rhs.api.records import Path, PlanReason

from . import settings

NONE = np.empty((0, 2))


class Honest:
    """Breadth first over the four neighbours of a cell; the ends are exact."""

    def __init__(self, context):
        self.rng = context.rng

    def plan(self, problem):
        reason, cells = self.search(problem)
        points = self.metres(problem, cells) if reason is PlanReason.OK else NONE
        return Path(reason, points, points)

    def search(self, problem):
        blocked = self.map(problem)
        start, goal = self.cell(problem, problem.start_m), self.cell(problem, problem.goal_m)
        if not (self.inside(blocked, start) and self.inside(blocked, goal)):
            return PlanReason.OUTSIDE, []
        if blocked[start] or blocked[goal]:
            return PlanReason.START_BLOCKED if blocked[start] else PlanReason.GOAL_BLOCKED, []
        came, queue = {start: start}, deque([start])
        while queue and goal not in came:
            row, column = at = queue.popleft()
            for step in self.steps(row, column):
                if step not in came and self.inside(blocked, step) and not blocked[step]:
                    came[step] = at
                    queue.append(step)
        if goal not in came:
            return PlanReason.DISCONNECTED, []
        cells = [goal]
        while cells[-1] != start:
            cells.append(came[cells[-1]])
        return PlanReason.OK, cells[::-1]

    def map(self, problem):
        return problem.blocked

    def steps(self, row, column):
        return [(row, column + 1), (row + 1, column), (row, column - 1), (row - 1, column)]

    def cell(self, problem, point):
        column, row = np.floor((point - problem.origin_m) / problem.resolution_m).astype(int)
        return int(row), int(column)

    def inside(self, blocked, cell):
        return 0 <= cell[0] < blocked.shape[0] and 0 <= cell[1] < blocked.shape[1]

    def metres(self, problem, cells):
        centres = (np.array(cells)[:, ::-1] + 0.5) * problem.resolution_m + problem.origin_m
        return np.vstack([problem.start_m, centres, problem.goal_m])


class StepsOut(Honest):
    """Leaves an obstacle that the start stands in by the nearest free cell, if that is near."""

    def search(self, problem):
        reason, cells = super().search(problem)
        if reason is not PlanReason.START_BLOCKED:
            return reason, cells
        gaps = np.argwhere(~problem.blocked) - self.cell(problem, problem.start_m)
        nearest = gaps[np.argmin(np.hypot(*gaps.T))]
        if np.hypot(*nearest) > 3:
            return reason, cells
        moved = problem.start_m + nearest[::-1] * problem.resolution_m
        return super().search(replace(problem, start_m=moved))


class Random(Honest):
    """Tries the neighbours in an order of its own generator."""

    def steps(self, row, column):
        steps = super().steps(row, column)
        return [steps[k] for k in self.rng.permutation(4)]


class Short(Honest):
    """Stops ten centimetres on."""
    says = "the path's last point"

    def metres(self, problem, cells):
        return super().metres(problem, cells)[:2]


class Approximate(Honest):
    """Ends at the middle of the goal's cell."""
    says = "the path's last point"

    def metres(self, problem, cells):
        return super().metres(problem, cells)[:-1]


class GoalMoved(Honest):
    """Goes to a place beside the goal."""
    says = "the path's last point"

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        points[-1] += 0.01
        return points


class StartMoved(Honest):
    """Begins at the middle of the first cell."""
    says = "the path's first point"

    def metres(self, problem, cells):
        return super().metres(problem, cells)[1:] + 1e-6


class FromGoalToStart(Honest):
    """The path the other way round."""
    says = "the path's first point"

    def metres(self, problem, cells):
        return super().metres(problem, cells)[::-1]


class Cells(Honest):
    """Points in cells."""
    says = "the path's first point"

    def metres(self, problem, cells):
        return np.array(cells, float)


class Exchanged(Honest):
    """y before x."""
    says = "the path's first point"

    def metres(self, problem, cells):
        return super().metres(problem, cells)[:, ::-1]


class Straight(Honest):
    """Straight through everything."""
    says = "a path over free cells"

    def metres(self, problem, cells):
        return np.stack([problem.start_m, problem.goal_m])


class StraightAlways(Honest):
    """Straight, without a look at the map."""
    says = "a path over free cells"

    def search(self, problem):
        return PlanReason.OK, [(0, 0)]

    def metres(self, problem, cells):
        return np.stack([problem.start_m, problem.goal_m])


class ForgetsLastObstacle(Honest):
    """The last blocked cell of the map is free for it."""
    says = "a path over free cells"

    def map(self, problem):
        blocked = problem.blocked.copy()
        where = np.argwhere(blocked)
        if len(where):
            blocked[tuple(where[-1])] = False
        return blocked


class ForgetsFirstObstacle(Honest):
    """The first blocked cell of the map is free for it."""
    says = "a path over free cells"

    def map(self, problem):
        blocked = problem.blocked.copy()
        where = np.argwhere(blocked)
        if len(where):
            blocked[tuple(where[0])] = False
        return blocked


class ForgetsLastColumn(Honest):
    """A loop one column short."""
    says = "a path over free cells"

    def map(self, problem):
        blocked = problem.blocked.copy()
        blocked[:, -1] = False
        return blocked


class Diagonal(Honest):
    """Slips between cells that meet corner to corner."""
    says = "a path over free cells"

    def steps(self, row, column):
        return [*super().steps(row, column), (row + 1, column + 1), (row - 1, column - 1), (row + 1, column - 1),
                (row - 1, column + 1)]


class Skips(Honest):
    """Takes every tenth point."""
    says = "a path over free cells"

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        return np.vstack([points[0], points[1:-1:10], points[-1]])


class Transposed(Honest):
    """Reads the map with rows and columns exchanged."""
    says = "outside_map"

    def map(self, problem):
        return problem.blocked.T


class Flipped(Honest):
    """Row 0 is the greatest y for it."""
    says = "a path over free cells"

    def map(self, problem):
        return problem.blocked[::-1]


class NoOrigin(Honest):
    """Takes the corner of the map for the origin."""
    says = "outside_map"

    def cell(self, problem, point):
        return super().cell(replace(problem, origin_m=(0.0, 0.0)), point)


class TenCentimetres(Honest):
    """Every cell is a decimetre."""
    says = "a path over free cells"

    def search(self, problem):
        return super().search(replace(problem, resolution_m=0.1))


class WrapsRound(Honest):
    """Beyond the last column comes the first."""
    says = "a path over free cells"

    def steps(self, row, column):
        return [(row, (column + 1) % 40), (row + 1, column), (row, column - 1), (row - 1, column)] + (
            [(row, 39)] if column == 0 else [])


class NoneInstead(Honest):
    """Returns None where there is no way."""
    says = "expected a Path"

    def plan(self, problem):
        path = super().plan(problem)
        return path if path.found else None


class Raises(Honest):
    """Raises where there is no way."""
    says = "RuntimeError"

    def plan(self, problem):
        path = super().plan(problem)
        if not path.found:
            raise RuntimeError("no way")
        return path


class PointsAlone(Honest):
    """Returns an array."""
    says = "expected a Path"

    def plan(self, problem):
        return super().plan(problem).points_m


class NanInside(Honest):
    """A NaN in the middle of the path."""
    says = "not finite"

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        points[len(points) // 2] = np.nan
        return points


class Spatial(Honest):
    """Points with a height."""
    says = "Nx2"

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        return np.column_stack([points, np.zeros(len(points))])


class Endless(Honest):
    """A hundred thousand points and more."""
    says = "at most 100000"

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        return np.vstack([points, np.repeat(points[-1:], 200_000, axis=0)])


class FoundWithoutPoints(Honest):
    """Ok, and nothing."""
    says = "0 points"

    def plan(self, problem):
        return replace(super().plan(problem), points_m=NONE)


class PointsWithoutFound(Honest):
    """Half a way, and the reason why it is not whole."""
    says = "points; expected none"

    def plan(self, problem):
        path = super().plan(problem)
        return path if path.found else replace(path, points_m=np.stack([problem.start_m, problem.goal_m]))


class WrongReason(Honest):
    """Whatever it is, it is the budget."""
    says = "reason is budget_spent"

    def plan(self, problem):
        path = super().plan(problem)
        return path if path.found else replace(path, reason=PlanReason.BUDGET_SPENT)


class OutsideIsUnreachable(Honest):
    """A goal outside the map cannot be reached."""
    says = "expected outside_map"

    def plan(self, problem):
        path = super().plan(problem)
        return replace(path, reason=PlanReason.DISCONNECTED) if path.reason is PlanReason.OUTSIDE else path


class StartForGoal(Honest):
    """Calls a blocked goal a blocked start."""
    says = "expected goal_blocked"

    def plan(self, problem):
        path = super().plan(problem)
        return replace(path, reason=PlanReason.START_BLOCKED) if path.reason is PlanReason.GOAL_BLOCKED else path


class Text(Honest):
    """The reason as a text."""
    says = "a PlanReason"

    def plan(self, problem):
        return replace(super().plan(problem), reason="ok")


class NegativeIndex(Honest):
    """A point left of the map is at its right."""
    says = "IndexError"

    def inside(self, blocked, cell):
        return cell[0] < blocked.shape[0] and cell[1] < blocked.shape[1]


class SamePointFails(Honest):
    """Start and goal may not be one."""
    says = "start and goal are one point"

    def search(self, problem):
        if np.array_equal(problem.start_m, problem.goal_m):
            return PlanReason.DISCONNECTED, []
        return super().search(problem)


class GivesUp(Honest):
    """Its budget is three cells round the start."""
    says = "no plan across an empty room"

    def search(self, problem):
        reason, cells = super().search(problem)
        return (PlanReason.BUDGET_SPENT, []) if len(cells) > 3 else (reason, cells)


class GivesUpAtWalls(Honest):
    """Its budget is the straight way and a little."""
    says = "ways through an opening"

    def search(self, problem):
        reason, cells = super().search(problem)
        straight = np.abs(problem.goal_m - problem.start_m).sum() / problem.resolution_m
        return (PlanReason.BUDGET_SPENT, []) if len(cells) > 1.2 * straight + 3 else (reason, cells)


class Shared(Honest):
    """Draws from numpy's global generator."""
    says = "numpy's global generator"

    def steps(self, row, column):
        steps = super().steps(row, column)
        np.random.shuffle(steps)  # noqa: NPY002
        return steps


class Dice(Honest):
    """Draws from Python's global generator."""
    says = "Python's global generator"

    def steps(self, row, column):
        return random.sample(super().steps(row, column), 4)


class Seeds(Honest):
    """Seeds everybody's generator."""
    says = "numpy's global generator"

    def search(self, problem):
        np.random.seed(1)  # noqa: NPY002
        return super().search(problem)


class Drunk(Honest):
    """Different at every run."""
    says = "planned differently"

    def __init__(self, context):
        self.rng = np.random.default_rng()

    def steps(self, row, column):
        steps = super().steps(row, column)
        return [steps[k] for k in self.rng.permutation(4)]


class LearnsOnce(Honest):
    """Keeps the first map it ever saw."""
    says = "a path over free cells"
    first = None

    def map(self, problem):
        self.first = problem.blocked if self.first is None else self.first
        return self.first


class LearnsByShape(Honest):
    """Knows a map by its size."""
    says = "a path over free cells"

    def __init__(self, context):
        super().__init__(context)
        self.known = {}

    def map(self, problem):
        return self.known.setdefault(problem.blocked.shape, problem.blocked)


class Remembers(Honest):
    """Knows a map and returns the path it found there, whatever start and goal are."""
    says = "the path's first point"

    def __init__(self, context):
        super().__init__(context)
        self.known = {}

    def plan(self, problem):
        key = problem.blocked.tobytes()
        if key not in self.known:
            self.known[key] = super().plan(problem)
        return self.known[key]


class OneBuffer(Honest):
    """Writes every path into one array."""
    says = "a path it returned changed"

    def __init__(self, context):
        super().__init__(context)
        self.buffer = np.zeros((4000, 2))

    def metres(self, problem, cells):
        points = super().metres(problem, cells)
        self.buffer[:len(points)] = points
        return self.buffer[:len(points)]


class Vandal(Honest):
    """Writes what it visited into the map."""
    says = "it wrote to an array it was given"

    def map(self, problem):
        problem.blocked.setflags(write=True)
        problem.blocked[0, 0] = True
        return problem.blocked


class MovesTheGoal(Honest):
    """Moves the goal to the middle of its cell and goes there."""
    says = "it wrote to an array it was given"

    def plan(self, problem):
        problem.goal_m.setflags(write=True)
        problem.goal_m[:] += 0.01
        return super().plan(problem)


class Instant(Honest):
    """Minus five milliseconds."""
    says = "milliseconds"

    def plan(self, problem):
        return replace(super().plan(problem), plan_ms=-5.0)


class Talkative(Honest):
    """Details that are texts."""
    says = "a number by a name"

    def plan(self, problem):
        return replace(super().plan(problem), details={"how": "breadth first"})


class ThroughTheObstacle(Honest):
    """A start inside an obstacle: right through it, to the other side."""
    says = "expected start_blocked"

    def search(self, problem):
        reason, cells = super().search(problem)
        return (PlanReason.OK, []) if reason is PlanReason.START_BLOCKED else (reason, cells)

    def metres(self, problem, cells):
        return super().metres(problem, cells) if cells else np.stack([problem.start_m, problem.goal_m])


RIGHT = (StepsOut, Random)
HONEST = {part.__name__: settings(part) for part in (Honest, *RIGHT)}
PLANTED = {part.__name__: (settings(part), part.says) for part in Honest.__subclasses__() if part not in RIGHT}
