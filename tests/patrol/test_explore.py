"""A robot that nobody leads: what it sees, where it stops and why, and that it never drives where nobody has looked."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flatland import Dijkstra, Flatland, Oracle, Through
from scipy.ndimage import binary_dilation

from rhs.api.errors import ConfigError
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Event, Path, PlanReason, Twist
from rhs.cli.main import main
from rhs.metrics.explore import explored_share, floor_within_reach
from rhs.patrol.explore import PLANAR, Explorer, measured_anew, summary
from rhs.patrol.frontiers import ExploreSettings, Frontiers, Look
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionAdvanced, MissionSettings
from rhs_mappers.occupancy import OccupancyMapper
from rhs_mappers.occupancy_config import Occupancy

START = (1.5, 1.5, 0.0)
MATCH_M = 0.05  # half a cell: a scan is laid onto the map


class Roads(Dijkstra):
    """Dijkstra from the nearest open cell, as the planners that come with the program do."""

    def plan(self, problem):
        cell = np.floor((problem.start_m - problem.origin_m) / problem.resolution_m).astype(int)[::-1]
        open_ = np.argwhere(~problem.blocked)
        near = open_[np.argmin(np.linalg.norm(open_ - cell, axis=1))]
        blocked = problem.blocked.copy()
        blocked[tuple(cell)] = False
        line = np.linspace(cell, near, 20).round().astype(int)
        blocked[line[:, 0], line[:, 1]] = False
        path = super().plan(SimpleNamespace(blocked=blocked, origin_m=problem.origin_m, start_m=problem.start_m,
                                            goal_m=problem.goal_m, resolution_m=problem.resolution_m))
        if path.reason is PlanReason.OK and len(path.points_m) == 1:
            points = np.array([problem.start_m, problem.goal_m])
            return Path(PlanReason.OK, points, points)
        return path


def house(doors: bool = True) -> np.ndarray:
    """Occupied cells of 8 m by 6 m: a hall, and two rooms behind doors of 1 m."""
    occupied = np.zeros((60, 80), bool)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[30, :] = True
    occupied[30:, 40] = True
    if doors:
        occupied[30, 15:25] = False
        occupied[30, 55:65] = False
    return occupied


class Nowhere(Roads):
    """A planner that finds no way to anywhere, and is not asked for ever."""

    asked = 0

    def plan(self, problem):
        self.asked += 1
        assert self.asked < 1000, "one decision asks for ever"
        return Path(PlanReason.DISCONNECTED, np.zeros((0, 2)), np.zeros((0, 2)))


def explore(world, *, limit=1500, visit=(), planner=None, explorer=Explorer, **settings):
    """(explorer, steps) of a survey that ended by itself."""
    parts = SimpleNamespace(source=world, mapper=OccupancyMapper(Occupancy(), world.facts.bounds_m),
                            planner=planner or Roads(), localiser=None, replan=None, slam=None, who=None)
    mission = MissionSettings(turn="pivot", advanced=MissionAdvanced(explore=ExploreSettings(**settings)))
    explorer = explorer(parts, mission, visit=visit)
    out = []
    for step in steps(world, Through(world.camera), Oracle(world), explorer):
        out.append(step)
        assert len(out) < limit, "the survey does not end"
    return explorer, out


def seen(explorer, world) -> float:
    true = world.grid()
    return explored_share(explorer._drawn(), true, floor_within_reach(true, np.array(START[:2]), world.radius))


@pytest.fixture(scope="module")
def whole():
    """(world, explorer, steps) of the house explored."""
    world = Flatland(house(), START, ())
    return (world, *explore(world))


def test_two_rooms_behind_doors_are_seen_whole_and_the_robot_comes_home(whole):
    world, explorer, out = whole
    assert explorer.stop == "no frontier" and seen(explorer, world) > 0.98
    assert np.linalg.norm(out[-1].truth[:2, 3] - START[:2]) <= explorer.settings.arrive_m + MATCH_M
    assert not any(step.collided for step in out)
    assert {step.phase for step in out} == {"survey"} and {step.mission for step in out} == {0}


def test_in_a_closed_room_nothing_is_left_after_a_look_round():
    occupied = house(doors=False)
    explorer, out = explore(Flatland(occupied, START, ()))
    assert explorer.stop == "no frontier"
    assert np.isnan(explorer._drawn().probability[35:, 5:]).all(), "nobody has seen the rooms behind the wall"


def test_viewpoints_to_which_no_plan_leads_are_not_chosen_for_ever():
    explorer, out = explore(Flatland(house(), START, ()), planner=Nowhere())
    assert explorer.stop.startswith("no frontier") and len(out) < 200


def test_what_nobody_saw_beside_a_robot_is_free_only_where_no_plan_leads_away(whole):
    _, explorer, _ = whole
    assert not explorer.hemmed_in
    stuck, _ = explore(Flatland(house(), START, ()), planner=Nowhere())
    assert stuck.hemmed_in
    stuck.mapper.reset()  # nobody saw anything
    freed = stuck.grid.centres(np.argwhere(stuck._drawn().free())) - START[:2]
    beside_m = stuck.radius_m + stuck.settings.margin_m
    assert beside_m < np.linalg.norm(freed, axis=1).max() < beside_m + 2 * stuck.grid.resolution_m
    stuck.hemmed_in = False
    assert (stuck._drawn().free() == stuck.stood).all()


class Bumped(Explorer):
    """Touches something once, where what it was driving to is seen already (the first time its look round is over)."""

    seen_already = 0

    def _seen_already(self):
        seen = super()._seen_already()
        self.seen_already += seen
        self.guard.touched = seen and self.seen_already == 2
        return seen

    def _back_off(self, belief, events):
        self.guard.touched = False
        events.append(Event.CONTACT)
        return Twist(-0.1, 0.0, 1.0)


def test_a_touch_between_two_viewpoints_ends_nothing():
    explorer, out = explore(Flatland(house(), START, ()), explorer=Bumped)
    assert [Event.CONTACT in step.events for step in out].count(True) == 1
    assert explorer.stop == "no frontier" and explorer.book.missions[-1].place == "home"


def test_the_budget_of_views_sends_it_home():
    explorer, out = explore(Flatland(house(), START, ()), views=40)
    assert explorer.stop == "budget: mission.advanced.explore.views=40"
    assert summary(explorer)["views"] <= 42
    assert np.linalg.norm(out[-1].truth[:2, 3] - START[:2]) <= explorer.settings.arrive_m + MATCH_M


def test_coverage_of_the_bounds_sends_it_home():
    explorer, _ = explore(Flatland(house(), START, ()), coverage=0.3)
    assert explorer.stop.startswith("coverage: 0.")


def test_it_never_drives_where_the_map_does_not_say_free(whole):
    world, explorer, out = whole
    drawn = OccupancyMapper(Occupancy(), world.facts.bounds_m)
    for step in out:
        grid = drawn.grid()
        if step.index > 30:  # it has looked round
            assert grid.free()[tuple(grid.cells(step.truth[None, :2, 3])[0])]
        drawn.update(step.truth, step.scan)


def test_places_of_the_patrol_are_looked_round_at_before_home():
    place = ("den", 6.5, 4.5)
    explorer, out = explore(Flatland(house(), START, ()), visit=(place, ("home", *START[:2]), ("nowhere", 50.0, 1.0)))
    last = explorer.book.missions[-2:]
    assert [mission.place for mission in last] == ["at den", "home"] and all(m.status == "arrived" for m in last)
    there = [step for step in out if np.linalg.norm(step.truth[:2, 3] - place[1:]) <= 0.3]
    assert len(there) >= 30, "once round in steps of 12 degrees"


def room_with_a_gap(cells: int) -> OccupancyGrid:
    """A room of 3 m by 3 m, known; beyond the gap in its right wall, of so many cells of 0.1 m, nobody was."""
    probability = np.full((50, 80), np.nan, np.float32)
    probability[9:41, 9:41] = 0.95
    probability[10:40, 10:40] = 0.05
    probability[25 - cells // 2:25 + cells // 2, 40] = 0.05
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


@pytest.mark.parametrize(("cells", "goes"), [(12, True), (8, True), (2, False)])
def test_ground_behind_an_opening_counts_and_a_crack_does_not(cells, goes):
    """Through a doorway of 0.8 m a disc of 0.35 m fits along one line of cells."""
    view = Frontiers(room_with_a_gap(cells), 0.35, (), ExploreSettings()).best(np.array([2.5, 2.5, 0.0]))
    assert (view is not None) == goes
    if view is not None:
        assert abs(view.facing_rad) < 0.8 and 0.3 < view.gain_m2 < np.pi * 4.0**2 * 50 / 360


def test_ground_that_a_beam_or_two_passed_is_not_known_yet():
    """One beam through a cell tells a laser's grid less than it takes to call the cell free (0.31 of 0.25)."""
    grid = room_with_a_gap(10)
    passed = grid.probability.copy()
    passed[binary_dilation(grid.free(), iterations=3) & np.isnan(passed)] = 0.31
    frontiers = Frontiers(replace(grid, probability=passed), 0.35, (), ExploreSettings())
    assert frontiers.best(np.array([2.5, 2.5, 0.0])) is not None


@pytest.mark.parametrize(("span_deg", "typed", "sees_deg"), [(57.0, None, 50.0), (270.0, None, 265.0), (360.0, None, 355.0),
                                                           (3.0, None, 5.0), (270.0, 50.0, 50.0)])
def test_what_is_seen_at_once_is_what_the_scan_spans(span_deg, typed, sees_deg):
    bearings = np.radians(np.linspace(-0.5 * span_deg, 0.5 * span_deg, 99))
    assert ExploreSettings(view_deg=typed).seeing(bearings).view_deg == sees_deg


def test_a_frontier_looked_at_in_vain_is_looked_at_from_elsewhere_and_three_times_at_most():
    grid, looks, at = room_with_a_gap(12), [], np.array([2.5, 2.5, 0.0])
    while (view := Frontiers(grid, 0.4, looks, ExploreSettings()).best(at)) is not None:
        assert all(np.linalg.norm(view.at_m - look.at_m) >= 1.0 for look in looks)
        looks.append(Look(view.at_m, Frontiers(grid, 0.4, looks, ExploreSettings()).looked_at(view.at_m, view.facing_rad)))
    assert 2 <= len(looks) <= 3 * 3
    assert np.sum([look.seen for look in looks], axis=0).max() <= 3


def test_what_a_body_can_stand_over_is_what_counts_as_floor():
    occupied = house()
    occupied[30, 55:65] = True  # the right room is closed
    grid = Flatland(occupied, START, ()).grid()
    reach = floor_within_reach(grid, np.array(START[:2]), 0.3)
    assert reach[50, 20] and not reach[50, 60] and not reach[0, 0]
    assert explored_share(grid, grid, reach) == 1.0


@pytest.mark.parametrize(("words", "says"), [
    (["task=explore", "mission.survey=route"], "type task=survey"),
    (["mission.survey=explore", "source=replay", "source.path=none.mcap"], "nobody drives"),
    (["mission.survey=explore", "sensor=mono"], "type sensor=rgbd or mission.survey=route"),
    (["mission.survey=wander"], "is not one of route, explore"),
    (["task=blame", "mission.survey=explore"], "type mission.survey=route"),
])
def test_what_cannot_be_explored_is_refused_in_one_line(words, says, tmp_path, capsys):
    assert main([*words, f"output={tmp_path / 'run'}"]) == 2
    said = [line for line in capsys.readouterr().err.strip().splitlines() if not line.startswith("compiling inner loops")]
    assert len(said) == 1 and says in said[0]
    assert not (tmp_path / "run").exists()


def test_a_source_that_cannot_be_driven_is_refused():
    from rhs.patrol.explore import check_explorable

    who = {"source": "source=replay", "sensor": "sensor=rgbd"}
    parts = SimpleNamespace(slam=None, provides=frozenset({"scan"}), who=who)
    with pytest.raises(ConfigError, match="cannot do; type mission.survey=route"):
        check_explorable(parts, frozenset({"scan"}))
    with pytest.raises(ConfigError, match="leave slam= out"):
        check_explorable(SimpleNamespace(**(vars(parts) | {"slam": object()})), frozenset({"scan"}))


def test_a_pose_measured_anew_keeps_a_covariance():
    """Height goes with x by 0.99: x known ten times better, what they shared is more than there is of x."""
    covariance = np.eye(6)
    covariance[0, 2] = covariance[2, 0] = 0.99
    kept = measured_anew(covariance, np.eye(3))
    np.testing.assert_allclose(kept, covariance, atol=1e-15)
    better = measured_anew(covariance, 0.01 * np.eye(3))
    assert np.linalg.eigvalsh(better).min() > 0.0
    np.testing.assert_allclose(better[np.ix_(PLANAR, PLANAR)], 0.01 * np.eye(3))
    assert better[0, 2] == pytest.approx(0.0099) and better[2, 2] == pytest.approx(1 - 0.99**2 + 0.99**2 * 0.01)
    replaced = covariance.copy()
    replaced[np.ix_(PLANAR, PLANAR)] = 0.01 * np.eye(3)
    assert np.linalg.eigvalsh(replaced).min() < 0.0
