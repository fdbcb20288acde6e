"""What moves by itself: people heed the robot, doors wait for it, everything is a function of time."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import Box, Moving, Person, Timed
from rhs.worlds.live import NOWHERE_M, Live
from rhs.worlds.world import load_world
from rhs.worlds.world_moving import walkers

FAR = np.array([100.0, 100.0, 0.3])
LINE = np.array([[0.0, 0.0], [4.0, 0.0]])  # closed: there and back, 8 m


def live(*people, robot=FAR, patrol=True, timed=(), light=()):
    return Live(Moving(people, timed, light), np.array(robot), patrol=patrol)


def test_a_person_walks_at_the_speed_there_and_back():
    one = live(Person("a", LINE, speed_mps=0.5))
    for seconds, x in ((2.0, 1.0), (4.0, 3.0), (4.0, 3.0), (6.0, 0.0)):
        one.step(seconds, FAR)
        assert one.stands()[0].x_m == pytest.approx(x, abs=1e-9)
        assert one.stands()[0].y_m == pytest.approx(0.0, abs=1e-9)


def test_a_person_stands_at_a_corner_as_long_as_said():
    one = live(Person("a", LINE, speed_mps=1.0, pauses_s=(0.0, 2.0)))
    one.step(4.0, FAR)
    assert one.stands()[0].x_m == pytest.approx(4.0)
    one.step(1.9, FAR)
    assert one.stands()[0].x_m == pytest.approx(4.0)
    one.step(1.1, FAR)
    assert one.stands()[0].x_m == pytest.approx(3.0, abs=0.06)


def test_a_person_stands_before_the_robot_and_turns_round_after_a_while():
    """Robot of 0.3 m at x = 3, person of 0.4 m keeps 0.4 m: the middle stays at 3 - 0.3 - 0.4 - 0.2 = 2.1 m."""
    robot = np.array([3.0, 0.0, 0.3])
    one = live(Person("a", LINE, speed_mps=1.0, patience_s=3.0), robot=robot)
    one.step(4.0, robot)
    assert 2.04 <= one.stands()[0].x_m <= 2.1 + 1e-9
    one.step(2.5, robot)
    assert one.stands()[0].x_m < 1.1


def test_nobody_steps_nearer_to_a_robot_than_they_keep():
    rng = np.random.default_rng(0)
    robot = np.array([2.0, 0.9, 0.3])
    people = [Person("a", LINE, speed_mps=1.2), Person("b", LINE, start_m=5.0, keep_m=0.2),
              Person("c", LINE, start_m=2.5, shy=True)]
    some = live(*people, robot=robot)
    for _ in range(400):
        before = [walk.gap_m(walk.at_m, robot) for walk in some.walks]
        some.step(0.05, robot)
        for walk, was in zip(some.walks, before, strict=True):
            now = walk.gap_m(walk.at_m, robot)
            assert now >= walk.person.keep_m - 1e-9 or now >= was - 1e-9
        robot[:2] += rng.uniform(-0.03, 0.03, 2)


def test_people_make_way_for_a_camera_that_is_led_and_are_away_where_they_do_not_walk_in_the_survey():
    robot = np.array([2.0, 0.0, 0.3])
    some = live(Person("a", LINE, start_m=1.9, survey=True), Person("b", LINE), robot=robot, patrol=False)
    assert some.walks[0].gap_m(some.walks[0].at_m, robot) >= 0.4
    assert [stand.bottom_m for stand in some.stands()] == [0.0, NOWHERE_M]


def test_the_same_steps_lead_to_the_same_stands():
    def end():
        some = live(Person("a", LINE, pauses_s=(1.0, 0.5)), Person("b", LINE, start_m=3.0, shy=True))
        for k in range(50):
            some.step(0.3, np.array([0.1 * k, 0.2, 0.25]))
        return some.stands()

    assert end() == end()


def test_a_thing_comes_and_goes_at_its_times_and_waits_for_the_robot():
    parcel = Timed(Box("parcel", (1.0, 0.0), (0.4, 0.4, 0.4)), ((1.5, 3.5),), every_s=10.0)
    some = live(timed=(parcel,))
    there = []
    for _ in range(14):
        some.step(1.0, FAR)
        there.append(some.stands()[0].bottom_m == 0.0)
    assert [k + 1 for k, is_there in enumerate(there) if is_there] == [2, 3, 12, 13]
    stood = live(timed=(parcel,), robot=(1.2, 0.0, 0.3))
    stood.step(3.0, np.array([1.2, 0.0, 0.3]))
    assert stood.stands()[0].bottom_m == NOWHERE_M
    stood.step(0.1, FAR)
    assert stood.stands()[0].bottom_m == 0.0


def test_light_is_a_straight_line_between_its_times_and_the_survey_has_that_of_its_beginning():
    lit = live(light=((0.0, 1.0), (10.0, 0.5)))
    lit.step(5.0, FAR)
    assert lit.brightness == pytest.approx(0.75)
    surveyed = live(light=((0.0, 1.0), (10.0, 0.5)), patrol=False)
    surveyed.step(5.0, FAR)
    assert surveyed.brightness == 1.0


WORLD = """
like: square_small
{}
"""


@pytest.mark.parametrize(("text", "says"), [
    ("people: [{name: a, path_m: [[1, 1], [7, 7]]}]", "PATH_OCCUPIED"),
    ("people: [{name: a, path_m: [[20, 20], [21, 20]]}]", "PATH_OUTSIDE_MAP"),
    ("people: [{name: a, path_m: [[1, 1], [1, 1]]}]", "same point twice"),
    ("people: [{name: a, path_m: [[1, 1], [2, 1]]}, {name: a, path_m: [[1, 1], [2, 1]]}]", "named 'a'"),
    ("doors: [{name: d, hinge_m: [0, 4], closed_deg: 0, open_deg: 90, closed_s: [[5, 2]]}]", "each later"),
    ("timed: [{name: t, centre_m: [3, 1], size_m: [0.4, 0.4, 1], stands_s: [[0, 5]]}]", "robot's radius"),
    ("doors: [{name: d, hinge_m: [4, 0.1], width_m: 1.8, closed_deg: 0, open_deg: 90, closed_s: [[5, 9]]}]",
     "ROUTE_OCCUPIED: the leg from .* goes through box 'd', which is there in the survey"),
    ("light_s: [[0, 9]]", "brightness of 0.05 to 3"),
])
def test_what_cannot_move_so_is_refused(tmp_path, text, says):
    (tmp_path / "w.yaml").write_text(WORLD.format(text))
    with pytest.raises(ConfigError, match=says):
        load_world(tmp_path / "w.yaml")


def test_a_file_with_all_of_it_is_read(tmp_path):
    (tmp_path / "w.yaml").write_text(WORLD.format("""
people:
  - {name: anna, path_m: [[1, 2], [1, 6]], speed_mps: 0.6, pauses_s: [0, 3], start_m: 2, patience_s: 1, survey: true}
  - {name: cat, path_m: [[3, 7], [6, 7]], width_m: 0.25, height_m: 0.3, keep_m: 0.2, shy: true}
doors:
  - {name: gate, hinge_m: [6, 4], width_m: 1.9, closed_deg: 0, open_deg: 85, closed_s: [[10, 30]], every_s: 60}
timed:
  - {name: parcel, centre_m: [4, 6.4], size_m: [0.4, 0.4, 0.4], stands_s: [[20, 90]], otherwise: [2.5, 6.4, 0]}
light_s: [[0, 1], [60, 0.4]]"""))
    moving = load_world(tmp_path / "w.yaml").moving
    assert [person.name for person in moving.people] == ["anna", "cat"] and moving.people[0].pauses_s == (0.0, 3.0)
    gate, parcel = moving.timed
    assert gate.at(0.0).yaw_rad == pytest.approx(np.radians(85)) and gate.at(70.0).centre_m == pytest.approx((6.95, 4.0))
    assert parcel.at(0.0).centre_m == (2.5, 6.4) and parcel.at(20.0).centre_m == (4.0, 6.4)
    assert moving.brightness(30.0) == pytest.approx(0.7)


@pytest.mark.parametrize("path", [[1.0, 2.0, 3.0], [1.0, 2.0], [1.0, 2.0, float("nan"), 3.0], [1.0, 2.0, 1.0, 2.0]])
def test_a_path_from_the_command_line_is_pairs_of_metres(path):
    with pytest.raises(ConfigError, match="people="):
        walkers([path])
