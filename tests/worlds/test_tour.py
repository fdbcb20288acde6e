"""Proposed surveys: they keep their distance, see everything, and come back."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import distance_m, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.worlds.clearance import clearance_of, coarser
from rhs.worlds.round_trip import round_trip
from rhs.worlds.tour import MOST_SPOTS, Ground, propose
from rhs.worlds.world import load_world


def room(width: int, height: int) -> OccupancyGrid:
    """A free rectangle of 0.1 m cells within walls one cell thick."""
    probability = np.ones((height, width), np.float32)
    probability[1:-1, 1:-1] = 0.0
    return OccupancyGrid(probability, 0.1, (0.0, 0.0))


def along(route: np.ndarray) -> np.ndarray:
    pieces = [a + np.linspace(0, 1, 2 + int(np.hypot(*(b - a)) / 0.05))[:, None] * (b - a)
              for a, b in zip(route[:-1], route[1:], strict=True)]
    return np.concatenate(pieces)


@pytest.mark.parametrize("name", ["square_small", "home", "figure_eight", "corridor"])
def test_a_tour_keeps_its_distance_and_ends_past_its_start(name):
    world = load_world(name)
    tour = propose(truth_grid(world), world.robot_radius_m)
    assert min(distance_m(world, point)[0] for point in along(tour.route_m)[::2]) >= world.robot_radius_m + 0.1
    np.testing.assert_array_equal(tour.route_m[0], tour.start[:2])
    gaps = np.hypot(*(along(tour.route_m) - tour.start[:2]).T)
    assert gaps[len(gaps) // 2 :].min() < 0.1 and abs(gaps[-1] - 1.0) < 0.3  # came home, and went on for a metre


def test_a_tour_goes_round_a_loop_once():
    """The middle of the corridors of square_small is 24 m round; corners are cut."""
    tour = propose(truth_grid(load_world("square_small")), 0.3)
    assert 20.0 < np.hypot(*np.diff(tour.route_m, axis=0).T).sum() < 26.0


def test_a_tour_looks_into_every_room_of_the_home():
    route = along(propose(truth_grid(load_world("home")), 0.2).route_m)
    rooms = {"living": (0, 6, 0, 3.4), "kitchen": (6, 10, 0, 3.4), "bed": (0, 4.5, 4.6, 8), "bath": (4.5, 6.5, 4.6, 8),
             "study": (6.5, 10, 4.6, 8)}
    for x0, x1, y0, y1 in rooms.values():
        assert ((route[:, 0] > x0) & (route[:, 0] < x1) & (route[:, 1] > y0) & (route[:, 1] < y1)).any()


def test_a_given_start_is_kept_and_one_in_a_wall_refused():
    grid = room(60, 40)
    assert propose(grid, 0.3, start=(1.03, 1.04, 0.5)).start == (1.03, 1.04, 0.5)
    with pytest.raises(ConfigError, match=r"start \(-5, 1\): a robot that needs 0.40 m to each side does not fit there"):
        propose(grid, 0.3, start=(-5.0, 1.0))


def test_a_robot_that_is_too_wide_is_refused_with_the_widest_spot():
    with pytest.raises(ConfigError, match="needs 2.10 m to each side fits nowhere .* widest spot has 1.85"):
        propose(room(60, 40), 2.0)


def test_places_are_as_many_as_asked_for_and_end_at_home():
    tour = propose(truth_grid(load_world("square_small")), 0.3, places=6)
    assert [name for name, _, _ in tour.places] == ["place_1", "place_2", "place_3", "place_4", "place_5", "home"]
    np.testing.assert_allclose(tour.places[-1][1:], tour.start[:2])


def test_known_places_are_passed_and_one_behind_a_wall_refused():
    world = load_world("home")
    tour = propose(truth_grid(world), world.robot_radius_m, places=world.places)
    assert [name for name, _, _ in tour.places] == [*(place[0] for place in world.places), "home"]
    for name, x, y in tour.places:
        assert np.hypot(*(along(tour.route_m) - (x, y)).T).min() < 0.4, name
    with pytest.raises(ConfigError, match=r"place 'yard' \(15, 4\): the robot gets no nearer than 5.4 m to it"):
        propose(truth_grid(world), world.robot_radius_m, places=[("yard", 15.0, 4.0)])


def test_clearance_is_measured_to_the_edge_of_the_nearest_cell_that_is_not_free():
    """The middle of the cell beside a wall is half a cell from it; outside the grid nothing is free."""
    clearance = clearance_of(room(7, 5))
    assert clearance[1, 3] == pytest.approx(0.05) and clearance[2, 3] == pytest.approx(0.15) and clearance[0, 0] == 0.0
    alone = clearance_of(OccupancyGrid(np.zeros((3, 3), np.float32), 0.1, (0.0, 0.0)))
    assert alone[1, 1] == pytest.approx(0.15)


def test_a_coarse_cell_is_free_where_all_of_it_is():
    grid = coarser(room(6, 6), 9)
    assert grid.resolution_m == pytest.approx(0.2)
    np.testing.assert_array_equal(grid.probability, [[1, 1, 1], [1, 0, 1], [1, 1, 1]])


def test_a_round_trip_of_points_on_a_circle_goes_round():
    """The shortest closed tour of points in convex position is their hull."""
    turn = np.radians(np.array([0, 200, 40, 300, 120, 80, 250, 160]))
    points = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    order = round_trip(np.linalg.norm(points[:, None] - points[None], axis=-1))
    went = np.degrees(turn[order])
    assert order[0] == 0 and (np.all(np.diff(went) > 0) or np.all(np.diff(went[1:]) < 0))


def test_a_large_hall_is_looked_at_from_spots_further_apart():
    hall = OccupancyGrid(np.pad(np.zeros((200, 200), np.float32), 1, constant_values=1.0), 0.5, (0.0, 0.0))  # a hectare
    ground = Ground(hall, clearance_of(hall), 0.3, None)
    ground.viewpoints()
    assert len(ground.spots) <= 1.5 * MOST_SPOTS and ground.sees.size <= 4 * MOST_SPOTS**2  # 0.26 GB
