"""Worlds of Webots: walls of its library and plain nodes stand where Webots puts them; what lies in other files is named."""

from __future__ import annotations

import numpy as np
import pytest
from test_foreign_buildings import BOXES, assert_room, write

from rhs.base.errors import ConfigError
from rhs.worlds.others.webots import read_webots
from rhs.worlds.world import load_world

HEAD = '#VRML_SIM R2023b utf8\nEXTERNPROTO "webots://projects/objects/apartment_structure/protos/Wall.proto"\n'
OLD = "#VRML_SIM R2021b utf8\n"


def room(*, z_up: bool) -> str:
    """BOXES: walls as walls, whose origin is on the floor, the others as solids. With y up, y goes to -z."""
    def three(x, y, z):
        return f"{x} {y} {z}" if z_up else f"{x} {z} {-y}"

    def size(a, b, c):
        return f"{a} {b} {c}" if z_up else f"{a} {c} {b}"

    out = ["WorldInfo { info [ \"a room\" ] basicTimeStep 16 }", "Viewpoint { position 0 0 9 }", "TexturedBackground { }",
           f"Floor {{ size {size(20, 20, 1)} }}"]
    for name, (spans, (x, y, z)) in BOXES.items():
        if name in ("chest", "table"):
            red = f"Shape {{ appearance PBRAppearance {{ baseColor 1 0 0 }} geometry Box {{ size {size(*spans)} }} }}"
            out.append(f"DEF {name} Solid {{ translation {three(x, y, z)} children [ {red} ] hidden translation_1 0 0 0 }}")
        else:
            out.append(f"Wall {{ translation {three(x, y, 0)} size {size(*spans)} appearance Roughcast {{ }} name \"w\" }}")
    return "\n".join(out)


@pytest.mark.parametrize("text", [HEAD + room(z_up=True), OLD + room(z_up=False),
                                  OLD + room(z_up=True).replace("basicTimeStep 16", 'coordinateSystem "ENU"')])
def test_a_room_has_its_walls_where_they_stand(tmp_path, text):
    """The version says which way is up, where WorldInfo does not."""
    assert_room(load_world(write(tmp_path / "room.wbt", text)))


def extent(tmp_path, text, name="a.wbt"):
    parts, missing, robots = read_webots(write(tmp_path / name, text))
    points = np.concatenate([one.corners_m.reshape(-1, 3) for one in parts]) if parts else np.zeros((0, 3))
    return [*points.min(axis=0).round(6), *points.max(axis=0).round(6)] if parts else [], missing, robots


def test_an_arena_has_its_walls_outside_its_floor(tmp_path):
    arena = "RectangleArena { translation 1 0 0 floorSize 4 2 wallThickness 0.1 wallHeight 0.5 }"
    assert extent(tmp_path, HEAD + arena)[0] == [-1.1, -1.1, 0.0, 3.1, 1.1, 0.5]
    parts, _, _ = read_webots(write(tmp_path / "b.wbt", HEAD + arena))
    points = np.concatenate([one.corners_m.reshape(-1, 3) for one in parts])
    assert not ((np.abs(points[:, 0] - 1.0) < 1.99) & (np.abs(points[:, 1]) < 0.99)).any()


def test_a_door_that_opens_is_open_and_one_that_does_not_is_a_wall(tmp_path):
    door = "Door { translation 0 3 0 size 0.2 1 2.4 %s }"
    assert extent(tmp_path, HEAD + door % "canBeOpen FALSE")[0] == [-0.1, 2.5, 0.0, 0.1, 3.5, 2.4]
    assert extent(tmp_path, HEAD + door % "") == ([], [], [])


def test_cylinders_stand_upright_with_either_axis(tmp_path):
    post = "Solid { translation 0 0 0 children [ Shape { geometry Cylinder { radius 0.5 height 3 } } ] }"
    for head in (HEAD, OLD):
        low, high = np.split(np.array(extent(tmp_path, head + post)[0]), 2)
        np.testing.assert_allclose(high - low, [1.0, 1.0, 3.0], atol=1e-6)


def test_what_lies_in_other_files_is_named_and_robots_are_left_out(tmp_path):
    text = HEAD + ("Chair { translation 1 2 0 physics Physics { } } Sofa { } CeilingLight { translation 0 0 2 } "
                   'Robot { name "mine" children [ Shape { geometry Box { size 1 1 1 } } ] } '
                   'Pioneer3at { translation 0 0 0 controller "avoid" }')
    assert extent(tmp_path, text) == ([], ["Chair", "Sofa"], ["mine", "Pioneer3at"])
    with pytest.raises(ConfigError, match="nothing to see in this file; missing: Chair"):
        load_world(str(tmp_path / "a.wbt"))


@pytest.mark.parametrize(("text", "said"), [
    ("#VRML V2.0 utf8\n", "expected '#VRML_SIM R2023b utf8'"), ("", "expected '#VRML_SIM"),
    (HEAD + "Wall { size 1 2 }", "Wall size has 2 numbers"), (HEAD + "Wall {", "found 'the end'"),
    (HEAD + "Solid { children [ " * 300, "more than 200 nodes in one another"),
])
def test_what_is_broken_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said) as caught:
        load_world(write(tmp_path / "a.wbt", text))
    assert "\n" not in str(caught.value)
