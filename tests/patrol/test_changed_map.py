"""A map that forgets what has gone and takes in what came to stay; walls, people and what the camera looks over stay as they
are."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from flatland import BEARINGS, Flatland, Oracle, Through, parts, ring

from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Scan
from rhs.estimation.scans.settings import VoteSettings
from rhs.estimation.survey import FURNITURE, HIDDEN
from rhs.patrol.changed_map import STAYS_S, ChangedMap, check_updates
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.sentinel import Sentinel

NOTHING_CAME = np.zeros((20, 60))
HERE = se2(1.0, 1.0, 0.0)
SCREEN = (slice(8, 13), slice(30, 32))  # rows, columns: 0.5 m wide, 2 m ahead of the robot


def room(screen: float = 0.9) -> OccupancyGrid:
    """6 m x 2 m, closed, with a screen in it."""
    probability = np.full((20, 60), 0.05, np.float32)
    probability[[0, -1]] = probability[:, [0, -1]] = 0.9
    probability[SCREEN] = screen
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


def wall_behind(grid: OccupancyGrid, **more) -> Scan:
    """What a scan shows when the screen has gone."""
    bare = grid.occupied()
    bare[SCREEN] = False
    return replace(Flatland(bare, (1.0, 1.0, 0.0), ())._scan(), **more)


def test_what_is_seen_through_in_ten_views_has_gone_and_walls_stay():
    """Five votes, half a vote for each view that passes."""
    grid = room()
    changed = ChangedMap(grid, VoteSettings())
    for view in range(10):
        assert not changed.update(NOTHING_CAME) and changed.grid is grid, f"after {view} views it may still stand there"
        changed.look(HERE, wall_behind(grid), None, 6.0)
    assert changed.update(NOTHING_CAME) and not changed.update(NOTHING_CAME)
    assert not changed.grid.occupied()[SCREEN].any() and changed.grid.free()[SCREEN].all()
    walls = np.ones((20, 60), bool)
    walls[SCREEN] = False
    np.testing.assert_array_equal(changed.grid.probability[walls], grid.probability[walls])


def test_one_view_of_it_gives_it_back_its_votes():
    grid = room()
    changed = ChangedMap(grid, VoteSettings())
    for view in range(40):
        there = Flatland(grid.occupied(), (1.0, 1.0, 0.0), ())._scan()
        changed.look(HERE, there if view % 3 == 2 else wall_behind(grid), None, 6.0)
    assert not changed.update(NOTHING_CAME), "hidden now and then, by somebody who walks there, is not gone"


def test_a_low_thing_goes_only_where_the_floor_under_it_is_seen():
    """The scan at the camera's height passes over a box; what sees the floor from 1 m on sees that nothing is there."""
    grid = room(FURNITURE)
    changed = ChangedMap(grid, VoteSettings())
    for _ in range(40):
        changed.look(HERE, wall_behind(grid), wall_behind(grid, blind_m=3.0), 6.0)
    assert not changed.update(NOTHING_CAME) and changed.grid.occupied()[SCREEN].all()
    for _ in range(10):
        changed.look(HERE, wall_behind(grid), wall_behind(grid, blind_m=1.0), 6.0)
    assert changed.update(NOTHING_CAME) and not changed.grid.occupied()[SCREEN].any()


def test_what_a_low_thing_hid_is_free_again_where_the_floor_was_seen():
    """A box has gone, and with it what its face hid: free where views showed the floor, not where they looked over it."""
    shade = (SCREEN[0], slice(33, 38))
    grid = room(FURNITURE)
    grid.probability[shade] = HIDDEN
    all_seen = wall_behind(grid, blind_m=1.0)
    short = replace(all_seen, ranges_m=np.minimum(all_seen.ranges_m, 2.25))  # the shade is 2.3 to 2.8 m away
    for seen, free in ((all_seen, True), (short, False)):
        changed = ChangedMap(grid, VoteSettings())
        for _ in range(10):
            changed.look(HERE, all_seen, seen, 6.0)
        changed.below.votes[SCREEN] = 0.0
        assert changed.update(NOTHING_CAME)
        assert changed.grid.free()[shade].all() == free


def test_what_stands_for_ten_seconds_is_taken_in_and_who_passes_is_not():
    grid = room()
    bare = replace(grid, probability=np.where(grid.probability == np.float32(0.9), grid.probability, np.float32(0.05)))
    bare.probability[SCREEN] = 0.05
    there = Flatland(grid.occupied(), (1.0, 1.0, 0.0), ())._scan()
    for stood_s, taken in ((STAYS_S, True), (STAYS_S - 0.1, False)):
        changed = ChangedMap(bare, VoteSettings())
        for _ in range(8):
            changed.look(HERE, there, None, 6.0)
        assert changed.update(np.where(grid.occupied() & ~bare.occupied(), stood_s, 0.0)) is taken
        assert changed.grid.occupied()[SCREEN][:, 0].any() == taken, "the side that was seen"
        assert not (changed.grid.occupied() & ~grid.occupied()).any()


@pytest.mark.parametrize("updates", [True, False])
def test_a_way_that_opened_is_driven_once_the_map_knows(updates):
    """The survey saw the west corridor of a ring closed. The way round is 3.5 times as long; where the map may change, the
    robot takes the short way in the end."""
    open_now, mapped = ring(), ring()
    mapped[38:42, 1:20] = True
    ends = (("south", 1.0, 2.6), ("north", 1.0, 5.4))
    source = Flatland(open_now, (1.0, 2.6, np.pi / 2), (*ends, *ends, *ends)[1:])
    grid = OccupancyGrid(np.where(mapped, 0.9, 0.05).astype(np.float32), 0.1, (0.0, 0.0))
    oracle = Oracle(source)
    sentinel = Sentinel(parts(oracle), grid, [], places=source.facts.places, radius_m=source.radius,
                        settings=MissionSettings(update_map=updates))
    for _ in steps(source, Through(source.camera), oracle, sentinel):
        pass
    took = [mission.steps for mission in sentinel.book.missions]
    assert [mission.status for mission in sentinel.book.missions] == ["arrived"] * 5 and not source.hit
    assert (took[-1] < 0.5 * took[0]) is updates, took


def test_who_cannot_tell_what_has_gone_is_refused():
    told = SimpleNamespace(slam=None, who={"sensor": "sensor=mono"})
    check_updates(told, frozenset({"scan"}))
    with pytest.raises(ConfigError, match="needs a measured scan, which sensor=mono does not give"):
        check_updates(told, frozenset())
    with pytest.raises(ConfigError, match="slam= draws one of its own"):
        check_updates(SimpleNamespace(slam=object(), who={}), frozenset({"scan"}))


def test_beams_of_the_flatland_reach_the_screen():
    """The tests above say something only if they do."""
    there = Flatland(room().occupied(), (1.0, 1.0, 0.0), ())._scan()
    assert there.ranges_m[len(BEARINGS) // 2] == pytest.approx(2.0, abs=0.1) and wall_behind(room()).ranges_m[20] > 4.5
