"""Somebody else's building: where its walls are found, how it is turned and scaled, and what is refused with which words."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import distance_m, truth_grid
from rhs.cli.main import main
from rhs.worlds.buildings import on_route
from rhs.worlds.mesh_world import camera_m, floor_m
from rhs.worlds.planning_question import load_arena
from rhs.worlds.scene_files import read_scene
from rhs.worlds.soup import box, cylinder, dressed, sphere
from rhs.worlds.world import load_world

trimesh = pytest.importorskip("trimesh")

# A room of 6 x 4 m about the origin, walls 0.2 m thick and 2 m high, a table with a top 0.75 m up, a box in a corner.
BOXES = {"south": ((6.4, 0.2, 2.0), (0.0, -2.1, 1.0)), "north": ((6.4, 0.2, 2.0), (0.0, 2.1, 1.0)),
         "west": ((0.2, 4.0, 2.0), (-3.1, 0.0, 1.0)), "east": ((0.2, 4.0, 2.0), (3.1, 0.0, 1.0)),
         "chest": ((0.6, 0.5, 0.8), (-2.0, 1.2, 0.4)), "table": ((1.0, 1.0, 0.04), (1.5, 0.5, 0.75))}


def sdf_of(boxes: dict[str, tuple], extra: str = "") -> str:
    links = "".join(f"<link name='{name}'><pose>{x} {y} 0 0 0 0</pose><visual name='v'><pose>0 0 {z} 0 0 0</pose><geometry>"
                    f"<box><size>{a} {b} {c}</size></box></geometry></visual></link>"
                    for name, ((a, b, c), (x, y, z)) in boxes.items())
    return f"<?xml version='1.0'?><sdf version='1.6'><model name='room'><pose>0 0 0 0 0 0</pose>{links}{extra}</model></sdf>"


def mesh_of(boxes: dict[str, tuple]):
    made = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in boxes.values()]
    return trimesh.util.concatenate([*made, trimesh.creation.box((6.2, 4.2, 0.1), trimesh.transformations.translation_matrix(
        (0, 0, -0.05)))])


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def assert_room(world, *, at_m=(0.0, 0.0)):
    """The true plan is that of BOXES: all walls where they stand, free up to a cell from them and nowhere else."""
    x, y = at_m
    for point, metres in (((2.0, -1.5), 0.5), ((-2.9, 0.0), 0.1), ((-1.2, 1.2), 0.5), ((0.0, 1.0), 1.0)):
        assert distance_m(world, np.array(point) + (x, y))[0] == pytest.approx(metres, abs=1e-3)
    grid = truth_grid(world)
    centres = grid.centres(np.argwhere(np.ones(grid.shape, bool))).reshape(*grid.shape, 2) - (x, y)
    inside = (np.abs(centres[..., 0]) < 3.0) & (np.abs(centres[..., 1]) < 2.0)
    chest = (np.abs(centres[..., 0] + 2.0) < 0.3 + 0.1) & (np.abs(centres[..., 1] - 1.2) < 0.25 + 0.1)
    deep = (np.abs(centres[..., 0]) < 3.0 - 0.1) & (np.abs(centres[..., 1]) < 2.0 - 0.1) & ~chest
    assert (grid.probability[deep] == 0.0).all()  # under the table too: a robot of 0.25 m fits
    assert not (grid.probability[~inside] == 0.0).any()


def test_a_room_of_sdf_boxes_has_its_walls_where_they_stand(tmp_path):
    world = load_world(write(tmp_path / "room.sdf", sdf_of(BOXES)))
    assert_room(world)
    assert world.camera_height_m == 0.25 and not world.walls and len(world.places) >= 2
    assert world.bounds_m == pytest.approx((-3.2, -2.2, 3.2, 2.2))


def test_a_robot_as_tall_as_the_table_does_not_drive_under_it(tmp_path):
    write(tmp_path / "room.sdf", sdf_of(BOXES))
    world = load_world(write(tmp_path / "tall.yaml", "building: room.sdf\ncamera_height_m: 1.0\n"))
    assert distance_m(world, np.array([1.5, 0.5]))[0] == 0.0
    assert distance_m(world, np.array([0.5, 0.5]))[0] == pytest.approx(0.5)


@pytest.mark.parametrize("kind", ["obj", "stl", "ply", "glb", "dae", "off"])
def test_meshes_of_every_format_stand_upright_in_metres(tmp_path, kind, caplog):
    mesh = mesh_of(BOXES)
    if kind == "glb":  # y is up in glTF
        mesh.apply_transform(np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]]))
    path = tmp_path / f"room.{kind}"
    mesh.export(path)
    if kind == "dae":
        path.write_bytes(path.read_bytes().replace(b"<up_axis>Y_UP", b"<up_axis>Z_UP"))
    assert_room(load_world(path))
    assert not caplog.records


def test_millimetres_and_a_floor_that_is_not_zero_are_found_and_said(tmp_path, caplog):
    mesh = mesh_of(BOXES)
    mesh.apply_transform(np.diag([1000.0, 1000.0, 1000.0, 1.0]) @ trimesh.transformations.translation_matrix((0, 0, 2.5)))
    mesh.export(tmp_path / "room.stl")
    assert_room(load_world(tmp_path / "room.stl"))
    (record,) = caplog.records
    assert "taken as millimetres" in record.message and "floor found at z = 2.50 m" in record.message


def test_a_building_with_an_open_door_gets_a_fence_and_is_begun_indoors(tmp_path, caplog):
    boxes = {**BOXES, "south": ((2.6, 0.2, 2.0), (-1.9, -2.1, 1.0)), "other": ((2.6, 0.2, 2.0), (1.9, -2.1, 1.0))}
    world = load_world(write(tmp_path / "open.sdf", sdf_of(boxes)))
    assert [wall.name for wall in world.walls] == ["fence"] and "a fence is put up 1 m from it" in caplog.text
    assert abs(world.start[0]) < 3.0 and abs(world.start[1]) < 2.0
    truth = truth_grid(world)
    assert (truth.probability[tuple(truth.cells(np.array([[0.0, -2.1], [0.0, -3.0]])).T)] == 0.0).all()


def test_poses_nest_models_are_found_beside_and_what_is_missing_is_said_in_one_line(tmp_path, caplog):
    (tmp_path / "models" / "room").mkdir(parents=True)
    write(tmp_path / "models" / "room" / "model.sdf", sdf_of(BOXES).replace("<pose>0 0 0 0 0 0</pose>", "", 1))
    (tmp_path / "worlds").mkdir()
    world = load_world(write(tmp_path / "worlds" / "flat.world", (
        "<sdf version='1.6'><world name='w'><include><uri>model://sun</uri></include>"
        "<include><uri>model://ground_plane</uri></include><include><uri>model://nowhere</uri></include>"
        "<model name='m'><pose>10 0 0 0 0 0</pose><include><uri>model://room</uri><pose>0 5 0 0 0 3.14159265358979</pose>"
        "</include></model></world></sdf>")))
    assert distance_m(world, np.array([10.0 + 1.2, 5.0 - 1.2]))[0] == pytest.approx(0.5, abs=1e-6)  # turned: the chest
    assert "missing or unreadable: 1 files or shapes (model://nowhere)" in caplog.text and len(caplog.records) == 1


def test_urdf_links_hang_on_their_joints(tmp_path):
    (tmp_path / "house_pkg" / "meshes").mkdir(parents=True)
    mesh_of(BOXES).export(tmp_path / "house_pkg" / "meshes" / "room.stl")
    path = write(tmp_path / "house_pkg" / "house.urdf", (
        "<robot name='h'><link name='base'/><link name='room'><visual><origin xyz='0 1 0' rpy='0 0 0'/><geometry>"
        "<mesh filename='package://house_pkg/meshes/room.stl'/></geometry></visual></link><joint name='j' type='fixed'>"
        "<parent link='base'/><child link='room'/><origin xyz='4 0 0' rpy='0 0 0'/></joint></robot>"))
    assert_room(load_world(path), at_m=(4.0, 1.0))


@pytest.mark.parametrize("folder", [".", "textures", "../textures"])
def test_pictures_of_an_obj_are_kept_and_repeat(tmp_path, folder):
    """Also where the file names them by the path of another machine."""
    from PIL import Image

    (tmp_path / "house" / folder).mkdir(parents=True)
    tmp_path = tmp_path / "house"
    two = np.tile(np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8), (2, 1, 1))
    Image.fromarray(two).save(tmp_path / folder / "two.png")
    write(tmp_path / "room.mtl", "newmtl two\nmap_Kd C:\\house\\two.png\n")
    lines = ["mtllib room.mtl", "usemtl two"]
    for size, at in BOXES.values():
        for triangle in box(np.array(size)).corners_m + np.array(at):
            lines += [f"v {x} {y} {z}" for x, y, z in triangle]
            lines += ["vt 0 0", "vt 3 0", "vt 3 3"]
    count = sum(line.startswith("v ") for line in lines)
    lines += [f"f {i}/{i} {i + 1}/{i + 1} {i + 2}/{i + 2}" for i in range(1, count, 3)]
    world = load_world(write(tmp_path / "room.obj", "\n".join(lines) + "\n"))
    assert world.mesh is not None and len(world.mesh.images) == 1
    np.testing.assert_array_equal(world.mesh.images[0][0], [[255, 0, 0], [0, 0, 255]])
    assert world.mesh.uv.max() == 3.0


@pytest.mark.parametrize("kind", ["obj", "glb"])
def test_pictures_hang_the_right_way_up(tmp_path, kind):
    """Walls whose picture is red above and blue below, written by trimesh, are red above 1 m."""
    from PIL import Image

    picture = Image.fromarray(np.repeat(np.array([[[255, 0, 0]], [[0, 0, 255]]], np.uint8), 8, axis=0).repeat(4, axis=1))
    parts = [box(np.array(size)).moved(trimesh.transformations.translation_matrix(at)) for size, at in BOXES.values()
             if size[2] == 2.0]
    corners = np.concatenate([part.corners_m for part in parts])
    uv = np.stack([np.full(corners.shape[:2], 0.5), corners[..., 2] / 2.0], axis=-1)
    if kind == "glb":
        corners = corners[..., [0, 2, 1]] * [1, 1, -1]
    look = trimesh.visual.TextureVisuals(uv.reshape(-1, 2), material=trimesh.visual.material.PBRMaterial(
        baseColorTexture=picture) if kind == "glb" else trimesh.visual.material.SimpleMaterial(image=picture))
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(corners.size // 3).reshape(-1, 3), visual=look, process=False)
    mesh.export(tmp_path / f"room.{kind}")
    world = load_world(tmp_path / f"room.{kind}")
    assert world.mesh is not None and len(world.mesh.images) == 1
    image = world.mesh.images[0]
    middles, heights = world.mesh.uv.mean(axis=1), world.mesh.corners_m[..., 2].mean(axis=1)
    rows = np.clip(((1.0 - middles[:, 1]) * len(image)).astype(int), 0, len(image) - 1)
    assert (image[rows[heights > 1.0], 0, 0] == 255).all() and (image[rows[heights < 1.0], 0, 2] == 255).all()


def test_solids_have_the_extent_that_they_say():
    sized = ((box(np.array([1.0, 2.0, 3.0])), (1, 2, 3)), (cylinder(0.5, 2.0), (1, 1, 2)), (sphere(0.5), (1, 1, 1)))
    for part, size in sized:
        np.testing.assert_allclose(np.ptp(part.corners_m.reshape(-1, 3), axis=0), size, rtol=1e-9)
    corners, uv, texture, images = dressed([box(np.ones(3)).coloured((200, 100, 50))])
    assert corners.shape == (12, 3, 3) and uv.shape == (12, 3, 2) and len(images) == 3 and texture.max() == 2


def test_the_floor_is_the_top_of_a_slab_on_the_ground_and_the_camera_is_lower_than_low_walls():
    ground = box(np.array([40.0, 40.0, 0.02])).corners_m - [0, 0, 0.01]
    slab = box(np.array([6.4, 4.4, 0.15])).corners_m + [0, 0, 0.075]
    walls = [box(np.array(size)).corners_m + np.array(at) + [0, 0, 0.15] for size, at in BOXES.values()]
    assert floor_m(np.concatenate([ground, slab, *walls]), on_ground=False) == pytest.approx(0.15, abs=0.011)
    low = np.concatenate(walls) * [1, 1, 0.2]
    assert camera_m(low - [0, 0, 0.03]) == pytest.approx(0.2)


def test_places_are_moved_onto_the_route():
    route = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0]])
    assert on_route((("a", 1.0, 2.0), ("b", 9.0, 1.0), ("home", 0.0, 0.0)), route) == (
        ("a", 1.0, 0.0), ("b", 4.0, 1.0), ("home", 0.0, 0.0))


def test_of_two_places_that_come_to_one_spot_of_the_route_one_is_left():
    route = np.array([[0.0, 0.0], [4.0, 0.0]])
    proposed = (("a", 3.0, 2.0), ("b", 3.0, -2.0), ("c", 0.2, 1.0), ("home", 0.0, 0.0))
    assert on_route(proposed, route) == (("a", 3.0, 0.0), ("home", 0.0, 0.0))


BOMB = "<?xml version='1.0'?><!DOCTYPE sdf [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><sdf><model name='&b;'/></sdf>"


@pytest.mark.parametrize(("name", "content", "words"), [
    ("a.sdf", BOMB, "this XML has a DOCTYPE or ENTITY"),
    ("b.sdf", "<sdf><model></sdf>", "this XML cannot be read"),
    ("c.sdf", "<html/>", "the file begins with <html>; expected <sdf> or <robot>"),
    ("d.sdf", "<sdf><world name='w'/></sdf>", "nothing to see in this file"),
    ("e.sdf", sdf_of(BOXES).replace("6.4 0.2 2.0", "6.4 nan 2.0", 1), "<size> is '6.4 nan 2.0'; expected 3 finite numbers"),
    ("f.world", "<sdf><include><uri>f.world</uri></include></sdf>", "models include one another more than"),
    ("f.sdf", "<sdf>" + "<model>" * 500 + "</model>" * 500 + "</sdf>", "models include one another more than"),
    ("g.sdf", sdf_of(BOXES).replace("6.4 0.2 2.0", "9e5 9e5 2.0", 1), "spans 9e+05 x 9e+05 m; expected at most 1000 m"),
    ("g.obj", "not a mesh\n", "g.obj"),
    ("h.glb", "glTF....", "trimesh cannot read this mesh"),
    ("i.dae", BOMB, "this XML has a DOCTYPE or ENTITY"),
    ("j.stl", "", "j.stl"),
    ("k.ply", "ply\nformat ascii 1.0\nelement vertex 9999999999\n", "k.ply"),
    ("l.obj", "v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nf 1 2 3\n", "which is no building of 2 to 300 m; give unit_m"),
    ("m.obj", "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n", "nothing stands between 0.04 and 0.25 m above the floor"),
    ("p.pbstream", "", "cartographer_pbstream_to_ros_map -pbstream_filename p.pbstream -map_filestem NAME"),
    ("q.world", 'include "map.inc"\nfloorplan ( name "q" bitmap "q.png" size [16 8 0.8] pose [1 0 0 0] )\n',
     "its floor plan q.png is not there; put it beside the world"),
    ("n.abc", "", "no building is read from .abc files"),
    ("o.urdf.xacro", "<robot/>", "expand it first: xacro o.urdf.xacro > o.urdf"),
])
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, name, content, words):
    path = write(tmp_path / name, content)
    with pytest.raises(ConfigError) as caught:
        load_world(write(tmp_path / "world.yaml", f"building: {name}\n") if name == "n.abc" else path)
    assert words in str(caught.value) and "\n" not in str(caught.value) and name in str(caught.value)


def test_a_broken_building_ends_the_program_with_code_2_and_one_line(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "house.sdf", "<sdf><model></sdf>")
    assert main(["world=house.sdf"]) == 2
    assert len(capfd.readouterr().err.strip().splitlines()) == 1 and not list(tmp_path.glob("results/**/row.json"))


def test_a_planner_alone_plans_in_a_building(tmp_path):
    arena = load_arena(str(write(tmp_path / "room.sdf", sdf_of(BOXES))))
    assert arena.start_m is not None and arena.goal_m is not None and arena.robot_radius_m == 0.2


@pytest.mark.parametrize("name", ["turtlebot3/turtlebot3_gazebo/models/turtlebot3_world/model.sdf",
                                  "turtlebot3/turtlebot3_gazebo/models/turtlebot3_house/model.sdf",
                                  "aws_small_house/worlds/small_house.world"])
def test_worlds_of_others_are_read(name, real_data):
    path = real_data(f"worlds/{name}")
    world = load_world(path)
    assert world.mesh is not None and len(world.places) == 4
    if "world/model" in name:  # pillars of 0.15 m radius, drawn with 32 sides, every 1.1 m
        for x in (-1.1, 0.0, 1.1):
            assert distance_m(world, np.array([x, 0.55]))[0] == pytest.approx(0.4, abs=1e-3)
    if "turtlebot3_house" in name:  # every wall box of the file that reaches through the robot's height
        scene = read_scene(path)
        grid = truth_grid(world)
        boxes = [p.corners_m for p in scene.parts if len(p.corners_m) == 12 and p.corners_m[..., 2].min() < 0.05]
        boxes = [b.reshape(-1, 3) for b in boxes if b[..., 2].max() > 1.0]
        middles = np.array([b[:, :2].mean(axis=0) for b in boxes])
        assert len(boxes) > 20 and (grid.probability[tuple(grid.cells(middles).T)] != 0.0).all()


def test_a_drawn_plan_is_listed_and_what_may_be_writing_is_said(tmp_path, capsys, caplog):
    """`rhs worlds` reads the plan, not the bytes of its picture; --debug may stand before a command."""
    picture = np.full((200, 300), 255, np.uint8)
    picture[[0, 1, -2, -1]] = picture[:, [0, 1, -2, -1]] = 0
    for column in range(60, 160, 20):
        picture[90:100, column : column + 8] = 0
    cv2.imwrite(str(tmp_path / "flat.png"), picture)
    write(tmp_path / "flat.yaml", "image: flat.png\nresolution: 0.04\n")
    assert main(["--debug", "worlds", str(tmp_path / "flat.png")]) == 0
    assert f"{tmp_path}/flat.png" in capsys.readouterr().out and "5 marks of less than 1 m" in caplog.text
    caplog.clear()
    write(tmp_path / "flat.yaml", "image: flat.png\nresolution: 0.04\nmarks_m: 1\n")
    assert main(["worlds", str(tmp_path / "flat.png")]) == 0 and "marks" not in caplog.text


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_a_door_that_the_robot_gets_through_is_found_however_the_map_is_turned(yaw, tmp_path, caplog):
    """Two rooms of 4 x 4 m, a wall of 0.1 m and a door of 0.75 m; the robot takes 0.6 m with what it keeps to each side."""
    picture = np.full((220, 430), 255, np.uint8)
    picture[:10], picture[-10:], picture[:, :10], picture[:, -10:], picture[:, 210:215] = 0, 0, 0, 0, 0
    picture[70:108, 210:215] = 255
    cv2.imwrite(str(tmp_path / "flat.png"), picture)
    world = load_world(write(tmp_path / "flat.yaml", f"image: flat.png\nresolution: 0.02\norigin: [3, -2, {yaw}]\n"))
    along = (world.route_m - (3, -2)) @ (np.cos(yaw), np.sin(yaw))
    assert along.min() < 3.5 and along.max() > 5.0 and "leaves out" not in caplog.text


def test_meshes_of_a_package_are_found_in_its_folder_meshes(tmp_path):
    """As Clearpath's worlds name them, with the uri in lines of its own."""
    (tmp_path / "meshes/office").mkdir(parents=True)
    mesh_of(BOXES).export(tmp_path / "meshes/office/room.stl")
    (tmp_path / "worlds").mkdir()
    text = ("<sdf version='1.4'><model name='o'><link name='o'><visual name='v'><geometry><mesh><uri>\n model://office/room.stl\n"
            "</uri></mesh></geometry></visual></link></model></sdf>")
    assert_room(load_world(write(tmp_path / "worlds/office.sdf", text)))
