"""Where no way is left over ground that was seen, the robot tries what nobody has looked at, as far as it sees."""

from dataclasses import replace

import numpy as np
import pytest
from flatland import Dijkstra, Flatland, Oracle, Through, parts, ring
from test_policies import barrier

from rhs.api.grid import OccupancyGrid
from rhs.api.records import Path, PlanReason
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionAdvanced, MissionSettings
from rhs.patrol.planning import with_unseen
from rhs.patrol.sentinel import Sentinel
from rhs_replan import GoRound

PLACE = (("a", 6.5, 1.0),)
UNSEEN = np.s_[61:79, 30:44]  # a stretch of the corridor at the far side, 1.4 m of it


class Glass(Flatland):
    """With a pane that no beam meets."""

    pane = np.zeros((80, 80), bool)

    def _gap(self, xy):
        seen, self.occupied = self.occupied, self.occupied | self.pane
        gap = super()._gap(xy)
        self.occupied = seen
        return gap


class FromFree(Dijkstra):
    """Sets off from free cells only, and says so."""

    corners = False

    def plan(self, problem):
        x, y = np.floor((problem.start_m - problem.origin_m) / problem.resolution_m).astype(int)
        if problem.blocked[y, x]:
            return Path(PlanReason.START_BLOCKED, np.zeros((0, 2)), np.zeros((0, 2)))
        return super().plan(problem)


def patrol(hidden, *, unseen_m=1.0, pane=None, places=PLACE, unseen=UNSEEN):
    """Missions and events of a ring whose near way is barred, and whose far way the survey saw but for a stretch."""
    world = Glass(ring(), (1.0, 1.0, 0.0), places, hidden=hidden)
    world.pane = world.pane if pane is None else pane
    grid = world.grid()
    probability = grid.probability.copy()
    probability[unseen] = np.nan
    oracle = Oracle(world)
    given = parts(oracle, FromFree())
    given.replan = GoRound()
    settings = MissionSettings(advanced=replace(MissionAdvanced(), unseen_m=unseen_m))
    sentinel = Sentinel(given, replace(grid, probability=probability), (), places=places, radius_m=world.radius,
                        settings=settings)
    out = []
    for step in steps(world, Through(world.camera), oracle, sentinel):
        out.append(step)
        assert len(out) < 2000, "the patrol does not end"
    assert pane is not None or not any(step.collided for step in out)
    return sentinel.book.missions, [str(event) for step in out for event in step.events]


def test_a_stretch_that_nobody_saw_is_driven_where_there_is_no_other_way():
    missions, events = patrol(barrier())
    assert str(missions[-1].status) == "arrived" and events.count("venture") == 1


def test_without_the_setting_the_place_is_given_up():
    missions, events = patrol(barrier(), unseen_m=0.0)
    assert str(missions[-1].status) == "gave_up"
    assert missions[-1].reason == "no path: disconnected, something new stands near (2.6, 1.0) m"
    assert "venture" not in events


def test_a_wall_in_the_unseen_stretch_is_found_untouched_and_the_place_given_up():
    missions, events = patrol(barrier((35, 38)))
    assert str(missions[-1].status) == "gave_up" and events.count("venture") >= 1


def test_who_touched_something_there_does_not_try_again_for_the_next_place():
    pane = barrier((35, 36)) & ~barrier()
    missions, events = patrol(barrier(), pane=pane, places=(*PLACE, ("b", 6.5, 3.0)))
    assert all(str(mission.status) != "arrived" for mission in missions)
    assert events.count("contact") >= 1 and events.count("venture") == 1


def test_places_that_can_be_reached_without_come_first():
    missions, events = patrol(barrier(), places=(*PLACE, ("near", 1.0, 3.0)))
    assert [(m.place, str(m.status)) for m in missions] == [("a", "skipped"), ("near", "arrived"), ("a", "arrived")]
    assert events.count("venture") == 1 and events.index("venture") > events.index("arrived")


def test_who_stands_on_unseen_ground_sets_off_from_it_at_once():
    """Carried to where the survey never looked, none of its places can be reached without: none is given up for it."""
    missions, events = patrol(np.zeros((80, 80), bool), places=(*PLACE, ("b", 1.0, 6.5)), unseen=np.s_[3:18, 3:18])
    assert [str(mission.status) for mission in missions] == ["arrived", "arrived"] and events.count("venture") == 1


def test_nothing_is_ventured_while_a_known_way_is_left():
    missions, events = patrol(np.zeros((80, 80), bool))
    assert str(missions[-1].status) == "arrived" and "venture" not in events


@pytest.mark.parametrize("reach_m, cells", [(0.0, 0), (0.1, 1), (0.3, 3)])
def test_unseen_ground_counts_up_to_its_reach_and_walls_never(reach_m, cells):
    """A row of five free cells, a wall, and five unseen ones at the other end."""
    grid = OccupancyGrid(np.array([[0.95] + 5 * [0.05] + 5 * [np.nan]], np.float32), 0.1, (0.0, 0.0))
    got = with_unseen(grid, grid.free(), reach_m + 1e-6)
    assert got[0, 1:6].all() and not got[0, 0] and got[0, 6:].sum() == cells
