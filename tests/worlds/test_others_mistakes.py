"""Buildings as people really have them: what is wrong with the file is said, in words that tell what to type."""

from __future__ import annotations

import json
import re
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.base.commands import shortened
from rhs.cli.main import main
from rhs.worlds.world import load_world

# x0, y0, x1, y1: a room of 5 x 4 m and one of 3 x 4 m behind a wall with a door of 1 m; metres.
WALLS = ((-0.1, -0.1, 8.1, 0), (-0.1, 4, 8.1, 4.1), (-0.1, -0.1, 0, 4.1), (8, -0.1, 8.1, 4.1), (5, 0, 5.1, 1),
         (5, 2, 5.1, 4))
SHUT = (5, 1, 5.1, 2)


def plan(folder: Path, image: np.ndarray, keys: str = "") -> Path:
    """A plan of 5 cm pixels beside its YAML."""
    cv2.imwrite(str(folder / "plan.png"), image)
    (folder / "plan.yaml").write_text(f"image: plan.png\nresolution: 0.05\n{keys}", "utf-8")
    return folder / "plan.png"


def drawn(walls=WALLS) -> np.ndarray:
    """(H, W) white paper with black walls, a metre of paper round them."""
    image = np.full((124, 204), 255, np.uint8)
    for x0, y0, x1, y1 in walls:
        left, low, right, high = (round((v + 1.1) / 0.05) for v in (x0, y0, x1, y1))
        image[124 - high:124 - low, left:right] = 0
    return image


def obj(folder: Path, walls=WALLS, *, relative: bool = False, unit: float = 1.0) -> Path:
    """Boxes 2.5 m high, each with its vertices before its faces."""
    text, count = "", 0
    for x0, y0, x1, y1 in walls:
        text += "".join(f"v {x * unit} {y * unit} {z * unit}\n" for z in (0, 2.5)
                        for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)))
        count += 8
        for face in ((1, 2, 6, 5), (2, 3, 7, 6), (3, 4, 8, 7), (4, 1, 5, 8), (5, 6, 7, 8)):
            text += "f " + " ".join(str(corner - 9 if relative else count - 8 + corner) for corner in face) + "\n"
    (folder / "house.obj").write_text(text)
    return folder / "house.obj"


def sdf(folder: Path, walls=WALLS, *, z: float = 0.0, more: str = "") -> Path:
    boxes = "".join(f"<link name='l{k}'><pose>{(x0 + x1) / 2} {(y0 + y1) / 2} {1.25 + z} 0 0 0</pose><visual name='v'>"
                    f"<geometry><box><size>{x1 - x0} {y1 - y0} 2.5</size></box></geometry></visual></link>"
                    for k, (x0, y0, x1, y1) in enumerate(walls))
    (folder / "house.sdf").write_text(f"<sdf version='1.6'><model name='house'>{boxes}{more}</model></sdf>")
    return folder / "house.sdf"


def test_a_room_whose_door_is_shut_is_left_out_and_that_is_said(tmp_path, caplog):
    world = load_world(plan(tmp_path, drawn((*WALLS, SHUT))))
    assert world.bounds_m[2] - world.bounds_m[0] == pytest.approx(5.0)
    assert "nothing leads there: 1 part of 9 m2" in caplog.text
    caplog.clear()
    load_world(sdf(tmp_path, (*WALLS, SHUT)))
    assert "nothing leads there: 1 part of" in caplog.text
    caplog.clear()
    load_world(plan(tmp_path, drawn()))
    load_world(sdf(tmp_path))
    assert "nothing leads there" not in caplog.text


def test_a_plan_that_is_dark_or_pale_or_transparent_says_which_key_helps(tmp_path):
    with pytest.raises(ConfigError, match="negate: 1"):
        load_world(plan(tmp_path, np.where(drawn() == 255, 0, 80).astype(np.uint8)))
    with pytest.raises(ConfigError, match=r"70 % bright.*free_thresh: 0\.32") as told:
        load_world(plan(tmp_path, np.where(drawn() == 255, 178, 0).astype(np.uint8)))
    keys = str(told.value).rsplit("write ", 1)[1]
    assert load_world(plan(tmp_path, np.where(drawn() == 255, 178, 0).astype(np.uint8), keys)).places  # what it says to type
    clear = np.dstack([drawn()] * 3 + [np.where(drawn() == 255, 0, 255).astype(np.uint8)])
    with pytest.raises(ConfigError, match="transparent"):
        load_world(plan(tmp_path, clear))


def test_a_map_of_cartographer_whose_floor_is_shaded_is_read_by_what_its_refusal_says(tmp_path):
    """Unknown is 128 there, free what is brighter the oftener it was seen. It was told to call 128 free."""
    rng = np.random.default_rng(0)
    image = np.full(drawn().shape, 128, np.uint8)
    floor = np.zeros(image.shape, bool)
    floor[22:102, 22:182] = True
    image[floor] = np.where(drawn()[floor] == 0, 0, rng.integers(185, 256, floor.sum()))
    with pytest.raises(ConfigError, match="mode: scale"):
        load_world(plan(tmp_path, image))
    world = load_world(plan(tmp_path, image, "mode: scale\n"))
    assert world.bounds_m[2] - world.bounds_m[0] == pytest.approx(8.0, abs=0.2)


def test_a_robot_with_nowhere_to_go_is_refused(tmp_path):
    """White walls on black: the block that is drawn white holds the robot, and nothing else does."""
    image = 255 - drawn()
    image[60:90, 60:90] = 255
    image[:20] = image[-20:] = 0
    with pytest.raises(ConfigError, match="nowhere to go.*negate: 1"):
        load_world(plan(tmp_path, image[20:-20, 22:-22], "occupied_thresh: 0.65\n"))


def test_a_map_whose_walls_are_its_floor_says_which_key_helps(tmp_path):
    """A chest of half a metre that is free, in a room that is not: a robot has room to stand in it, and none to turn."""
    image = 255 - drawn()
    image[40:50, 40:50] = 255
    with pytest.raises(ConfigError, match=r"fits nowhere .*; try negate: 1 for a dark floor"):
        load_world(plan(tmp_path, image))


def test_it_does_not_start_in_the_roomiest_corner_that_it_cannot_leave(tmp_path):
    image = drawn((*WALLS, (5, 1, 5.1, 1.7), (0, 1.5, 5, 1.6)))  # 5 x 2.4 m behind a door of 0.3 m, and 3 x 4 m
    image[40:44, 60:64] = image[52:56, 90:94] = 0
    world = load_world(plan(tmp_path, image))
    assert world.start[0] > 5.1 or len(world.places) > 1


def test_a_photograph_is_said_to_be_one(tmp_path, caplog):
    shade = np.linspace(0.5, 1.0, 204)[None]
    load_world(plan(tmp_path, (drawn() * shade).astype(np.uint8)))
    assert "a photograph?" in caplog.text


@pytest.mark.parametrize("colour", [(120, 170, 240), (178, 178, 178)])
def test_a_coloured_room_that_is_left_out_is_said_to_be_and_read_by_what_is_said(tmp_path, caplog, colour):
    """69 % bright: neither wall nor floor. The larger of two rooms was missing, without a word."""
    image = cv2.cvtColor(drawn(), cv2.COLOR_GRAY2BGR)
    image[22:102, 22:122] = np.where(image[22:102, 22:122] == 255, colour, image[22:102, 22:122])
    assert np.ptp(load_world(plan(tmp_path, image)).bounds_m[::2]) < 4.0
    said = re.search(r"coloured rooms\? write (free_thresh: [\d.]+)", caplog.text)
    assert said is not None
    caplog.clear()
    assert np.ptp(load_world(plan(tmp_path, image, f"{said[1]}\n")).bounds_m[::2]) == pytest.approx(8.0, abs=0.06)
    assert caplog.text == ""


def test_coloured_walls_are_no_rooms(tmp_path, caplog):
    image = cv2.cvtColor(drawn(), cv2.COLOR_GRAY2BGR)
    image[drawn() == 0] = (0, 255, 255)
    assert np.ptp(load_world(plan(tmp_path, image)).bounds_m[::2]) == pytest.approx(8.0, abs=0.06) and caplog.text == ""


def test_a_map_on_a_large_grey_sheet_is_where_its_origin_says(tmp_path):
    sheet = np.full((1000, 1000), 205, np.uint8)
    sheet[400:524, 300:504] = np.where(drawn() == 255, 254, drawn())
    world = load_world(plan(tmp_path, sheet, "origin: [-16.1, -24.9, 0]\n"))  # of the sheet's lower left corner
    assert world.bounds_m == pytest.approx((0.0, 0.0, 8.0, 4.0), abs=1e-6)


def test_a_plan_on_a_large_sheet_of_paper_is_no_yard(tmp_path):
    sheet = np.full((1500, 2000), 255, np.uint8)
    sheet[600:724, 900:1104] = drawn()
    world = load_world(plan(tmp_path, sheet))
    assert np.ptp(np.concatenate([wall.points_m for wall in world.walls]), axis=0) == pytest.approx([8, 4], abs=0.06)


def test_a_plan_whose_front_door_stands_open_is_driven_indoors(tmp_path, caplog):
    """A front door of 1 m in the wall of 8 m: the rooms are the building, and not the paper before them."""
    opened = drawn()
    opened[100:104, 60:80] = 255  # through the southern wall
    sheet = np.full((500, 600), 255, np.uint8)
    sheet[200:324, 200:404] = opened
    world = load_world(plan(tmp_path, sheet))
    assert np.ptp(np.concatenate([wall.points_m for wall in world.walls]), axis=0) == pytest.approx([8, 4], abs=0.2)
    assert "its doors to the paper round it are shut" in caplog.text
    (tmp_path / "yard.yaml").write_text("building: plan.png\nstart: [2, 2, 0]\n")
    assert load_world(tmp_path / "yard.yaml").bounds_m == pytest.approx((0, 0, 30, 25))


def test_an_office_in_a_hall_that_reaches_the_edge_of_the_picture_is_not_all_there_is(tmp_path):
    hall = np.full((400, 600), 255, np.uint8)
    hall[150:274, 250:454] = np.where(drawn() == 0, 0, 255)
    hall[250:254, 300:320] = 255
    hall[60:64, 60:64] = hall[340:344, 540:544] = 0  # pillars
    assert load_world(plan(tmp_path, hall)).bounds_m == pytest.approx((0, 0, 30, 20))


def test_a_hall_that_reaches_the_edge_of_the_picture_is_no_paper_round_its_lift(tmp_path):
    hall = np.full((400, 400), 255, np.uint8)
    hall[180:230, 180:230] = 0
    hall[182:228, 182:228] = 255  # a shaft of 2.3 m that nothing leads to
    assert load_world(plan(tmp_path, hall)).walls[0].points_m.max() == pytest.approx(20.0)


def test_a_map_that_is_turned_keeps_its_doors_and_where_it_starts(tmp_path):
    straight = load_world(plan(tmp_path, drawn(), "origin: [1, 2, 0]\n"))
    turned = load_world(plan(tmp_path, drawn(), "origin: [1, 2, 0.5]\n"))
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    for one, other in zip(straight.walls, turned.walls, strict=True):
        assert other.points_m == pytest.approx((one.points_m - [1, 2]) @ turn.T + [1, 2])
    start = (np.array([7.5, 4.0]) - [1, 2]) @ turn.T + [1, 2]  # in the smaller room
    (tmp_path / "house.yaml").write_text(f"building: plan.png\nstart: [{start[0]}, {start[1]}, 0]\n", "utf-8")
    placed = load_world(tmp_path / "house.yaml")
    assert len(placed.walls) == len(turned.walls) and np.ptp(placed.route_m @ turn, axis=0)[0] > 5.0


def test_a_hall_of_a_thousand_square_metres_and_more_near_its_walls_is_toured_near_the_start(tmp_path, caplog):
    hall = np.zeros((124, 204), np.uint8)
    hall[2:-2, 2:-2] = 255
    path = plan(tmp_path, hall)
    path.with_suffix(".yaml").write_text("image: plan.png\nresolution: 0.8\n", "utf-8")
    world = load_world(path)
    assert "type source.survey_m=" in caplog.text and np.hypot(*np.diff(world.route_m, axis=0).T).sum() <= 60.0


def test_faces_that_count_back_from_the_last_vertex_are_where_they_stand(tmp_path):
    pytest.importorskip("trimesh")
    plain, back = load_world(obj(tmp_path)), load_world(obj(tmp_path, relative=True))
    assert back.bounds_m == plain.bounds_m == pytest.approx((-0.1, -0.1, 8.1, 4.1))
    assert back.mesh is not None and plain.mesh is not None and np.array_equal(back.mesh.corners_m, plain.mesh.corners_m)


@pytest.mark.parametrize("unit, name", [(1000.0, "millimetres"), (100.0, "centimetres"), (1 / 0.0254, "inches")])
def test_a_house_in_another_unit_is_as_large_as_it_is(tmp_path, caplog, unit, name):
    pytest.importorskip("trimesh")
    world = load_world(obj(tmp_path, unit=unit))
    assert world.bounds_m == pytest.approx((-0.1, -0.1, 8.1, 4.1), abs=1e-4) and f"taken as {name}" in caplog.text


def test_numbers_too_coarse_for_where_a_mesh_stands_are_refused(tmp_path):
    """32-bit numbers of 5.6 million are half a metre apart; those of an OBJ are text, and whole."""
    trimesh = pytest.importorskip("trimesh")
    far = [(x0 + 350_000, y0 + 5_600_000, x1 + 350_000, y1 + 5_600_000) for x0, y0, x1, y1 in WALLS]
    path = obj(tmp_path, far)
    assert load_world(path).bounds_m == pytest.approx((349_999.9, 5_599_999.9, 350_008.1, 5_600_004.1))
    trimesh.load(path).export(tmp_path / "house.stl")
    with pytest.raises(ConfigError, match=r"32-bit numbers of this file are 0\.5 m apart"):
        load_world(tmp_path / "house.stl")


def test_a_storey_that_lies_on_its_side_by_its_formats_word_is_stood_up_and_that_is_said(tmp_path, caplog):
    """8.2 x 4.2 m and 2.5 m high, z up, in formats whose y is up: it would be 4.2 m high and 2.5 m deep."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    mesh = trimesh.load(obj(tmp_path))
    upright = pytest.approx((-0.1, -0.1, 8.1, 4.1), abs=1e-4)
    mesh.export(tmp_path / "house.glb")
    (tmp_path / "house.dae").write_bytes(trimesh.exchange.dae.export_collada(mesh))  # says Y_UP of whatever it is
    for name in ("house.glb", "house.dae"):
        caplog.clear()
        assert load_world(tmp_path / name).bounds_m == upright
        assert "taken with z up" in caplog.text and "write up: y in a world file" in caplog.text
    caplog.clear()
    (tmp_path / "told.yaml").write_text("building: house.glb\nup: z\n")
    assert load_world(tmp_path / "told.yaml").bounds_m == upright
    (tmp_path / "tower.yaml").write_text("building: house.glb\nup: y\n")
    assert load_world(tmp_path / "tower.yaml").bounds_m != upright
    assert "on its side" not in caplog.text


def test_a_mesh_that_may_lie_on_its_side_is_pointed_at(tmp_path, caplog):
    """Too deep for a storey: 12.6 m high and 5 m deep, or a hall of 16.4 x 12.6 m."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(obj(tmp_path))
    mesh.apply_scale((2.0, 3.0, 2.0))
    mesh.export(tmp_path / "house.glb")
    load_world(tmp_path / "house.glb")
    assert "write up: z in a world file" in caplog.text and "taken with" not in caplog.text


@pytest.mark.parametrize("lying", [True, False])
def test_a_house_of_two_storeys_on_its_side_is_pointed_at_by_its_floors(tmp_path, caplog, lying):
    """Hardly higher than deep either way (Matterport's and Gibson's .glb have z up); most of it is level as it was built."""
    trimesh = pytest.importorskip("trimesh")
    boxes = [trimesh.creation.box(bounds=[(0, 0, 2.8 * k - 0.1), (9, 7, 2.8 * k)]) for k in range(3)]
    boxes += [trimesh.creation.box(bounds=[(x0, y0, 2.8 * k), (x1, y1, 2.8 * k + 2.6)]) for k in range(2)
              for x0, y0, x1, y1 in ((0, 0, 9, 0.1), (0, 6.9, 9, 7), (0, 0, 0.1, 7), (8.9, 0, 9, 7), (5, 0, 5.1, 3))]
    house = trimesh.util.concatenate(boxes)
    if not lying:
        house.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
    house.export(tmp_path / "house.glb")
    load_world(tmp_path / "house.glb")
    assert ("lies on its side write up: z" in caplog.text) == lying


@pytest.mark.parametrize(("share", "says"), [(0.0, False), (0.004, False), (0.03, True), (-0.03, True)])
def test_a_floor_that_leans_is_said_to(tmp_path, caplog, share, says):
    """3 in 100, as of a scan that was levelled by eye, are 25 cm over 8.2 m: no robot would get through the house."""
    pytest.importorskip("trimesh")
    lines = obj(tmp_path).read_text().splitlines()
    lines += ["v -0.1 -0.1 0", "v 8.1 -0.1 0", "v 8.1 4.1 0", "v -0.1 4.1 0", "f -4 -3 -2 -1"]
    leant = [f"v {x} {y} {float(z) + share * float(x)}" for word, x, y, z in
             (line.split() for line in lines if line[0] == "v") if word]
    (tmp_path / "house.obj").write_text("\n".join([*leant, *(line for line in lines if line[0] == "f")]).replace(
        "f -4 -3 -2 -1", " ".join(["f", *(str(len(leant) - k) for k in (3, 2, 1, 0))])))
    load_world(tmp_path / "house.obj")
    assert ("its floor leans, by 0.25 m from end to end" in caplog.text) == says and ("leans" in caplog.text) == says


def test_a_ramp_is_no_floor_that_leans(tmp_path, caplog):
    """A third of the floor, 6 in 100."""
    pytest.importorskip("trimesh")
    house = obj(tmp_path)
    house.write_text(house.read_text() + "v -0.1 -0.1 0\nv 8.1 -0.1 0\nv 8.1 4.1 0\nv -0.1 4.1 0\nf -4 -3 -2 -1\n"
                     "v 5 0.5 0\nv 7.9 0.5 0.17\nv 7.9 3.9 0.17\nv 5 3.9 0\nf -4 -3 -2 -1\n")
    load_world(house)
    assert "leans" not in caplog.text


def test_a_house_on_a_plinth_is_entered(tmp_path, caplog):
    slab = "<link name='s'><pose>4 2 0.1 0 0 0</pose><visual name='v'><geometry><box><size>8.2 4.2 0.1</size></box>"
    world = load_world(sdf(tmp_path, z=0.15, more=f"{slab}</geometry></visual></link>"))
    assert "floor found at z = 0.15 m" in caplog.text and 0 < world.start[0] < 8 and 0 < world.start[1] < 4
    table = slab.replace("0.1 0 0 0", "0.4 0 0 0").replace("8.2 4.2", "2 2")
    caplog.clear()
    load_world(sdf(tmp_path, more=f"{table}</geometry></visual></link>"))
    assert "floor found" not in caplog.text


def test_a_robot_that_looks_over_the_walls_is_refused(tmp_path):
    sdf(tmp_path)
    (tmp_path / "tall.yaml").write_text("building: house.sdf\ncamera_height_m: 2.8\n")
    with pytest.raises(ConfigError, match=r"tall\.yaml:2: a robot 2\.8 m high looks over this building of 2\.50 m"):
        load_world(tmp_path / "tall.yaml")


def test_a_world_without_places_says_that_nothing_is_patrolled(tmp_path, caplog):
    outer = "[[0, 0], [3, 0], [3, 3], [0, 3], [0, 0]]"
    (tmp_path / "bare.yaml").write_text("start: [1, 1, 0]\nroute_m: [[1, 1], [1.5, 1]]\n"
                                        f"walls: [{{name: o, points_m: {outer}}}]")
    words = [f"world={tmp_path / 'bare.yaml'}", "source.image_width=64", "pictures=off", "recording=off", "ahead=off"]
    assert main([*words, f"output={tmp_path / 'run'}"]) == 0
    assert "names no places, so nothing is patrolled" in caplog.text


def test_a_broken_pose_names_its_file(tmp_path):
    with pytest.raises(ConfigError, match=r"house\.sdf: <pose> is '1 2'"):
        load_world(sdf(tmp_path, more="<link name='x'><pose>1 2</pose></link>"))


@pytest.mark.parametrize("name", ["house.stl", "house.sdf", "plan.png"])
def test_a_file_that_git_lfs_has_not_fetched_says_what_to_type(tmp_path, name):
    plan(tmp_path, drawn())
    (tmp_path / name).write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 12345\n")
    with pytest.raises(ConfigError, match="git lfs pull"):
        load_world(tmp_path / name)


@pytest.mark.parametrize(("change", "said"), [
    ({}, ""), ({"extensionsUsed": ["KHR_draco_mesh_compression"]}, "packed (KHR_draco_mesh_compression); export it again"),
    ({"extensionsUsed": ["EXT_meshopt_compression"]}, "EXT_meshopt"), ({"normalized": True}, "normalized POSITION"),
])
@pytest.mark.parametrize("kind", ["gltf", "glb"])
def test_a_gltf_whose_points_are_packed_says_what_to_do(tmp_path, kind, change, said):
    """trimesh reads them as they are: walls would stand elsewhere."""
    plain = {"asset": {"version": "2.0"}, "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
             "accessors": [{"componentType": 5126, "count": 3, "type": "VEC3"} | {k: v for k, v in change.items()
                                                                                  if k == "normalized"}]}
    text = json.dumps(plain | {k: v for k, v in change.items() if k != "normalized"}).encode()
    head = b"glTF" + struct.pack("<II", 2, 20 + len(text)) + struct.pack("<I", len(text)) + b"JSON"
    path = tmp_path / f"house.{kind}"
    path.write_bytes((head if kind == "glb" else b"") + text)
    with pytest.raises(ConfigError) as error:
        load_world(path)
    assert said in str(error.value) and ("packed" in str(error.value)) == bool(said)


@pytest.mark.parametrize(("name", "text", "said"), [
    ("a.las", "x", "make a mesh of it"), ("a.navmesh", "x", "name the scene's .glb"), ("a.json", "{}", "draw it"),
    ("a.scene_instance.json", "{}", "a scene of Habitat: name its stage's mesh"), ("a.mtl", "x", "name its .obj"),
    ("a.zip", "x", "unpack it first"),
    ("a.world.erb", "<%= 1 %>", "erb a.world.erb > NAME.world"),
    ("a.sdf", "<sdf version='1.6'><include><uri>https://fuel.gazebosim.org/1.0/O/models/Room</uri></include></sdf>",
     "type: gz fuel download -u https://fuel.gazebosim.org/1.0/O/models/Room"),
    ("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
     "0 0 0\n", "make faces of them"),
])
def test_other_buildings_say_what_makes_one_that_is_read(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(ConfigError) as error:
        load_world(tmp_path / name)
    assert said in str(error.value)


def test_a_cut_stl_is_called_so(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.load(obj(tmp_path)).export(tmp_path / "house.stl")
    whole = (tmp_path / "house.stl").read_bytes()
    (tmp_path / "house.stl").write_bytes(whole[:1500])
    with pytest.raises(ConfigError, match="no whole STL file|cannot read this mesh"):
        load_world(tmp_path / "house.stl")


def test_a_long_complaint_keeps_the_files_name_and_what_to_type():
    told = shortened(f"/home/my own {'long/' * 60}house.obj: found nothing; type source.robot_radius_m=", 200)
    assert told == ".../house.obj: found nothing; type source.robot_radius_m="
    assert shortened(f"world=/{'long/' * 60}a.obj: no such file", 200) == "world=.../a.obj: no such file"
    assert shortened("a b " * 100, 20) == "a b a b a b a b a..."
    assert shortened("short", 200) == "short"
