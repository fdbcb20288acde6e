"""A flat map pulled up into walls: where they stand, that doors stay open, and what is refused with which words."""


import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from rhs.api.errors import ConfigError
from rhs.api.floorplan import touched_cells, truth_grid
from rhs.api.grid import OccupancyGrid
from rhs.worlds.buildings import LONGEST_ROUTE_M, length_m
from rhs.worlds.clearance import ways_m
from rhs.worlds.map_walls import outlines, room_of, simplified, walls_of
from rhs.worlds.maps import load_map, save_map
from rhs.worlds.world import load_world

FREE, WALL = 0.0, 1.0


def two_rooms(cell_m: float = 0.1) -> OccupancyGrid:
    """40 x 60 cells, unknown outside: two rooms of 3.8 x 2.8 m with a wall of one cell between them and a door of 0.9 m."""
    cells = np.full((42, 62), np.nan, np.float32)
    cells[1:41, 1:61] = WALL
    cells[2:40, 2:60] = FREE
    cells[2:40, 30] = WALL
    cells[15:24, 30] = FREE
    cells[30:34, 45:50] = WALL
    return OccupancyGrid(cells, cell_m, (-1.0, 2.0))


def distance_to_m(segments: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N,) metres from points (N, 2) to the nearest of segments (S, 2, 2)."""
    a, d = segments[:, 0], segments[:, 1] - segments[:, 0]
    t = np.clip(((points[:, None] - a) * d).sum(-1) / (d * d).sum(-1), 0.0, 1.0)
    return np.hypot(*(points[:, None] - a - t[..., None] * d).transpose(2, 0, 1)).min(axis=1)


def segments_of(walls) -> np.ndarray:
    return np.concatenate([wall.segments_m for wall in walls])


def test_outlines_run_along_the_sides_of_cells_the_room_on_the_left():
    room = np.ones((4, 5), bool)
    room[1, 2] = False
    outer, inner = outlines(room)
    area = [0.5 * np.sum(x[:-1, 0] * x[1:, 1] - x[1:, 0] * x[:-1, 1]) for x in (outer, inner)]
    assert area == [20.0, -1.0] and {len(outer), len(inner)} == {5}


def test_cells_that_touch_at_a_corner_have_outlines_of_their_own():
    room = np.array([[1, 0], [0, 1]], bool)
    assert [len(loop) for loop in outlines(room)] == [5, 5]


@pytest.mark.parametrize("slope", [1.0, 0.5, 0.23])
def test_the_staircase_of_an_oblique_wall_is_one_piece(slope):
    rows, columns = np.indices((60, 60))
    (loop,) = outlines(rows + 0.5 < 20 + slope * (columns + 0.5))
    fewer = simplified(loop)
    assert len(fewer) <= 7 < len(loop)
    assert distance_to_m(np.stack([fewer[:-1], fewer[1:]], 1), loop).max() < 1.0


def test_a_room_of_a_map_has_its_walls_where_the_map_has_them_and_its_door(tmp_path):
    grid = two_rooms()
    yaml, _ = save_map(tmp_path / "plan", grid)
    world = load_world(yaml)
    truth = truth_grid(world)
    facing = np.argwhere(grid.occupied() & binary_dilation(grid.free()))
    occupied = grid.centres(facing)
    assert distance_to_m(segments_of(world.walls), occupied).max() <= 0.1
    assert np.all(truth.probability[tuple(truth.cells(np.array([[2.05, 3.95], [1.0, 4.0], [4.0, 4.0]])).T)] == 0.0)
    assert np.isnan(truth.probability[tuple(truth.cells(np.array([[3.8, 5.2]])).T)]).all()  # inside of the block
    sides = {x for x, _ in np.round(segments_of(world.walls).reshape(-1, 2) - grid.origin_m, 6)}
    assert sides == {0.2, 3.0, 3.1, 4.5, 5.0, 6.0}
    assert len(world.places) >= 2 and np.allclose(world.route_m[0], world.start[:2])
    assert length_m(world.route_m) <= LONGEST_ROUTE_M


def test_the_room_is_the_one_with_the_start_or_the_roomiest_indoors():
    cells = np.full((60, 90), FREE, np.float32)
    cells[10:50, 10:80] = WALL
    cells[11:49, 11:30], cells[11:49, 31:79] = FREE, FREE
    plan = OccupancyGrid(cells, 0.1, (0.0, 0.0))
    assert room_of(plan, 0.2)[30, 50] and not room_of(plan, 0.2)[[30, 0], [20, 0]].any()
    assert room_of(plan, 0.2, np.array([2.0, 3.0])).sum() == 38 * 19
    assert not room_of(plan, 0.2, np.array([1.05, 1.05])).any()
    assert walls_of(plan, room_of(plan, 0.2))[0].height_m == 2.6


def test_ways_are_as_long_as_counted_by_hand():
    plan = two_rooms()
    ways = ways_m(plan.free(), plan.resolution_m, plan.cells(np.array([-0.75, 2.25]))[0])
    assert ways[2, 2] == 0.0 and ways[2, 7] == pytest.approx(0.5) and ways[5, 5] == pytest.approx(0.3 * 2**0.5)
    assert np.isinf(ways[1, 1])


def test_a_file_may_say_start_places_route_and_robot(tmp_path):
    save_map(tmp_path / "plan", two_rooms())
    path = tmp_path / "flat.yaml"
    path.write_text("building: plan.yaml\nstart: [0.5, 4.0, 0]\nrobot_radius_m: 0.15\n"
                    "places: {left: [0.5, 3.0], right: [4.0, 4.0]}\nroute_m: [[0.5, 4.0], [4.0, 4.0]]\n")
    world = load_world(path)
    assert world.name == "flat" and world.robot_radius_m == 0.15 and len(world.route_m) == 2
    assert [name for name, _, _ in world.places] == ["left", "right"]
    path.write_text("building: plan.yaml\nstart: [0.5, 4.0, 90]\n")
    np.testing.assert_allclose(load_world(path).start[:2], [0.5, 4.0])


def test_a_picture_needs_a_scale_beside_it(tmp_path):
    import cv2

    image = np.full((80, 120), 255, np.uint8)
    cv2.rectangle(image, (5, 5), (110, 70), 0, 2)
    cv2.imwrite(str(tmp_path / "house.png"), image)
    with pytest.raises(ConfigError, match=r"house.png: nobody says how large this plan is; write house.yaml beside it"):
        load_world(tmp_path / "house.png")
    (tmp_path / "house.yaml").write_text("image: house.png\nresolution: 0.05\n")
    world = load_world(tmp_path / "house.png")
    assert world.bounds_m == pytest.approx((0.35, 0.5, 5.45, 3.65), abs=0.11)
    assert load_world(tmp_path / "house.yaml").bounds_m == world.bounds_m


@pytest.mark.parametrize(("keys", "words"), [
    ("building: none.yaml", "there is no file"),
    ("building: plan.yaml\nstart: [50, 50, 0]", "no free space at the start"),
    ("building: plan.yaml\nrobot_radius_m: 1.9", "no room for a robot of radius 1.9 m"),
    ("building: plan.yaml\nroute_m: [[0, 4], [1, 4]]", "route_m without start"),
    ("building: plan.yaml\nplaces: {far: [9, 9]}", "flat.yaml: place 'far' (9, 9): the robot gets no nearer than"),
    ("building: plan.yaml\nstart: [0.5, 4, 0]\nplaces: {far: [9, 9]}\nroute_m: [[0.5, 4], [1, 4]]", "GOAL_OUTSIDE_MAP"),
    ("building: plan.yaml\nrobot_raduis_m: 0.2", "unknown key 'robot_raduis_m'"),
])
def test_what_cannot_be_is_refused_in_one_line(tmp_path, keys, words):
    save_map(tmp_path / "plan", two_rooms())
    (tmp_path / "flat.yaml").write_text(keys + "\n")
    with pytest.raises(ConfigError) as error:
        load_world(tmp_path / "flat.yaml")
    assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["aws_small_house", "maze", "playground", "robopark_plan"])
def test_maps_of_others_keep_their_walls_within_a_cell(name, real_data):
    path = real_data(f"maps/{name}.yaml")
    grid, world = load_map(path), load_world(path)
    room = room_of(grid, world.robot_radius_m)
    sides = np.concatenate(outlines(room)) * grid.resolution_m + grid.origin_m
    assert distance_to_m(segments_of(world.walls), sides).max() <= grid.resolution_m
    free = OccupancyGrid(np.where(room, 0.0, 1.0).astype(np.float32), grid.resolution_m, grid.origin_m)
    inside = free.cells(world.route_m)
    assert room[inside[:, 0], inside[:, 1]].all()
    assert not touched_cells(world, 0.1).all() and sum(len(w.points_m) for w in world.walls) < 3000
