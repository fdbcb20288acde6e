"""Houses of HouseExpo are built from the corners of their floor; folders and broken files are refused in one line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rhs.base.errors import ConfigError
from rhs.worlds.world import load_world

TWO_ROOMS = [[0, 0], [6, 0], [6, 4], [3.2, 4], [3.2, 5], [6, 5], [6, 9], [0, 9], [0, 5], [2.2, 5], [2.2, 4], [0, 4]]


def house(path, verts):
    path.write_text(json.dumps({"verts": verts, "id": "0a1b", "room_num": 2, "room_category": {"Bedroom": [[0, 0, 6, 4]]}}))
    return str(path)


@pytest.mark.parametrize("corner", [(0.0, 0.0), (-3.0125, 7.3)])
def test_a_house_has_its_walls_where_its_corners_are(tmp_path, corner):
    world = load_world(house(tmp_path / "house.json", (np.array(TWO_ROOMS) + corner).tolist()))
    points = np.concatenate([wall.points_m for wall in world.walls])
    away = np.linalg.norm(points[:, None] - (np.array(TWO_ROOMS) + corner), axis=2)
    assert away.min(axis=1).max() < 0.025 and away.min(axis=0).max() < 0.025  # within a cell, and none is missing
    assert {y > corner[1] + 4.5 for _, _, y in world.places} == {True, False}  # the door between them is one


@pytest.mark.parametrize(("text", "said"), [
    ('{"verts": [[0, 0], [6, 0]]}', "expected at least three"), ('{"verts": "a"}', "expected at least three"),
    ('{"verts": [', "expected JSON"), ('{"verts": [[0, 0], [1e6, 0], [1e6, 1e6]]}', "expected metres"),
    ('{"verts": [[0, 0], [0.1, 0], [0.1, 0.1]]}', "no room for a robot"), ('{"rooms": []}', "a plan in numbers"),
])
def test_what_is_no_house_is_refused_in_one_line(tmp_path, text, said):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ConfigError, match=said) as caught:
        load_world(str(tmp_path / "a.json"))
    assert "\n" not in str(caught.value)


def test_a_folder_names_what_is_in_it(tmp_path):
    with pytest.raises(ConfigError, match="is a folder; expected a file"):
        load_world(str(tmp_path))
    (tmp_path / "model.sdf").write_text("<sdf/>")
    with pytest.raises(ConfigError, match=r"is a folder; type world=.*model\.sdf"):
        load_world(str(tmp_path))
