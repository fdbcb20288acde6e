"""A building too large for the route that is proposed: what is said of it, and that typing that surveys all of it."""

import re

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import Wall, distance_m
from rhs.api.grid import OccupancyGrid
from rhs.worlds.buildings import LONGEST_ROUTE_M, length_m, on_route, short_tour
from rhs.worlds.maps import save_map
from rhs.worlds.tour import Ground, ground_of, thinned
from rhs.worlds.world import load_world

RADIUS_M = 0.2


def corridor(length_m: float = 80.0) -> OccupancyGrid:
    """A corridor 2 m wide along x from (0, 0), cells of 0.1 m, closed all round."""
    cells = np.ones((22, round(10 * length_m) + 2), np.float32)
    cells[1:-1, 1:-1] = 0.0
    return OccupancyGrid(cells, 0.1, (-0.1, -0.1))


def test_of_a_long_corridor_the_near_part_is_surveyed_and_the_line_says_its_share_and_what_to_type(caplog):
    grid = corridor()
    tour = short_tour(grid, RADIUS_M, start=(40.0, 1.0), places=4, name="long")
    (line,) = caplog.messages
    said = re.search(r"sees (\d+) % of the (\d+) m2 .* type source.survey_m=(\d+) \(some (\d+) views\)", line)
    share, floor_m2, type_m, views = map(int, said.groups())
    reach_m = np.abs(tour.route_m[:, 0] - 40.0).max()
    assert length_m(tour.route_m) <= LONGEST_ROUTE_M
    assert 2.0 * reach_m / 80.0 <= share / 100.0 <= (2.0 * reach_m + 8.5) / 80.0  # and 4 m ahead of either end
    assert floor_m2 == pytest.approx(79.4 * 1.4, abs=4.0) and views == 10 * type_m
    assert all(abs(x - 40.0) <= reach_m for _, x, _ in on_route(tour.places, tour.route_m))
    caplog.clear()
    whole = short_tour(grid, RADIUS_M, start=(40.0, 1.0), places=4, name="long", longest_m=float(type_m))
    assert not caplog.messages and length_m(whole.route_m) <= type_m
    assert ground_of(grid, RADIUS_M, whole.start).share_seen(whole.route_m) > 0.98
    assert max(x for _, x, _ in whole.places) - min(x for _, x, _ in whole.places) > 70.0


def test_places_of_a_file_are_passed_however_far_and_a_long_way_is_said(caplog):
    tour = short_tour(corridor(), RADIUS_M, start=(2.0, 1.0), places=(("end", 78.0, 1.0),), name="long")
    (line,) = caplog.messages
    assert tour.route_m[:, 0].max() > 77.0
    assert "passes all places" in line and f"{length_m(tour.route_m):.0f} m" in line and "route_m" in line


def test_a_world_file_may_say_how_long_its_survey_may_be(tmp_path, caplog):
    save_map(tmp_path / "long", corridor())
    path = tmp_path / "flat.yaml"
    path.write_text("building: long.yaml\nsurvey_m: 200\n")
    assert 120.0 < length_m(load_world(path).route_m) <= 200.0 and not caplog.messages
    assert length_m(load_world(path, robot={"survey_m": 40.0}).route_m) <= 40.0
    path.write_text("building: long.yaml\nsurvey_m: 200\nstart: [5, 1, 0]\nroute_m: [[5, 1], [20, 1]]\n")
    with pytest.raises(ConfigError, match="leave out one of them"):
        load_world(path)


def test_of_a_large_hall_the_line_says_that_its_middle_is_left_out(tmp_path, caplog):
    cells = np.ones((202, 302), np.float32)
    cells[1:-1, 1:-1] = 0.0
    save_map(tmp_path / "hall", OccupancyGrid(cells, 0.1, (0.0, 0.0)))
    load_world(tmp_path / "hall.yaml")
    said = re.search(r"sees (\d+) % of the (\d+) m2 .* all of it but the middle of halls type", caplog.messages[-1])
    share, floor_m2 = map(int, said.groups())
    assert floor_m2 == pytest.approx(29.4 * 19.4, rel=0.02) and share <= 100.0 * 60.0 * 5.0 / floor_m2


@pytest.mark.parametrize("name", ["square_small", "random:loop/3"])
def test_a_building_with_a_survey_of_its_own_refuses_the_length_of_one(name):
    with pytest.raises(ConfigError, match="leave out source.survey_m"):
        load_world(name, robot={"survey_m": 200.0})


def test_a_round_trip_is_thinned_as_if_each_trip_were_looked_at_whole():
    grid = corridor(12.0)
    ground: Ground = ground_of(grid, RADIUS_M, (6.0, 1.0))
    stops = np.array([ground.home, *ground.viewpoints(), ground.farthest()])
    ground.ways_m(stops)
    kept = thinned(ground, stops, set())

    def seen(some: list[int]) -> int:
        return int((ground.seen_by(ground.walk(np.array(some))) & ground.needed).sum())

    whole, by_hand = seen(stops.tolist()), stops.tolist()
    for stop in stops[:0:-1].tolist():
        fewer = [other for other in by_hand if other != stop]
        by_hand = fewer if seen(fewer) >= whole - 1 else by_hand
    assert kept.tolist() == by_hand and len(kept) < len(stops)


def test_the_distance_to_a_wall_of_many_pieces_is_that_to_its_nearest(tmp_path):
    save_map(tmp_path / "long", corridor(8.0))
    world = load_world(tmp_path / "long.yaml")
    assert distance_m(world, np.array([4.0, 0.6])) == (pytest.approx(0.6), f"wall '{world.walls[0].name}'")
    assert all(isinstance(wall, Wall) for wall in world.walls)
