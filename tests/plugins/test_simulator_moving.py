"""What moves is drawn, judged, and the same every time."""

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs.api.randomness import generator
from rhs.api.records import Twist
from rhs.worlds.world import load_world

pytest.importorskip("pybullet")
WORLD = """
like: square_small
people:
  - {name: anna, path_m: [[5, 1], [5, 1.5]], speed_mps: 0.05}
  - {name: cat, path_m: [[1, 3], [1, 6]], width_m: 0.25, height_m: 0.3, survey: true}
timed:
  - {name: parcel, centre_m: [4.6, 1.6], size_m: [0.3, 0.3, 1.5], stands_s: [[1, 60]]}
light_s: [[0, 1], [10, 0.4]]
"""


@pytest.fixture
def source(tmp_path):
    from rhs_sources.simulator_config import Simulator

    def made(**settings):
        (tmp_path / "w.yaml").write_text(WORLD)
        settings = {"image_width": 80, "texture_px_per_m": 30.0, "wobble_m": 0.0, "wobble_deg": 0.0,
                    "command_bias_percent": 0.0, "command_noise_percent": 0.0, **settings}
        built = Simulator(**settings).build(
            SourceContext(generator(0, "source"), load_world(tmp_path / "w.yaml"), tmp_path))
        opened.append(built)
        return built

    opened = []
    yield made
    for one in opened:
        one.close()


def ahead_m(capture) -> float:
    return float(capture.depth[len(capture.depth) // 2, capture.depth.shape[1] // 2])


def test_a_person_is_seen_on_the_patrol_where_they_walk_and_stops_the_robot(source):
    """From (2, 1) looking east: on the survey the wall at 8 m, on the patrol anna at 5 m, 0.2 m thick to the front. The
    judge stops the robot at her: 3 m less both radii."""
    world = source()
    assert ahead_m(world.lead()) == pytest.approx(6.0, abs=0.02)
    world.begin_patrol()
    world.teleport(se2(2.0, 1.0, 0.0))
    assert ahead_m(world.drive(Twist(0.0, 0.0, 0.05))) == pytest.approx(2.8, abs=0.03)
    world.clearance_m()
    for _ in range(14):
        capture = world.drive(Twist(0.5, 0.0, 0.5))
    least, touched = world.clearance_m()
    assert touched and capture.contact and -0.01 < least < 0.01
    x, y, _ = np.array([*world.truth()[:2, 3], 0.0])
    assert np.hypot(x - 5.0, y - world.live.stands()[0].y_m) == pytest.approx(0.5, abs=0.01)


def test_a_thing_and_the_light_change_with_the_seconds_of_the_patrol(source):
    world = source()
    world.lead()
    world.begin_patrol()
    world.teleport(se2(2.0, 1.6, 0.0))
    first = world.drive(Twist(0.0, 0.0, 0.05))
    later = world.drive(Twist(0.0, 0.0, 2.0))
    assert ahead_m(first) == pytest.approx(6.0, abs=0.03) and ahead_m(later) == pytest.approx(2.45, abs=0.03)
    wall = np.s_[: len(first.image) // 4]
    assert later.image[wall].mean() / first.image[wall].mean() == pytest.approx(1.0 - 0.06 * 2.05, abs=0.01)


def test_the_same_commands_lead_to_the_same_pictures(source):
    def film():
        world = source()
        views = [world.lead() for _ in range(3)]
        world.begin_patrol()
        views += [world.drive(Twist(0.3, 0.2, 0.4)) for _ in range(3)]
        return b"".join(view.image.tobytes() + view.depth.tobytes() for view in views)

    assert film() == film()


def test_other_renderers_say_that_they_do_not_draw_it(source):
    with pytest.raises(ConfigError, match="does not draw what moves; type source.renderer=raster"):
        source(renderer="tinyrenderer")
