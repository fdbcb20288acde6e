"""Planted bugs: each of these planners has one, and the card names it; ours have none."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from rhs.api.records import Path, PlanReason
from rhs.card.forked import run_forked
from rhs.card.planners import FAULTS, answers
from rhs.card.questions import questions
from rhs.config import registry

NONE = np.empty((0, 2))
ASKED = list(questions(of_each=3))


class Right:
    """Exact search over cells (our own planner), which the buggy ones spoil."""

    def __init__(self, context):
        self.exact = registry.load("planner", "astar")().build(context)

    def plan(self, problem):
        return self.spoil(self.exact.plan(self.read(problem)), problem)

    def read(self, problem):
        return problem

    def spoil(self, path, problem):
        return path


def with_points(path, points):
    return replace(path, points_m=points, raw_m=points)


class CutsCorners(Right):
    """Keeps every third point."""

    def spoil(self, path, problem):
        points = path.points_m
        return with_points(path, np.vstack([points[:1], points[1:-1:2], points[-1:]])) if len(points) > 4 else path


class BetweenCorners(Right):
    """Slips through where cells meet corner to corner: it thins walls that are only diagonal."""

    def plan(self, problem):
        return slip(problem)


class OffByOne(Right):
    """Reads the map one column beside."""

    def read(self, problem):
        blocked = np.roll(problem.blocked, 1, axis=1)
        blocked[:, 0] = False
        return replace(problem, blocked=blocked)


class ForgetsTheLastRow(Right):
    """A loop that ends one row and one column early."""

    def read(self, problem):
        blocked = np.array(problem.blocked)
        blocked[-1] = blocked[:, -1] = False
        return replace(problem, blocked=blocked)


class NanGoal(Right):
    """Ends at a goal that is no number."""

    def spoil(self, path, problem):
        points = np.array(path.points_m)
        points[-1:] = np.nan
        return with_points(path, points)


class NanInNanOut(Right):
    """Takes a goal that is no number for a place."""

    def plan(self, problem):
        if not np.isfinite(problem.goal_m).all():
            return Path(PlanReason.OK, np.stack([problem.start_m, problem.goal_m]), NONE)
        return super().plan(problem)


class ThroughWalls(Right):
    """The straight line, always."""

    def spoil(self, path, problem):
        return with_points(path, np.stack([problem.start_m, problem.goal_m])) if path.found else path


class NotFromTheStart(Right):
    """Begins in the middle of the start's cell."""

    def spoil(self, path, problem):
        return with_points(path, path.points_m[1:]) if len(path.points_m) > 2 else path


class StopsShort(Right):
    """An approximate path is a success for it."""

    def spoil(self, path, problem):
        return with_points(path, path.points_m[:-1]) if len(path.points_m) > 2 else path


class Dice(Right):
    """Draws from the machine's randomness."""

    def spoil(self, path, problem):
        if len(path.points_m) < 2:
            return path
        a, b = path.points_m[:2]
        return with_points(path, np.insert(path.points_m, 1, a + (b - a) * (0.1 + os.urandom(1)[0] / 300.0), axis=0))


class Scribbles(Right):
    """Marks the goal in the map that it was given."""

    def spoil(self, path, problem):
        problem.blocked[0, 0] ^= True
        return path


class GivesUp(Right):
    """Says that there is no way when it is far."""

    def spoil(self, path, problem):
        return path if len(path.points_m) < 20 else Path(PlanReason.DISCONNECTED, NONE, NONE)


class OldMap(Right):
    """Keeps the first map it saw of this size."""

    kept = None

    def read(self, problem):
        if self.kept is None or self.kept.shape != problem.blocked.shape:
            self.kept = np.array(problem.blocked)
        return replace(problem, blocked=self.kept)


class Raises(Right):
    """Raises where there is no way."""

    def spoil(self, path, problem):
        if path.reason is PlanReason.DISCONNECTED:
            raise RuntimeError("no way")
        return path


class Seeds(Right):
    """Seeds numpy for everybody."""

    def read(self, problem):
        np.random.seed(0)  # noqa: NPY002 - the bug
        return problem


class Shrugs(Right):
    """One reason for everything."""

    def spoil(self, path, problem):
        return path if path.found else replace(path, reason=PlanReason.START_BLOCKED)


class Hangs(Right):
    """Searches for ever where there is no way."""

    def spoil(self, path, problem):
        while path.reason is PlanReason.DISCONNECTED:
            time.sleep(0.05)
        return path


def slip(problem):
    """Breadth first over eight neighbours, diagonals without a look at what they pass between."""
    blocked, step, origin = problem.blocked, problem.resolution_m, np.asarray(problem.origin_m)
    ends = [np.asarray(end) for end in (problem.start_m, problem.goal_m)]
    last = origin + step * np.array(blocked.shape[::-1])
    if not all(np.isfinite(end).all() and (end >= origin).all() and (end < last).all() for end in ends):
        return Path(PlanReason.OUTSIDE, NONE, NONE)
    start, goal = (tuple(int(v) for v in np.floor((end - origin) / step)[::-1]) for end in ends)
    for cell, reason in ((start, PlanReason.START_BLOCKED), (goal, PlanReason.GOAL_BLOCKED)):
        if blocked[cell]:
            return Path(reason, NONE, NONE)
    came, queue = {start: start}, [start]
    for cell in queue:
        for dr, dc in ((0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)):
            near = cell[0] + dr, cell[1] + dc
            if near in came or not (0 <= near[0] < blocked.shape[0] and 0 <= near[1] < blocked.shape[1]) or blocked[near]:
                continue
            if (dr and dc) and blocked[cell[0] + dr, cell[1]] != blocked[cell[0], cell[1] + dc]:
                continue  # that corner it sees
            came[near] = cell
            queue.append(near)
    if goal not in came:
        return Path(PlanReason.DISCONNECTED, NONE, NONE)
    cells = [goal]
    while cells[-1] != start:
        cells.append(came[cells[-1]])
    points = (np.array(cells[::-1])[:, ::-1] + 0.5) * step + origin
    points = np.vstack([ends[0], points, ends[1]])
    return Path(PlanReason.OK, points, points)


PLANTED = {CutsCorners: "cuts_corners", BetweenCorners: "between_corners", OffByOne: "off_by_one",
           ForgetsTheLastRow: "off_by_one", NanGoal: "not_finite", NanInNanOut: "takes_nan", ThroughWalls: "through_walls",
           NotFromTheStart: "wrong_start", StopsShort: "wrong_goal", Dice: "same_seed_other_path",
           Scribbles: "writes_to_the_problem", GivesUp: "denies_a_way", OldMap: "remembers_another_map", Raises: "raises",
           Seeds: "global_randomness", Shrugs: "wrong_reason", Hangs: "no_answer"}


@dataclass
class Settings:
    """A planner of this file."""

    cls: Any = Right

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        return self.cls(context)


def faults_found(cls) -> set[str]:
    result = run_forked(lambda: answers(Settings(cls), ASKED), patience_s=5.0 if cls is Hangs else 60.0)
    found = {fault for answer in result.items for fault in answer.faults}
    return found | ({"no_answer"} if result.ended else set())


@pytest.mark.parametrize("cls", PLANTED, ids=lambda cls: cls.__name__)
def test_a_planted_bug_is_found_and_named(cls):
    assert PLANTED[cls] in faults_found(cls)
    assert PLANTED[cls] in FAULTS


def test_seeding_what_was_seeded_alike_before_is_found_too():
    """The planted seed 0 went unseen wherever somebody had seeded with 0 last."""
    state = np.random.get_state()  # noqa: NPY002
    np.random.seed(0)  # noqa: NPY002
    seeded = np.random.get_state()[1].copy()  # noqa: NPY002
    try:
        assert "global_randomness" in faults_found(Seeds)
        assert (np.random.get_state()[1] == seeded).all()  # noqa: NPY002 - the check itself leaves it alone
    finally:
        np.random.set_state(state)  # noqa: NPY002


@pytest.mark.parametrize("name", ["astar", "theta_star", "prm", "potential_field"])
def test_ours_have_none(name):
    result = run_forked(lambda: answers(registry.load("planner", name)(), ASKED), patience_s=60.0)
    assert not result.ended and not [answer.name for answer in result.items if answer.faults]
    assert len(result.items) > len(ASKED) + 6 and result.cpu_s > 0


def test_what_makes_up_the_questions_stays():
    """Anybody's card is made of the same questions: half of those across a wall have no way, and nothing moves from a run to
    another."""
    again = list(questions(of_each=3))
    assert [one.name for one in again] == [one.name for one in ASKED]
    assert all(np.array_equal(one.problem.blocked, other.problem.blocked)
               and np.array_equal(one.problem.goal_m, other.problem.goal_m) for one, other in zip(again, ASKED, strict=True))
    everything = list(questions())
    closed = [one for one in everything if one.name.startswith(("closed", "diagonals"))]
    assert len(everything) == 70 and 6 <= sum(np.isnan(one.optimal_m) for one in closed) <= 14
