"""Laws of drawn buildings: each is one that a robot can be led and driven through, and the same one every time."""

import hashlib
import json
from dataclasses import asdict, replace
from functools import lru_cache

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import after, distance_m, truth_grid
from rhs.cli.main import main
from rhs.config.compose import compose_config, from_plain, to_plain
from rhs.patrol.observers import unwatched
from rhs.patrol.run import RunContext
from rhs.worlds.random.building import _world, free_space, random_world, solid_m
from rhs.worlds.random.looks import looks
from rhs.worlds.random.names import FAMILIES, Named, building_of, parse
from rhs.worlds.random.obstacles import reached
from rhs.worlds.random.shapes import nearest_gap_m, polygon_gaps_m, shifted_sides, within
from rhs.worlds.random.sketch import Sketch
from rhs.worlds.tour import Ground
from rhs.worlds.world import load_world

BUILDINGS = [(family, number) for family in FAMILIES for number in range(4)]
laws = pytest.mark.parametrize(("family", "number"), BUILDINGS)


@lru_cache
def building(family: str, number: int, word: str = ""):
    return random_world(f"random:{family}{word}/{number}")


def written(world) -> str:
    """All that a world is, as text."""
    drawn = {key: value for key, value in asdict(world).items() if key != "footprint"}  # a robot that is drawn is round
    return json.dumps(drawn, default=lambda value: value.tolist() if hasattr(value, "tolist") else str(value))


def along(route: np.ndarray, step_m: float = 0.05) -> np.ndarray:
    return np.concatenate([a + np.linspace(0, 1, 2 + int(np.hypot(*(b - a)) / step_m))[:, None] * (b - a)
                           for a, b in zip(route[:-1], route[1:], strict=True)])


@laws
def test_every_place_is_reached_from_the_start(family, number):
    """Three to six places, `home` last, each with room for the robot to stand and a way there that is 5 cm wider than it."""
    world = building(family, number, "+plain")
    names = [name for name, _, _ in world.places]
    assert 3 <= len(names) <= 6 and len(set(names)) == len(names) and names[-1] == "home"
    assert reached(world, radius_m=world.robot_radius_m + 0.05) == names
    for _, x, y in world.places:
        assert distance_m(world, np.array([x, y]))[0] >= world.robot_radius_m + 0.1


@laws
def test_the_survey_keeps_its_distance_and_comes_back(family, number):
    """Walls, furniture and what hangs in the air alike; it passes every place, and is once more where it began."""
    world = building(family, number)
    route = along(world.route_m)
    assert nearest_gap_m(route, solid_m(world)).min() >= world.robot_radius_m + 0.1 - 1e-9
    grid = truth_grid(world)
    cells = grid.cells(route)
    assert (grid.probability[cells[:, 0], cells[:, 1]] == 0.0).all()
    for name, x, y in world.places:
        assert np.hypot(*(route - (x, y)).T).min() <= 0.35, name
    assert np.hypot(*(route[len(route) // 2 :] - world.start[:2]).T).min() < 0.1


@laws
def test_the_survey_sees_the_building(family, number):
    """A camera of 50 degrees that looks ahead sees at least 87 % of what can be seen from anywhere (on average 95 %)."""
    world = building(family, number)
    ground = Ground(*free_space(world), world.robot_radius_m + 0.1, world.start)
    ground.viewpoints()
    seen = ground.seen_ahead(world.route_m)
    assert (seen & ground.needed).sum() >= 0.87 * ground.needed.sum()


@laws
def test_no_wall_is_a_point_and_nothing_has_no_size(family, number):
    world = building(family, number)
    assert min(np.hypot(*np.diff(wall.points_m, axis=0).T).min() for wall in world.walls) >= 0.02
    assert min(min(box.size_m) for box in world.boxes + world.obstacles) > 0.0 if world.boxes + world.obstacles else True
    assert all(box.bottom_m < world.camera_height_m for box in world.boxes)
    assert max(wall.height_m for wall in world.walls) > world.camera_height_m + 0.5


@laws
def test_obstacles_leave_the_robot_and_the_places_alone(family, number):
    """None stands on the start, the place where the robot waits or a place; only a barrier may cut places off."""
    world = building(family, number, "+obstacles")
    assert world.obstacles
    keep = np.array([world.start[:2], world.route_m[-1], *(place[1:] for place in world.places)])
    for box in world.obstacles:
        assert polygon_gaps_m(box.corners_m, np.stack([keep, keep], axis=1)).min() >= world.robot_radius_m + 0.14
        if not box.name.startswith("barrier"):
            assert 0.3 <= min(box.size_m[:2]) and max(box.size_m[:2]) <= 0.6
    can = reached(after(world), radius_m=world.robot_radius_m + 0.05)
    if not any(box.name.startswith("barrier") for box in world.obstacles):
        assert can == [name for name, _, _ in world.places]


@pytest.mark.parametrize("family", FAMILIES)
def test_a_building_is_a_function_of_its_family_and_number(family):
    """`+plain` and `+obstacles` are the same building with other obstacles; other numbers are other buildings."""
    first = written(building(family, 1))
    _world.cache_clear()
    assert written(random_world(f"random:{family}", 1)) == first == written(load_world(f"random:{family}", seed=1))
    plain, full = building(family, 1, "+plain"), building(family, 1, "+obstacles")
    bare = replace(full, obstacles=(), name=plain.name, path=plain.path)
    assert not plain.obstacles and written(bare) == written(plain)
    shapes = {written(replace(building(one, number), name="", seed=0)) for one, number in BUILDINGS if one == family}
    assert len(shapes) == 4


@laws
def test_people_walk_where_there_is_room_for_them(family, number):
    """The same building; nobody comes nearer to a wall or a box than 10 cm, nor begins beside the waiting robot."""
    world, plain = building(family, number, "+people"), building(family, number, "+plain")
    assert written(replace(world, moving=plain.moving, name="", path=plain.path)) == written(replace(plain, name=""))
    assert len(world.moving.people) <= 3 and not world.obstacles
    for person in world.moving.people:
        path = along(np.vstack([person.path_m, person.path_m[:1]]))
        assert nearest_gap_m(path, solid_m(world)).min() >= 0.5 * person.width_m + 0.1
        assert np.hypot(*(person.path_m[0] - world.route_m[-1])) >= 1.5
        assert person.shy == person.name.startswith("pet")


def test_most_buildings_with_people_have_some():
    """22 of 24 at the least."""
    assert sum(bool(building(*one, "+people").moving.people) for one in BUILDINGS) >= 22


def test_people_and_obstacles_go_together():
    world = building("home", 1, "+obstacles+people")
    assert world.obstacles and world.moving.people
    assert parse("random:home+obstacles+people/1") == Named("home", "obstacles+people", 1)


@laws
def test_things_that_are_moved_leave_every_place_within_reach(family, number):
    """One to three chairs and the like, none on a place or the waiting robot, each inside the building."""
    world = building(family, number, "+moved")
    moved = {name for name, *_ in world.changes.moved}
    assert 1 <= len(moved) + len(world.changes.removed) <= 3 and not moved & set(world.changes.removed)
    assert not world.obstacles and not world.moving.people
    later = after(world)
    room = world.robot_radius_m + 0.05
    assert set(reached(later, radius_m=room)) >= set(reached(world, radius_m=room))
    stood = {box.name: box for box in world.boxes}
    for box in later.boxes:
        away = np.hypot(*(np.array(box.centre_m) - stood[box.name].centre_m))
        assert (0.39 < away < 2.51) == (box.name in moved)
        for _, x, y in world.places if box.name in moved else ():
            assert distance_m(replace(later, boxes=(box,), walls=()), np.array([x, y]))[0] >= world.robot_radius_m + 0.14


@laws
def test_barriers_cut_some_places_off_and_not_all(family, number):
    """One to three, from wall to wall; who stands at the end of the survey gets to fewer places, which all were open."""
    world = building(family, number, "+shut")
    assert 1 <= len(world.obstacles) <= 3 and not world.moving.people
    assert len(reached(world, radius_m=world.robot_radius_m)) == len(world.places)
    left = reached(after(world), radius_m=world.robot_radius_m)
    assert left and set(left) < {name for name, *_ in world.places}


def test_buildings_are_the_same_on_every_machine():
    """Whoever changes what is drawn changes every figure that was measured in these buildings: then say so and write these
    anew (run this file as a script)."""
    assert digests() == DIGESTS


@pytest.mark.parametrize("family", FAMILIES)
def test_no_last_bit_of_a_sine_decides_what_is_drawn(family, monkeypatch):
    """NumPy's trigonometry differs in the last bit from processor to processor: nudged by a bit, it draws the same."""
    before = written(building(family, 0, "+obstacles"))
    rng = np.random.default_rng(0)

    def nudged(function):
        def give(*numbers):
            found = np.asarray(function(*numbers))
            return np.nextafter(found, rng.choice([-np.inf, np.inf], found.shape))[()]

        return give

    for name in ("sin", "cos", "tan", "arctan2", "arcsin", "arccos", "exp", "log"):
        monkeypatch.setattr(np, name, nudged(getattr(np, name)))
    monkeypatch.setattr(np.linalg, "solve", nudged(np.linalg.solve))
    _world.cache_clear()
    after = written(random_world(f"random:{family}+obstacles/0"))
    _world.cache_clear()
    assert after == before


def digests() -> dict[str, str]:
    return {family: hashlib.sha256(written(building(family, 0)).encode()).hexdigest()[:12] for family in FAMILIES}


DIGESTS = {
    "loop": "930755de1d97",
    "ladder": "e5c875e52f1e",
    "office": "fe7bcbb017c6",
    "home": "d845eff15241",
    "hall": "7dda268e671d",
    "non_manhattan": "089bccf03d2a",
}


def test_half_of_the_buildings_have_obstacles_and_half_are_turned():
    """Of 24, between a quarter and three quarters; no two share the robot's size."""
    worlds = [building(*one) for one in BUILDINGS]
    assert 6 <= sum(bool(world.obstacles) for world in worlds) <= 18
    angles = [np.arctan2(*np.diff(world.walls[0].points_m[:2], axis=0)[0][::-1]) for world in worlds]
    assert 6 <= sum(min(a % (np.pi / 2), -a % (np.pi / 2)) > 1e-3 for a in angles) <= 22
    assert len({world.robot_radius_m for world in worlds}) > 18


def test_the_simulator_finds_the_survey_free(tmp_path):
    """PyBullet measures the led camera's way: it strays sideways by some centimetres, but never touches."""
    pytest.importorskip("pybullet")
    from rhs.api.contracts import SourceContext
    from rhs.api.randomness import generator
    from rhs_sources.simulator import SimulatorSource
    from rhs_sources.simulator_config import Simulator

    source = SimulatorSource(Simulator(image_width=64, texture_px_per_m=20.0, step_m=0.5, turn_step_deg=45.0),
                             SourceContext(generator(0, "source"), building("office", 3), tmp_path))
    while source.lead() is not None:
        pass
    clearance, touched = source.clearance_m()
    source.close()
    assert not touched and clearance > 0.02


@pytest.mark.parametrize(("words", "said"), [
    ("random:ofice", "there is no family 'ofice'; did you mean office?"),
    ("random:", "there is no family ''"),
    ("random:home+plian", "found '+plian'; did you mean plain?"),
    ("random:home/x", "found '/x'; expected the number of a building"),
    ("random:home/99999999999", "found '/99999999999'"),
    ("randm:home", "did you mean 'random:home'?")])
def test_a_building_that_is_not_there_is_refused_in_one_line(words, said, capsys):
    assert main([f"world={words}", "task=survey"]) == 2
    told = capsys.readouterr().err
    assert said in told and told.count("\n") == 1


def test_names_of_buildings():
    assert parse("random:home") == Named("home") and parse("random:hall+plain/7") == Named("hall", "plain", 7)
    assert building_of("random:home", 3) == "random:home/3" == building_of("random:home/3", 9)
    assert building_of("square", 3) == "square" and building_of("random:home", float("nan")) == "random:home"


def test_configuration_and_seed_say_which_building_it_was(tmp_path):
    config = compose_config(["world=random:home", "seed=3"])
    again = from_plain(to_plain(config))
    plans = [RunContext(one, tmp_path, unwatched).floor_plan() for one in (config, again)]
    assert plans[0].name == "random:home/3" and written(plans[0]) == written(plans[1])
    with pytest.raises(ConfigError, match="nowhere"):
        load_world("nowhere")


def test_the_list_of_worlds_names_files_and_families(capsys):
    assert main(["worlds"]) == 0
    told = capsys.readouterr().out
    assert "square_small" in told and all(f"random:{family}" in told for family in FAMILIES)


def test_plans_of_worlds_are_drawn(tmp_path, capsys):
    assert main(["worlds", "random:loop", "square_small", "--buildings", "1", "--pictures", str(tmp_path / "plans")]) == 0
    found = sorted(path.name for path in (tmp_path / "plans").iterdir())
    assert found == ["random_loop_0.png", "square_small.png", "worlds.png"]


@pytest.mark.parametrize("radius_m", [0.18, 0.24, 0.3])
def test_doors_are_wide_enough_for_the_robot(radius_m):
    rng = np.random.default_rng(0)
    sketch = Sketch(rng, looks(rng), radius_m, 1.0)
    widths = [sketch.door_m() for _ in range(50)]
    assert min(widths) >= max(0.8, 2.0 * (radius_m + 0.1)) and max(widths) <= 1.0


def test_distances_of_a_unit_square():
    """Worked by hand: beside it, across it, in it."""
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    lines = np.array([[[2.0, 0.5], [3.0, 0.5]], [[-1.0, 0.5], [2.0, 0.5]], [[0.4, 0.4], [0.6, 0.6]],
                      [[2.0, 2.0], [2.0, 3.0]]])
    np.testing.assert_allclose(polygon_gaps_m(square, lines), [1.0, 0.0, 0.0, np.sqrt(2.0)])
    assert within(np.array([[0.5, 0.5], [1.5, 0.5]]), square).tolist() == [True, False]
    inner = shifted_sides(square, np.array([0.1, 0.2, 0.3, 0.0]))
    np.testing.assert_allclose(inner, [[0, 0.1], [0.8, 0.1], [0.8, 0.7], [0, 0.7]])


def test_furniture_stands_beside_things_or_leaves_a_way():
    rng = np.random.default_rng(0)
    sketch = Sketch(rng, looks(rng), 0.2, 1.0)
    sketch.wall("outer", [(0, 0), (4, 0), (4, 4), (0, 4)], closed=True)
    box = np.array([[0.0, 0.0], [0.5, 0.0], [0.5, 0.5], [0.0, 0.5]])
    assert sketch.fits(box + 0.03) and sketch.fits(box + 1.0)
    assert not sketch.fits(box + (0.03, 0.4)) and not sketch.fits(box - 0.2)  # a dead gap; through the wall
    sketch.doors_m.append((0.0, 2.0))
    assert not sketch.fits(box + (0.03, 1.8))


if __name__ == "__main__":
    from pathlib import Path

    text = Path(__file__).read_text("utf-8").split("\n")
    at = next(i for i, line in enumerate(text) if line.startswith("DIGESTS ="))
    to = text.index("}", at) + 1
    text[at:to] = ["DIGESTS = {", *(f'    "{family}": "{digest}",' for family, digest in digests().items()), "}"]
    Path(__file__).write_text("\n".join(text), "utf-8")
