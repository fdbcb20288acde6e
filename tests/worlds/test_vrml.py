"""VRML97: shapes where their transforms put them, concave polygons, what they wear, and what is refused with which words."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from test_foreign_buildings import BOXES, assert_room, write

from rhs.api.errors import ConfigError
from rhs.worlds.triangulate import triangulated
from rhs.worlds.vrml import read_vrml
from rhs.worlds.world import load_world

HEADER = "#VRML V2.0 utf8\n"


def shape(geometry: str, appearance: str = "") -> str:
    return f"Shape {{ {appearance} geometry {geometry} }}"


def room(scale: float = 1.0) -> str:
    """BOXES with y up: x stays, y goes to -z, z to y; each stands where a Transform puts it, in a comment's company."""
    shapes = [f"Transform {{ translation {x * scale} {z * scale} {-y * scale} # {name} {{\n children [ "
              f"{shape(f'Box {{ size {a * scale} {c * scale} {b * scale} }}')} ] }}"
              for name, ((a, b, c), (x, y, z)) in BOXES.items()]
    slab = shape(f"Box {{ size {6.2 * scale} {0.1 * scale} {4.2 * scale} }}")
    floor = f"Transform {{ translation 0, {-0.05 * scale}, 0 children {slab} }}"
    return HEADER + "Group { children [ " + "\n".join([*shapes, floor]) + " ] }\nViewpoint { position 0 1 9 }\n"


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_a_room_has_its_walls_where_they_stand(tmp_path, scale):
    """In metres, and in the millimetres of a CAD program."""
    assert_room(load_world(write(tmp_path / "room.wrl", room(scale))))


def corners(tmp_path: Path, text: str) -> np.ndarray:
    parts, missing = read_vrml(write(tmp_path / "a.wrl", HEADER + text))
    assert not missing
    return np.concatenate([one.corners_m for one in parts])


def area(triangles: np.ndarray) -> float:
    across = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return 0.5 * float(np.linalg.norm(across, axis=1).sum())


def test_a_transform_is_scaled_about_its_centre_turned_and_then_moved(tmp_path):
    """A point at (2, 0, 0), scale 3 about (1, 0, 0): (4, 0, 0); a quarter turn about y there: (1, 0, -3); moved by y 5."""
    text = ("Transform { center 1 0 0 scale 3 1 1 rotation 0 2 0 1.5707963267948966 translation 0 5 0 children "
            + shape("IndexedFaceSet { coord Coordinate { point [2 0 0, 1 0 0, 1 1 0] } coordIndex [0, 1, 2, -1] }") + " }")
    assert corners(tmp_path, text)[0] == pytest.approx(np.array([[1, 5, -3], [1, 5, 0], [1, 6, 0]]), abs=1e-9)


@pytest.mark.parametrize("turn", [np.eye(3), np.eye(3)[[1, 2, 0]], np.eye(3)[[2, 0, 1]], -np.eye(3)])
@pytest.mark.parametrize("order", [1, -1])
def test_a_concave_polygon_keeps_its_area(turn, order):
    """A U of 3 x 3 less the notch of 1 x 2: 7; a fan would cover the notch."""
    flat = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], float)[::order]
    points = np.column_stack([flat, np.zeros(8)]) @ turn.T
    slots, face = triangulated(points, np.array([*range(8), -1]), convex=False)
    assert len(slots) == 6 and set(face) == {0}
    assert area(points[slots]) == pytest.approx(7.0)


def test_several_polygons_keep_their_corners_and_numbers():
    index = np.array([0, 1, 2, 3, -1, 4, 5, -1, 0, 2, 3])  # four corners, two (no polygon), three without an end
    slots, face = triangulated(np.zeros((6, 3)), index, convex=True)
    assert sorted(map(tuple, index[slots].tolist())) == [(0, 1, 2), (0, 2, 3), (0, 2, 3)]
    assert sorted(face.tolist()) == [0, 0, 2]


def test_shapes_have_the_area_of_their_formulas(tmp_path):
    assert area(corners(tmp_path, shape("Box { size 1 2 3 }"))) == pytest.approx(22.0)
    assert area(corners(tmp_path, shape("Cylinder { radius 1 height 2 }"))) == pytest.approx(6.0 * np.pi, rel=0.01)
    assert area(corners(tmp_path, shape("Cone { bottomRadius 3 height 4 }"))) == pytest.approx(24.0 * np.pi, rel=0.01)
    assert area(corners(tmp_path, shape("Sphere { radius 2 }"))) == pytest.approx(16.0 * np.pi, rel=0.02)
    grid = corners(tmp_path, shape("ElevationGrid { xDimension 3 zDimension 2 xSpacing 2 height [0 0 0 1 1 1] }"))
    assert area(grid) == pytest.approx(4.0 * np.sqrt(2.0)) and grid[..., 1].max() == 1.0
    tall = corners(tmp_path, shape("Cylinder { radius 1 height 8 }"))
    assert np.ptp(tall.reshape(-1, 3), axis=0) == pytest.approx([2.0, 8.0, 2.0], abs=0.02)


def test_what_is_defined_once_is_used_again_and_a_switch_shows_its_choice(tmp_path):
    text = ("DEF WALL " + shape("Box { }") + " Transform { translation 9 0 0 children [ USE WALL ] }"
            "Switch { whichChoice -1 choice [ USE WALL ] } LOD { level [ USE WALL, Group { } ] }")
    assert len(corners(tmp_path, text)) == 3 * 12


def test_colours_and_pictures_are_worn(tmp_path):
    picture = np.zeros((4, 4, 3), np.uint8)
    picture[:2] = (0, 0, 255)  # the upper half red, as OpenCV writes it
    cv2.imwrite(str(tmp_path / "red, over black.png"), picture)
    quad = "coord Coordinate { point [0 0 0, 1 0 0, 1 1 0, 0 1 0] } coordIndex [0 1 2 3 -1]"
    material = "appearance Appearance { material Material { diffuseColor 1 0.5 0 transparency 0 } "
    text = (shape(f"IndexedFaceSet {{ {quad} }}", material + "}")
            + shape(f"IndexedFaceSet {{ {quad} texCoord TextureCoordinate {{ point [0 0, 1 0, 1 1, 0 1] }} }}",
                    material + 'texture ImageTexture { url [ "nowhere.png" "red, over black.png" ] } }')
            + shape(f"IndexedFaceSet {{ {quad} color Color {{ color [0 0 1] }} colorPerVertex FALSE }}"))
    plain, worn, blue = read_vrml(write(tmp_path / "a.wrl", HEADER + text))[0]
    assert set(map(tuple, plain.colours.tolist())) == {(255, 127, 0)}
    assert worn.image is not None and worn.uv is not None and tuple(worn.image[0, 0]) == (255, 0, 0)
    assert worn.uv[0].tolist() == [[0, 0], [1, 0], [1, 1]]
    assert set(map(tuple, blue.colours.tolist())) == {(0, 0, 255)}


def test_what_is_missing_or_not_read_is_named_and_the_rest_kept(tmp_path):
    write(tmp_path / "wall.wrl", HEADER + shape("Box { }"))
    text = ('Inline { url "wall.wrl" } Inline { url ["http://example.org/x.wrl"] } ' + shape("Extrusion { spine [0 0 0] }")
            + shape("Box { }", 'appearance Appearance { texture ImageTexture { url "gone.png" } }'))
    parts, missing = read_vrml(write(tmp_path / "a.wrl", HEADER + text))
    assert len(parts) == 2 and missing == ["http://example.org/x.wrl", "Extrusion", "gone.png"]


LAUGHS = "".join(f"DEF N{k} Group {{ children [ {f'USE N{k - 1} ' * 10} ] }}\n" for k in range(1, 12))


@pytest.mark.parametrize(("text", "words"), [
    ("#VRML V1.0 ascii\n", "begins with '#VRML V1.0 ascii'; expected '#VRML V2.0 utf8'"), ("", "expected '#VRML V2.0 utf8'"),
    (HEADER, "no triangles in this file"), (HEADER + "Group { children [ ", "it ends within ]"),
    (HEADER + "USE nobody", "USE nobody: nothing of that name"),
    (HEADER + "PROTO a [ ] { }", "PROTO: nodes that a file defines"),
    (HEADER + shape("IndexedFaceSet { coord Coordinate { point [0 0 0] } coordIndex [0 1 2] }"), "asks for point 2 of 1"),
    (HEADER + shape("Box { size 1 2 }"), "expected threes"),
    (HEADER + "Group { children [" * 400, "nodes in one another"),
    (HEADER + "DEF a Group { children [ USE a ] }", "one holds itself"),
    (HEADER + "DEF N0 " + shape("Box { }") + LAUGHS, "more than"),
])
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, text, words):
    path = write(tmp_path / "broken.wrl", text)
    with pytest.raises(ConfigError) as caught:
        load_world(path)
    assert words in str(caught.value) and "\n" not in str(caught.value) and "broken.wrl" in str(caught.value)
