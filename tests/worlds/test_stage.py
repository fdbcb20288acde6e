"""Worlds of Stage: the floor plan stands where its size and pose put it; what cannot be read is refused."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rhs.base.errors import ConfigError
from rhs.worlds.world import load_world

HEAD = 'include "pioneer.inc"\ndefine floorplan model ( color "gray30" boundary 1 )\nresolution 0.02\n'
PLAN = '''floorplan
(
  name "cave"  # bitmap "other.png"
  #bitmap "other.png"
  bitmap "cave.png"
  size [8.000 6.000 0.800]
  pose [1 -2 0 0]
)
pioneer2dx ( pose [ 0 0 0 45.0 ] )
'''


def stage(folder, text, size=(160, 120)):
    """8 x 6 m: walls of a quarter of a metre round a room, a grey that is lighter than Stage's middle on its floor."""
    picture = np.zeros((size[1], size[0]), np.uint8)
    picture[5:-5, 5:-5] = 255
    picture[20:30, 20:30] = 140
    cv2.imwrite(str(folder / "cave.png"), picture)
    (folder / "cave.world").write_text(text)
    return str(folder / "cave.world")


@pytest.mark.parametrize("text", [HEAD + PLAN, HEAD + PLAN.replace("floorplan\n(", "map (").replace("-2 0 0]", "-2 0]")])
def test_a_floor_plan_stands_where_its_size_and_pose_put_it(tmp_path, caplog, text):
    """Its middle at (1, -2): the room from -2.75 to 4.75 and from -4.75 to 0.75 m."""
    world = load_world(stage(tmp_path, text))
    points = np.concatenate([wall.points_m for wall in world.walls])
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [[-2.75, -4.75], [4.75, 0.75]], atol=1e-6)
    assert len(world.walls) == 1 and "robots and other models are left out" in caplog.text


@pytest.mark.parametrize(("text", "said"), [
    (HEAD + "pioneer2dx ( )\n", "a world of Stage without floorplan"),
    (HEAD + PLAN.replace("cave.png", "a.png"), "not there"), (HEAD + PLAN.replace("cave.png", "cave.world"), "no picture"),
    (HEAD + PLAN.replace("6.000", "5.000"), "expected square"),
    (HEAD + PLAN.replace("0 0]", "0 90]"), "turned by 90 degrees"), ("nothing at all", "this XML cannot be read"),
])
def test_what_cannot_be_read_is_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(ConfigError, match=said) as caught:
        load_world(stage(tmp_path, text))
    assert "\n" not in str(caught.value)
