"""How wide the way to each place is, against gaps of known width, and how many places the row says can be reached."""

import json
import math

import numpy as np
import pytest
from helpers.synthetic_run import make_run

from rhs.metrics.evaluate import evaluate
from rhs.worlds.reach import reach
from rhs.worlds.world import load_world

ROOMS = """\
start: [1.0, 2.0, 0]
robot_radius_m: 0.25
route_m: [[1, 2], [1.5, 2]]
places:
  here: [1, 3]
  next_door: [5, 2]
  shut_in: [9, 2]
walls:
  - {{name: rooms, points_m: [[0, 0], [10, 0], [10, 4], [0, 4], [0, 0]]}}
  - {{name: below, points_m: [[3, 0], [{x}, {y}]]}}
  - {{name: above, points_m: [[3, 4], [3, 2.3]]}}
  - {{name: shut, points_m: [[7, 0], [7, 1.5]]}}
obstacles:
  - {{name: crate, centre_m: [7, 2.75], size_m: [0.4, 2.48, 1.0]}}
"""


@pytest.mark.parametrize("x, y, gap_m", [(3.0, 1.72, 0.58), (3.0, 1.777, 0.523), (3.3, 1.9, 0.5)])
def test_the_widest_way_to_a_place_is_as_wide_as_the_gap_it_leads_through(tmp_path, x, y, gap_m):
    """The gap lies between the ends of two walls: on the lattice or off it, straight or slanting."""
    (tmp_path / "rooms.yaml").write_text(ROOMS.format(x=x, y=y))
    world = load_world(tmp_path / "rooms.yaml")
    room_m, unsure_m = reach(world, np.array([1.5, 2.0]), within_m=0.1)
    assert unsure_m == pytest.approx(0.0141, abs=1e-4)
    assert abs(room_m[1] - 0.5 * gap_m) <= unsure_m
    assert room_m[0] > 0.6 and room_m[2] < unsure_m, "the crate shuts the gap of the third wall, but for a centimetre"


def test_the_row_counts_what_is_wide_enough_for_the_robot_and_what_nobody_can_tell(tmp_path):
    """The robot of the run is 0.3 m in radius; the run has two places."""
    folder = make_run(tmp_path / "run")
    row = evaluate(folder)
    assert math.isnan(row["places_reachable"]) and math.isnan(row["places_undecided"]), "nobody knows the true plan"
    for rooms_m, counted in (((0.32, 0.5), (2, 0)), ((0.31, 0.5), (1, 1)), ((0.29, 0.28), (0, 1))):
        places = [{"name": name, "room_m": room_m} for name, room_m in zip(("east", "north"), rooms_m, strict=True)]
        (folder / "reach.json").write_text(json.dumps({"unsure_m": 0.0141, "places": places}))
        row = evaluate(folder)
        assert (row["places_reachable"], row["places_undecided"]) == counted


def test_a_robot_that_is_not_round_gets_surely_where_its_circle_does_and_perhaps_where_its_width_does(tmp_path):
    folder = make_run(tmp_path / "run")
    facts = json.loads((folder / "facts.json").read_text())
    facts["footprint_m"] = [[0.25, 0.15], [-0.25, 0.15], [-0.25, -0.15], [0.25, -0.15]]
    (folder / "facts.json").write_text(json.dumps(facts))
    places = [{"name": "east", "room_m": 0.2}, {"name": "north", "room_m": 0.12}]
    (folder / "reach.json").write_text(json.dumps({"unsure_m": 0.0141, "places": places}))
    row = evaluate(folder)
    assert (row["places_reachable"], row["places_undecided"]) == (0, 1)
