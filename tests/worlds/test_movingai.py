"""MovingAI files, with a map small enough to measure by hand; the octile optimum against our A*."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.worlds.movingai import load_movingai_map, load_scenarios
from rhs.worlds.planning_question import load_arena

MAP = """type octile
height 4
width 5
map
..@..
.G@S.
..T..
.....
"""
# From (0,0) to (4,0): down past the wall and up again without cutting its corner at (2,2): 3 down, 4 across, 3 up, of
# which two pairs can be diagonal: (0,0) (0,1) (1,2) (1,3) (2,3) (3,3) (3,2) (4,1) (4,0) = 6 straight + 2 diagonal.
SCEN = ("version 1\n"
        "0\tsmall.map\t5\t4\t0\t0\t4\t0\t8.82842712\n"
        "0\tsmall.map\t5\t4\t0\t3\t4\t3\t4.0\n")


@pytest.fixture
def files(tmp_path):
    (tmp_path / "small.map").write_text(MAP)
    (tmp_path / "small.map.scen").write_text(SCEN)
    return tmp_path


def test_letters_and_axes(files):
    grid = load_movingai_map(files / "small.map")
    assert grid.shape == (4, 5) and grid.resolution_m == 1.0
    assert [tuple(rc) for rc in np.argwhere(grid.occupied())] == [(0, 2), (1, 2), (2, 2)]
    assert grid.cells([(2.5, 0.5)]).tolist() == [[0, 2]]  # x to the right, y down from the first line


def test_scenarios_give_start_goal_and_claimed_length(files):
    first, second = load_scenarios(files / "small.map.scen")
    assert (first.start, first.goal, first.size) == ((0, 0), (4, 0), (5, 4))
    assert (first.optimal_cells, second.optimal_cells) == (8.82842712, 4.0)
    arena = load_arena(str(files / "small.map.scen"), scenario=1)
    assert arena.start_m.tolist() == [0.5, 3.5] and arena.goal_m.tolist() == [4.5, 3.5] and arena.octile_m == 4.0


@pytest.mark.parametrize(("text", "words"), [
    (MAP.replace("height 4", "height 5"), "rows"), (MAP.replace("..T..", "..T."), ":7: 4 cells"),
    (MAP.replace("map\n", ""), "expected type"), (MAP.replace("width 5", "width -5"), "width"),
    (MAP.replace("width 5", "width 99999").replace("height 4", "height 99999"), "are more than the"), ("", "no line"),
])
def test_broken_maps_are_refused_with_their_line(tmp_path, text, words):
    (tmp_path / "a.map").write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_movingai_map(tmp_path / "a.map")


def test_broken_scenarios_are_refused(files):
    with pytest.raises(ConfigError, match="0 to 1"):
        load_arena(str(files / "small.map.scen"), scenario=2)
    (files / "small.map.scen").write_text("0\tsmall.map\t5\t4\tx\t0\t4\t0\t1\n")
    with pytest.raises(ConfigError, match=":1: expected"):
        load_scenarios(files / "small.map.scen")
    (files / "small.map.scen").write_text("0\tother.map\t5\t4\t0\t0\t4\t0\t1\n")
    with pytest.raises(ConfigError, match="not beside it"):
        load_arena(str(files / "small.map.scen"))
