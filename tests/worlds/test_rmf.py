"""Buildings of Open-RMF's traffic editor: walls stand where its own generator puts them; what cannot be read is refused."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from rhs.base.errors import ConfigError
from rhs.worlds.world import load_world

CORNERS = [[100, 100], [500, 100], [500, 400], [100, 400], [300, 100], [300, 220], [300, 280], [300, 400]]
WALLS = [[0, 1], [1, 2], [2, 3], [3, 0], [4, 5], [6, 7]]  # two rooms of 4 x 6 m; 1.2 m between 5 and 6 is a door


def building(path, *, scale=1.0, level=None, **more):
    """Two rooms of 4 x 6 m drawn with 50 pixels a metre."""
    told = {"vertices": [[x * scale, y * scale, 0, "", {}] for x, y in CORNERS], "elevation": 0,
            "walls": [[a, b, {"texture_name": [1, "default"]}] for a, b in WALLS],
            "doors": [[5, 6, {"name": [1, "d"], "type": [1, "hinged"]}]],
            "floors": [{"parameters": {}, "vertices": [0, 1, 2, 3]}], "measurements": [[0, 1, {"distance": [3, 8.0]}]],
            "models": [{"model_name": "OpenRobotics/Fridge", "x": 1, "y": 2, "yaw": 0}]} | (level or {})
    plain = {"coordinate_system": "reference_image", "name": "flat", "levels": {"L1": told, "L2": {"vertices": []}}} | more
    path.write_text(yaml.safe_dump(plain))
    return str(path)


@pytest.mark.parametrize("scale", [1.0, 3.7])
def test_walls_are_a_tenth_of_a_metre_thick_and_y_of_the_drawing_points_down(tmp_path, caplog, scale):
    """Between the walls: 2.05 to 9.95 m and -7.95 to -2.05 m, a partition from 5.95 to 6.05 m with a door of 1.1 m."""
    world = load_world(building(tmp_path / "flat.building.yaml", scale=scale))
    points = np.concatenate([wall.points_m for wall in world.walls])
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [[2.05, -7.95], [9.95, -2.05]], atol=0.051)
    ends = points[(abs(points[:, 0] - 6.0) < 0.2) & (abs(points[:, 1] + 5.0) < 1.0)]
    np.testing.assert_allclose(np.unique(ends.round(6), axis=0), [[x, y] for x in (5.95, 6.05) for y in (-5.55, -4.45)],
                               atol=0.051)
    assert {x > 6.0 for _, x, _ in world.places} == {True, False}
    assert "level L1, its doors open; left out: levels 1, models 1" in caplog.text


def test_metres_have_y_up_and_a_hole_in_the_floor_is_no_floor(tmp_path):
    metres = {"vertices": [[x / 50, y / 50, 0, ""] for x, y in [*CORNERS, [120, 120], [280, 120], [280, 380], [120, 380]]],
              "measurements": [], "holes": [{"vertices": [8, 9, 10, 11]}]}
    world = load_world(building(tmp_path / "flat.yaml", coordinate_system="cartesian_meters", level=metres))
    points = np.concatenate([wall.points_m for wall in world.walls])
    assert 2.0 < points[:, 1].min() < 2.1 and 7.9 < points[:, 1].max() < 8.0
    assert min(x for _, x, _ in world.places) > 6.0


def test_without_a_floor_what_the_walls_enclose_is_one(tmp_path):
    world = load_world(building(tmp_path / "flat.yaml", level={"floors": []}))
    assert all(2.0 < x < 10.0 and -8.0 < y < -2.0 for _, x, y in world.places)


@pytest.mark.parametrize(("change", "said"), [
    ({"level": {"measurements": []}}, "draw a measurement in the traffic editor"),
    ({"level": {"walls": []}}, "it has no walls"), ({"level": {"vertices": "a"}}, "cannot be read"),
    ({"level": {"walls": [[0, 99, {}]]}}, "level L1 of RMF.*cannot be read"),
    ({"level": {"measurements": [[0, 1, {"distance": [3, 8e6]}]]}}, "it spans"),
    ({"coordinate_system": "web_mercator"}, "web_mercator.*expected reference_image or cartesian_meters"),
    ({"reference_level_name": "L7"}, "level L7"), ({"levels": {}}, "levels holds no level"),
])
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, change, said):
    with pytest.raises(ConfigError, match=said) as caught:
        load_world(building(tmp_path / "a.building.yaml", **change))
    assert "\n" not in str(caught.value)


def test_a_level_without_room_is_refused_in_words_of_its_own(tmp_path):
    with pytest.raises(ConfigError, match="no room for a robot of radius 0.2 m"):
        load_world(building(tmp_path / "a.building.yaml", level={"measurements": [[0, 1, {"distance": [3, 0.8]}]]}))
