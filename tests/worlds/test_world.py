"""World files: what is read, and what is refused with which words."""

from pathlib import Path

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import after, distance_m, truth_grid
from rhs.base.data_dirs import data_dir
from rhs.worlds.world import load_world, reversed_world, world_names

ROOM = """\
start: [1.0, 1.0, 90]
robot_radius_m: 0.3
route_m: [[1, 1], [3, 1]]
places:
  desk: [3, 3]
walls:
  - name: room
    points_m: [[0, 0], [4, 0], [4, 4], [0, 4], [0, 0]]
boxes:
  - {name: chest, centre_m: [2, 3], size_m: [0.5, 0.5, 0.5]}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "room.yaml"
    path.write_bytes(text.encode("utf-8"))
    return path


def test_a_room_is_read(tmp_path):
    world = load_world(write(tmp_path, ROOM))
    assert world.name == "room" and world.robot_radius_m == 0.3
    np.testing.assert_allclose(world.start, (1.0, 1.0, np.pi / 2))
    assert world.places == (("desk", 3.0, 3.0),) and world.bounds_m == (0.0, 0.0, 4.0, 4.0)
    assert world.facts().places == world.places


def test_byte_order_mark_and_windows_line_ends_change_nothing(tmp_path):
    plain = load_world(write(tmp_path, ROOM))
    other = load_world(write(tmp_path, "\ufeff" + ROOM.replace("\n", "\r\n")))
    assert other.places == plain.places and other.start == plain.start


@pytest.mark.parametrize(("old", "new", "line", "words"), [
    ("boxes:", "changes: {removed: [chset]}\nboxes:", 9, "no box is named 'chset'; did you mean 'chest'"),
    ("boxes:", "changes: {moved: {chest: [1, 2]}}\nboxes:", 9, "chest has 2 values; expected 3"),
    ("boxes:", "changes: {moved: {chest: [3, 1, 0]}}\nboxes:", 9, "put in 0.00 m from"),
    ("boxes:", "changes: {removed: [chest], moved: {chest: [1, 2, 0]}}\nboxes:", 9, "both moved and removed"),
    ("boxes:", "changes: {light: 0}\nboxes:", 9, "light=0 is outside"),
    ("robot_radius_m", "robot_raduis_m", 2, "unknown key 'robot_raduis_m' in the file; did you mean 'robot_radius_m'"),
    ("    points_m", "    height: 3\n    points_m", 8, "unknown key 'height' in walls entry 1; did you mean 'height_m'"),
    ("robot_radius_m: 0.3", "robot_radius_m: 0.3\nrobot_radius_m: 0.2", 3, "key 'robot_radius_m' appears twice"),
    ("robot_radius_m: 0.3", "robot_radius_m: -0.3", 2, "robot_radius_m=-0.3 is outside the allowed range [0.05, 2]"),
    ("robot_radius_m: 0.3", "robot_radius_m: .nan", 2, "'.nan' is not a number"),
    ("robot_radius_m: 0.3", "robot_radius_m: 0", 2, "robot_radius_m=0 is outside"),
    ("robot_radius_m: 0.3", "robot_radius_m: 012", 2, "'012' is not a number"),
    ("robot_radius_m: 0.3", "robot_radius_m: 12:30", 2, "'12:30' is not a number"),
    ("robot_radius_m: 0.3", "robot_radius_m: no", 2, "'no' is not a number"),
    ("robot_radius_m: 0.3", "robot_radius_m: '0.3'", 2, "expected a number"),
    ("robot_radius_m: 0.3", "robot_radius_m: !!python/object/apply:os.system ['touch canary']", 2, "expected a number"),
    ("start: [1.0, 1.0, 90]", "start: !!python/tuple [1.0, 1.0, 90]", 1, "tag"),
    ("start: [1.0, 1.0, 90]", "start: [1.0, 1.0]", 1, "start has 2 values; expected 3"),
    ("start: [1.0, 1.0, 90]\n", "", 1, "lacks the key 'start'"),
    ("start: [1.0, 1.0, 90]", "start: [1.0, 1.0, .inf]", 1, "'.inf' is not a number"),
    ("start: [1.0, 1.0, 90]", "start: [1.0, 1.5, 90]", 3, "route_m begins at [1.0, 1.0]; expected the start"),
    ("  desk: [3, 3]", "\tdesk: [3, 3]", 5, "indent with spaces, not tabs"),
    ("  desk: [3, 3]", "  desk: [3", 6, "expected ',' or ']'"),
    ("  desk: [3, 3]", "  desk: [3, 3]\n  bed: [2, 3]", 5, "GOAL_OCCUPIED: place 'bed' (2, 3) is 0.00 m from box 'chest'"),
    ("  desk: [3, 3]", "  desk: [3.9, 3]", 5, "GOAL_OCCUPIED: place 'desk' (3.9, 3) is 0.10 m from wall 'room'"),
    ("  desk: [3, 3]", "  desk: [30, 3]", 5, "GOAL_OUTSIDE_MAP: place 'desk' (30, 3) lies outside the walls"),
    ("start: [1.0, 1.0, 90]\nrobot_radius_m: 0.3\nroute_m: [[1, 1]", "start: [0.1, 1, 0]\nroute_m: [[0.1, 1]", 1,
     "START_OCCUPIED: start (0.1, 1) is 0.10 m from wall 'room'; the robot's radius is 0.3 m"),
    ("start: [1.0, 1.0, 90]\nrobot_radius_m: 0.3\nroute_m: [[1, 1]", "start: [-5, 1, 0]\nroute_m: [[-5, 1]", 1,
     "START_OUTSIDE_MAP"),
    ("[0, 4], [0, 0]]", "[0, 4], [0, 0.5]]", 1, "START_OUTSIDE_MAP: start [1.0, 1.0] is not enclosed by walls"),
    ("[3, 1]]", "[1, 3], [3.0, 3.0]]", 3, "ROUTE_OCCUPIED: the leg from [1.0, 3.0] to [3.0, 3.0] goes through"),
    ("[0, 4], [0, 0]]", "[0, 4], [0, 4], [0, 0]]", 8, "the same point twice in a row"),
    ("walls:\n", "walls: &w\n", 7, "aliases"),
    ("boxes:", "obstacles:\n  - {name: trap, centre_m: [3, 1], size_m: [1, 1, 1]}\nboxes:", 10, "put in 0.00 m from"),
    ("boxes:\n", "boxes:\n  - {name: chest, centre_m: [1, 3], size_m: [0.2, 0.2, 1]}\n", 10, "two boxes are named 'chest'"),
    ("name: chest", "name: room, colour: red", 10, "unknown key 'colour'"),
    ("    points_m", "    twins: [0, 1]\n    points_m", 8, "twins has 2 values; expected 4"),
    ("    points_m", "    surface: {recipe: plastre}\n    points_m", 8, "'plastre' is not one of plaster, brick"),
])
def test_a_bad_file_is_refused_in_one_line(tmp_path, old, new, line, words):
    assert old in ROOM
    text = ROOM.replace(old, new, 1)
    if words == "aliases":
        text += "more: *w\n"
        line = text.count("\n")
    path = write(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load_world(path)
    message = str(caught.value)
    assert words in message and "\n" not in message
    assert message.startswith(f"{path}:{line}: "), message
    assert not (tmp_path / "canary").exists() and not Path("canary").exists()


@pytest.mark.parametrize(("content", "words"), [
    (b"", "the file is empty"),
    (b"- 1\n- 2\n", "the file is a list; expected keys and values"),
    (b"\xff\xfe\x00", "not UTF-8"),
    (b"start: 1" + b" " * 1_000_001, "more than the 1000000 allowed"),
    (ROOM[:150].encode(), "expected ',' or ']'"),
])
def test_a_file_that_is_no_world_is_refused(tmp_path, content, words):
    path = tmp_path / "bad.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words) as caught:
        load_world(path)
    assert str(caught.value).startswith(str(path))


def test_a_missing_file_and_a_misspelt_name_are_refused(tmp_path):
    with pytest.raises(ConfigError, match="there is no such file"):
        load_world(tmp_path / "nowhere.yaml")
    with pytest.raises(ConfigError, match="did you mean 'square_twin'"):
        load_world("square_twins")


def test_a_flat_map_without_its_picture_is_refused(tmp_path):
    path = tmp_path / "flat.yaml"
    path.write_text("image: flat.pgm\nresolution: 0.05\norigin: [0, 0, 0]\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="map image .*flat.pgm does not exist"):
        load_world(path)


def test_like_takes_the_rest_from_another_world_and_only_one_step(tmp_path):
    write(tmp_path, ROOM)
    (tmp_path / "late.yaml").write_text("like: room\nstart: [1, 1, 0]\n", encoding="utf-8")
    late = load_world(tmp_path / "late.yaml")
    assert late.name == "late" and late.start[2] == 0.0 and late.places == (("desk", 3.0, 3.0),)
    (tmp_path / "later.yaml").write_text("like: late\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="is itself like another world"):
        load_world(tmp_path / "later.yaml")


def test_a_place_in_the_solid_core_is_outside(tmp_path):
    square = load_world("square")
    text = square.path.read_text(encoding="utf-8").replace("[10, 19]", "[10, 10]")
    with pytest.raises(ConfigError, match="GOAL_OUTSIDE_MAP: place 'third_corridor'"):
        load_world(write(tmp_path, text))


@pytest.mark.parametrize("name", world_names())
def test_every_world_that_comes_along_is_good(name):
    world = load_world(name)
    legs = np.diff(world.route_m, axis=0)
    for a, leg in zip(world.route_m, legs, strict=False):
        for share in np.linspace(0, 1, 9):
            assert distance_m(world, a + share * leg)[0] >= world.robot_radius_m
    assert len(world.places) >= 2


def test_after_the_survey_boxes_have_moved_gone_and_come(tmp_path):
    more = """  - {name: chair, centre_m: [3, 2], size_m: [0.4, 0.4, 0.5]}
changes: {removed: [chair], moved: {chest: [1, 3, 90]}, light: 0.5, lamp_deg: 180}
obstacles:
  - {name: parcel, centre_m: [2.5, 2.0], size_m: [0.2, 0.2, 0.2]}
"""
    before = load_world(write(tmp_path, ROOM + more))
    later = after(before)
    assert [(box.name, box.centre_m) for box in later.boxes] == [("chest", (1.0, 3.0)), ("parcel", (2.5, 2.0))]
    assert later.boxes[0].yaw_rad == pytest.approx(np.pi / 2)
    assert (before.light.brightness, later.light.brightness, later.light.lamp_rad) == (1.0, 0.5, np.pi)
    assert after(later) is later and [box.name for box in before.boxes] == ["chest", "chair"]
    grids = truth_grid(before), truth_grid(later)
    for x, y, then, now in ((3.0, 2.0, 1.0, 0.0), (2.0, 3.0, 1.0, 0.0), (1.0, 3.0, 0.0, 1.0), (2.5, 2.0, 0.0, 1.0)):
        for grid, expected in zip(grids, (then, now), strict=True):
            row, column = grid.cells(np.array([[x, y]]))[0]
            assert grid.probability[row, column] == expected


def test_the_survey_backwards_begins_where_it_ended():
    world = load_world("square")
    back = reversed_world(world)
    np.testing.assert_allclose(back.start, (3.0, 1.0, np.pi))
    np.testing.assert_allclose(back.route_m[-1], world.start[:2])


def test_the_readme_lists_every_world_and_its_format_is_read(tmp_path):
    from rhs.base.data_dirs import data_dir

    readme = (data_dir("worlds") / "README.md").read_text(encoding="utf-8")
    assert all(f"| `{name}` |" in readme for name in world_names())
    text = readme.split("```yaml\n")[1].split("```")[0]
    text = text.replace("[[2, 1], [19, 1], ...]", "[[2, 1], [3, 1]]")
    text = text.replace("[[0, 0], [20, 0], ...]", "[[0, 0], [20, 0], [20, 8], [0, 8], [0, 0]]")
    assert load_world(write(tmp_path, text)).boxes[-1].name == "chest"


def test_a_loop_of_corridors_with_walls_on_cell_borders_is_a_building(tmp_path):
    """Corridors 1.5 m wide about whole metres: every wall stands at x.25 or x.75, between two rows of cells of 0.1 m."""
    (tmp_path / "loop.yaml").write_text(
        "start: [3, 1, 0]\nrobot_radius_m: 0.3\ncamera_height_m: 1.2\n"
        "route_m: [[3, 1], [9, 1], [9, 9], [1, 9], [1, 1], [4, 1]]\n"
        "places: {far: [9, 5]}\nseed: 1\nwalls:\n"
        "  - {name: outer, points_m: [[0.25, 0.25], [9.75, 0.25], [9.75, 9.75], [0.25, 9.75], [0.25, 0.25]]}\n"
        "  - {name: inner, points_m: [[1.75, 1.75], [1.75, 8.25], [8.25, 8.25], [8.25, 1.75], [1.75, 1.75]]}\n")
    grid = truth_grid(load_world(str(tmp_path / "loop.yaml")))
    assert np.isnan(grid.probability[tuple(grid.cells(np.array([5.0, 5.0]))[0])])  # the block between the corridors
    # 9.5 m less a cell a side; the block and a cell a side, but not the cells that meet its corners alone
    assert int((grid.probability == 0.0).sum()) == 93**2 - (67**2 - 4)


@pytest.mark.parametrize("name", ["square_small", "random:hall/12", data_dir("worlds") / "maps" / "map1.yaml"],
                         ids=["file", "drawn", "map"])
def test_another_robot_is_put_into_any_building(name):
    own = load_world(name)
    world = load_world(name, robot={"robot_radius_m": 0.16, "camera_height_m": 0.45})
    assert (world.robot_radius_m, world.camera_height_m) == (0.16, 0.45) != (own.robot_radius_m, own.camera_height_m)
    assert world.name == own.name and len(world.walls) == len(own.walls)


def test_a_robot_too_wide_for_a_building_is_refused():
    for name in ("square_small", "random:office/31"):
        with pytest.raises(ConfigError, match=r"the robot's radius is 1.5 m"):
            load_world(name, robot={"robot_radius_m": 1.5})


def test_a_wall_far_too_long_is_refused_at_once_though_it_has_pilasters(tmp_path):
    pilasters = "    pilasters: {spacing_m: 1.0, width_m: 0.4, depth_m: 0.2}\n"
    text = ROOM.replace("[4, 4]", "[1e5, 4]").replace("boxes:", pilasters + "boxes:")
    with pytest.raises(ConfigError, match="the walls span .* expected at most 40000 square metres"):
        load_world(write(tmp_path, text))  # 200,000 boxes: names compared pair by pair took hours
