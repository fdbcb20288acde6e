"""The simulator: what it shows, how its robot moves, what it runs into."""

import csv
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.errors import ConfigError, RhsError
from rhs.api.floorplan import Box, Changes, Light, Surface
from rhs.api.geometry import inverse, planar, se2, transform
from rhs.api.records import Twist
from rhs.api.settings import make
from rhs.worlds.world import load_world
from rhs_sources.simulator_bullet import quiet
from rhs_sources.simulator_config import Simulator

WORLD = load_world("square_small")
EXACT = {"command_bias_percent": 0.0, "command_noise_percent": 0.0, "wobble_m": 0.0, "wobble_deg": 0.0,
         "texture_px_per_m": 60.0, "image_width": 160}


def build(folder, world=WORLD, seed=0, **settings):
    return Simulator(**{**EXACT, **settings}).build(SourceContext(np.random.default_rng(seed), world, folder))


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    box = Box("pillar", (6.0, 1.0), (0.4, 0.4, 2.0))
    made = build(tmp_path_factory.mktemp("sim"), replace(WORLD, boxes=(box,)))
    yield made
    made.close()


@pytest.fixture(autouse=True)
def back_at_the_start(request):
    if "source" in request.fixturenames:
        made = request.getfixturevalue("source")
        made.teleport(se2(2.0, 1.0, 0.0))
        made.clearance_m()


def look_from(source, x, y, yaw):
    source.teleport(se2(x, y, yaw))
    return source.drive(Twist(0.0, 0.0, 0.0))


def pixels(camera):
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(float)


def test_the_wall_ahead_is_as_far_as_the_plan_says(source):
    capture = look_from(source, 6.6, 1.0, 0.0)
    camera = source.camera
    assert capture.image.shape == (120, 160, 3) and capture.image.dtype == np.uint8
    assert capture.depth.shape == (120, 160) and capture.depth.dtype == np.float32
    np.testing.assert_allclose(capture.depth[20:100, 20:140], 1.4, atol=1e-3)  # the wall x = 8, square to the view
    assert camera.body_from_camera[2, 3] == WORLD.camera_height_m


@pytest.mark.parametrize("yaw_deg", [0.0, 37.0, 90.0, 135.0, -100.0])
def test_every_depth_pixel_lies_on_a_surface_of_the_plan(source, yaw_deg):
    capture = look_from(source, 1.0, 1.2, np.radians(yaw_deg))
    assert not np.isnan(capture.depth).any()
    points = transform(source.truth() @ source.camera.body_from_camera,
                       source.camera.points(pixels(source.camera), capture.depth.ravel()))
    planes = [points[:, 0] - v for v in (0, 2, 6, 8, 5.8)] + [points[:, 1] - v for v in (0, 2, 6, 8, 0.8, 1.2)]
    planes += [points[:, 2], points[:, 2] - 2.6]
    assert np.abs(planes).min(axis=0).max() < 1e-3


def test_a_known_edge_appears_where_the_camera_model_projects_it(source):
    capture = look_from(source, 2.0, 1.0, 0.0)
    corners = np.array([[5.8, y, source.camera.body_from_camera[2, 3]] for y in (1.2, 0.8)])  # of the pillar
    camera_from_world = inverse(source.truth() @ source.camera.body_from_camera)
    left, right = source.camera.project(transform(camera_from_world, corners))[:, 0]
    row = capture.depth[60]
    seen = np.flatnonzero(np.abs(row - 3.8) < 1e-3)
    assert seen.min() == np.ceil(left) and seen.max() == np.floor(right)


def test_a_robot_without_errors_obeys_the_unicycle_law(source):
    source.teleport(se2(2.0, 1.0, 0.1))
    capture = source.drive(Twist(0.5, 0.4, 1.0))
    radius = 0.5 / 0.4
    expected = [2.0 + radius * (np.sin(0.5) - np.sin(0.1)), 1.0 - radius * (np.cos(0.5) - np.cos(0.1)), 0.5]
    np.testing.assert_allclose(planar(source.truth()), expected, atol=1e-12)
    np.testing.assert_allclose(capture.travel, planar(inverse(se2(2.0, 1.0, 0.1)) @ se2(*expected)), atol=1e-12)


def test_clearance_is_the_gap_between_robot_and_wall(source):
    for y, gap in ((1.0, 0.7), (0.5, 0.2), (0.31, 0.01)):
        source.teleport(se2(3.0, y, 0.0))
        source.clearance_m()
        assert source.clearance_m() == (pytest.approx(gap, abs=2e-3), False)
    source.teleport(se2(5.0, 1.0, 0.0))
    source.clearance_m()
    assert source.clearance_m()[0] == pytest.approx(0.5, abs=2e-3)  # the pillar's face stands 0.8 m from the centre


def test_least_clearance_on_the_way_is_remembered(source):
    source.teleport(se2(3.0, 1.0, -np.pi / 2))
    source.drive(Twist(0.5, 0.0, 1.0))
    source.drive(Twist(-0.5, 0.0, 1.0))
    assert source.clearance_m() == (pytest.approx(0.2, abs=2e-3), False)
    assert source.clearance_m()[0] == pytest.approx(0.7, abs=2e-3)


def test_the_robot_stops_at_the_wall_says_so_and_can_leave(source):
    source.teleport(se2(3.0, 1.0, -np.pi / 2))
    assert source.drive(Twist(0.5, 0.0, 0.5)).contact is False
    assert source.drive(Twist(0.5, 0.0, 4.0)).contact is True
    assert planar(source.truth())[1] == pytest.approx(0.3, abs=2e-3)
    gap, touched = source.clearance_m()
    assert touched and gap == pytest.approx(0.0, abs=1e-3)
    # turning in contact is possible, and so is leaving
    assert source.drive(Twist(0.0, np.pi / 4, 4.0)).contact is False, "the bumper is not pressed any more"
    source.drive(Twist(0.5, 0.0, 1.0))
    assert planar(source.truth())[1] == pytest.approx(0.8, abs=2e-3)
    source.clearance_m()
    assert source.clearance_m()[1] is False


def test_teleport_into_a_wall_is_refused(source):
    with pytest.raises(RhsError, match="overlap something by 0.20 m"):
        source.teleport(se2(3.0, 0.1, 0.0))


def test_commands_must_be_finite(source):
    with pytest.raises(RhsError, match="expected finite numbers"):
        source.drive(Twist(np.nan, 0.0, 1.0))


def test_obstacles_appear_when_the_patrol_begins(tmp_path):
    world = replace(WORLD, obstacles=(Box("barrier", (5.0, 1.0), (0.2, 2.0, 1.8)),))
    source = build(tmp_path, world)
    before = look_from(source, 3.0, 1.0, 0.0).depth[60, 80]
    source.begin_patrol()
    after = look_from(source, 3.0, 1.0, 0.0).depth[60, 80]
    assert (before, after) == (pytest.approx(5.0, abs=1e-3), pytest.approx(1.9, abs=1e-3))
    source.drive(Twist(0.5, 0.0, 5.0))
    assert planar(source.truth())[0] == pytest.approx(4.9 - 0.3, abs=2e-3)
    assert list(tmp_path.iterdir()) == []  # meshes and textures are gone once PyBullet has them
    source.close()


def test_what_moves_goes_and_dims_overnight_is_so_for_eye_and_judge(tmp_path):
    """A box 2 m ahead goes; one behind it, moved aside, leaves the wall 7 m away; the light falls to half."""
    boxes = (Box("near", (5.0, 1.0), (0.2, 0.5, 1.8)), Box("far", (6.0, 1.0), (0.2, 0.5, 1.8)))
    changes = Changes(removed=("near",), moved=(("far", 5.0, 1.7, 0.0),), light=Light(0.5))
    source = build(tmp_path, replace(WORLD, boxes=boxes, changes=changes))
    before = look_from(source, 3.0, 1.0, 0.0)
    source.begin_patrol()
    now = look_from(source, 3.0, 1.0, 0.0)
    assert (before.depth[60, 80], now.depth[60, 80]) == (pytest.approx(1.9, abs=1e-3), pytest.approx(5.0, abs=1e-3))
    ceiling = before.image[:8].mean(), now.image[:8].mean()
    assert ceiling[1] == pytest.approx(0.5 * ceiling[0], rel=0.02)
    source.drive(Twist(0.5, 0.0, 4.0))
    assert planar(source.truth())[0] == pytest.approx(5.0, abs=0.02)  # nothing is in the way any more
    source.close()


def test_what_faces_the_lamp_is_brighter(tmp_path):
    """The same bare walls: the one ahead faces a lamp behind the robot, the one behind faces away from it."""
    plain = tuple(replace(w, surface=Surface("plain", (100.0, 100.0, 100.0), 0.0), paintings=False) for w in WORLD.walls)
    world = replace(WORLD, walls=plain, changes=Changes(light=Light(1.0, np.pi)))
    source = build(tmp_path, world)
    source.begin_patrol()
    ahead, behind = (look_from(source, x, 1.0, yaw).image[60, 80].mean() for x, yaw in ((6.0, 0.0), (2.0, np.pi)))
    assert (ahead, behind) == (pytest.approx(130, abs=2), pytest.approx(70, abs=2))
    source.close()


def test_the_survey_without_wobble_follows_the_route_and_comes_back(tmp_path):
    source = build(tmp_path, step_m=0.5, turn_step_deg=45.0, image_width=32, direction="cw")
    np.testing.assert_allclose(source.facts.start, (3.0, 1.0, np.pi))
    pose, count = se2(*source.facts.start), 0
    while (capture := source.lead()) is not None:
        count += 1
        if capture.travel is None:
            assert count == 1 and capture.command is None
            continue
        pose = pose @ se2(*capture.travel)
        np.testing.assert_allclose(planar(pose), planar(source.truth()), atol=1e-9)
        driven = capture.command.forward_mps * capture.command.duration_s
        assert driven == pytest.approx(capture.travel[0], abs=1e-9)
    assert count == source.views_expected == 1 + 4 + 12 + 12 + 12 + 10 + 4 * 2
    np.testing.assert_allclose(planar(pose)[:2], (2.0, 1.0), atol=1e-9)
    source.close()


def test_commands_differ_from_the_motion_by_the_given_noise(tmp_path):
    source = build(tmp_path, step_m=0.1, image_width=32, command_noise_percent=5.0)
    ratios = []
    while (capture := source.lead()) is not None:
        if capture.travel is not None and capture.travel[0] > 0.05:
            ratios.append(capture.travel[0] / (capture.command.forward_mps * capture.command.duration_s))
    source.close()
    assert len(ratios) == 250 and np.mean(ratios) == pytest.approx(1.0, abs=0.01)
    assert np.std(ratios) == pytest.approx(0.05, rel=0.15)


def test_two_simulators_in_one_process_do_not_meet(tmp_path, source):
    seen = look_from(source, 2.0, 1.0, 0.0).image
    other = build(tmp_path, texture_seed=99)
    assert np.any(look_from(other, 2.0, 1.0, 0.0).image != seen)
    other.close()
    np.testing.assert_array_equal(look_from(source, 2.0, 1.0, 0.0).image, seen)


HASH = """
import hashlib, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from test_simulator import build, Twist
source = build(Path({folder!r}), seed=int(sys.argv[1]), command_noise_percent=5.0, wobble_m=0.02, pitch_roll_deg=1.0)
digest = hashlib.sha256()
for capture in [source.lead() for _ in range(3)] + [source.drive(Twist(0.5, 0.3, 1.0))]:
    digest.update(capture.image.tobytes() + capture.depth.tobytes() + repr(capture.command).encode())
digest.update(source.truth().tobytes())
print(digest.hexdigest())
"""


def test_two_processes_see_the_same_bits_and_another_seed_does_not(tmp_path, request):
    code = HASH.format(tests=str(request.path.parent), folder=str(tmp_path))
    runs = [subprocess.run([sys.executable, "-c", code, seed], capture_output=True, text=True, check=True)
            for seed in ("7", "7", "8")]
    first, again, other = (run.stdout for run in runs)
    assert len(first) == 65 and first == again != other  # the digest and nothing else: libraries keep quiet
    assert runs[0].stderr == ""


def test_how_many_paintings_are_unique_is_a_setting():
    from rhs_sources.simulator_textures import WallPainter

    square = load_world("square")
    for unique, expected in ((1000, 72), (8, 8), (1, 1)):
        world = replace(square, paintings=replace(square.paintings, unique=unique))
        numbers = [number for places in WallPainter(world, 20.0).hung.values() for _, number in places]
        assert len(numbers) == 72 and len(set(numbers)) == expected


def test_twin_corridors_look_the_same_turned_by_half_a_circle(tmp_path):
    twin = load_world("square_twin")
    source = build(tmp_path, twin)
    for x, y, yaw in ((5.0, 1.2, 0.1), (15.0, 0.9, 0.0)):
        here = look_from(source, x, y, yaw).image.astype(int)
        there = look_from(source, 20.0 - x, 20.0 - y, yaw + np.pi).image.astype(int)
        assert np.mean(np.abs(here - there) > 8) < 0.01
    unlike = look_from(source, 1.0, 8.0, np.pi / 2).image.astype(int)
    other = look_from(source, 19.0, 12.0, -np.pi / 2).image.astype(int)
    assert np.mean(np.abs(unlike - other) > 8) > 0.05  # the inner walls of the other two corridors differ
    source.close()


def test_a_blank_stretch_has_one_colour(tmp_path):
    source = build(tmp_path, load_world("square_blank"))
    blank = look_from(source, 19.0, 1.0, np.radians(20)).image  # the corner in front of the east wall
    painted = look_from(source, 19.0, 14.0, np.radians(20)).image
    assert blank[30:90].std(axis=(0, 1)).max() < 0.5 < painted[30:90].std(axis=(0, 1)).min()
    source.close()


def test_opengl_shows_the_same_building_or_is_replaced(tmp_path):
    source = build(tmp_path, renderer="egl")
    if source.renderer == "tinyrenderer":
        source.close()
        pytest.skip("no EGL on this machine: PyBullet fell back to its software renderer")
    depth = look_from(source, 2.3, 1.0, 0.0).depth
    source.close()
    software = build(tmp_path)
    difference = np.abs(look_from(software, 2.3, 1.0, 0.0).depth - depth)
    software.close()
    assert np.quantile(difference, 0.98) < 0.01


def test_a_flat_picture_is_refused(tmp_path):
    bare = replace(WORLD.floor, recipe="plain", colour=(0.0, 0.0, 0.0))
    walls = tuple(replace(wall, surface=bare, paintings=False) for wall in WORLD.walls)
    with pytest.raises(RhsError, match="draws one flat colour"):
        build(tmp_path, replace(WORLD, walls=walls, floor=bare, ceiling=bare))


@pytest.mark.parametrize("setting", [
    {"image_width": 0}, {"hfov_deg": float("nan")}, {"renderer": "opengl"}, {"sampling": "linear"}, {"anisotropy": 0},
    {"step_m": -0.2}, {"step_m": 0.0},
    {"speed_mps": float("inf")}, {"turn": "left"}, {"direction": "north"}, {"wobble_m": -1.0},
    {"paintings_unique": 0}, {"paintings_density": 1.5}, {"command_noise_percent": float("nan")},
])
def test_settings_out_of_range_are_refused(setting):
    with pytest.raises(ConfigError, match=f"source.{next(iter(setting))}="):
        make(Simulator, setting, "source")


def test_a_config_alone_loads_no_heavy_library():
    code = ("import sys, rhs_sources.simulator_config, rhs.worlds.world; "
            "print([m for m in ('cv2', 'pybullet', 'scipy', 'numba') if m in sys.modules])")
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


WITHOUT = "import sys; sys.modules['pybullet'] = None; from rhs.cli.main import main; sys.exit(main(sys.argv[1:]))"


def without_pybullet(*words):
    return subprocess.run([sys.executable, "-c", WITHOUT, *words], capture_output=True, text=True, check=False)


def test_a_survey_needs_no_pybullet_and_leaves_open_how_near_it_came(tmp_path):
    words = ("world=square_small", "odometry=wheel", "loop_closer=none", "recording=off", "pictures=off",
             "source.image_width=64", f"output={tmp_path}/run")
    done = without_pybullet("task=survey", *words)
    assert done.returncode == 0 and "pip install pybullet" in done.stderr
    with (tmp_path / "run" / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) > 100 and {row["clearance_m"] for row in rows} == {""}


def test_a_patrol_without_pybullet_is_refused_before_the_survey(tmp_path):
    done = without_pybullet("world=square_small", f"output={tmp_path}/run")
    assert done.returncode == 2 and "type task=survey" in done.stderr and not (tmp_path / "run").exists()


@pytest.mark.parametrize("words", [
    ("task=planning", "world=square_small"), ("task=survey", "source=replay", "odometry=wheel", "sensor=laser",
                                              "loop_closer=none", "source.path=tests/golden/laser.clf")])
def test_planning_and_replay_need_no_pybullet(tmp_path, words, request):
    words = [word.replace("tests/golden", str(request.path.parents[1] / "golden")) for word in words]
    assert without_pybullet(*words, "pictures=off", f"output={tmp_path}/run").returncode == 0


def test_a_camera_that_looks_down_sees_the_floor_from_nearer_by_and_is_refused_without_a_horizon(tmp_path):
    world = replace(WORLD, camera_height_m=1.0)
    half_rad = np.arctan(0.75 * np.tan(np.radians(57.0) / 2.0))  # of the picture's height
    for pitch_deg in (0.0, 15.0):
        source = build(tmp_path, replace(world, camera_pitch_deg=pitch_deg))
        capture = source.lead()
        below = source.camera.body_from_camera[:3, :3] @ source.camera.rays(np.array([[source.camera.cx, 119.0]]))[0]
        nearest_m = 1.0 / np.tan(half_rad + np.radians(pitch_deg))
        assert below[0] / -below[2] == pytest.approx(nearest_m, rel=0.02)  # 2.5 m level, 1.4 m at 15 degrees
        assert capture.depth[119, 80] * np.hypot(below[0], below[2]) == pytest.approx(np.hypot(1.0, nearest_m), rel=0.02)
        source.close()
    with pytest.raises(ConfigError, match="leaves the horizon out of the picture"):
        build(tmp_path, world, camera_pitch_deg=30.0)


def test_threads_that_silence_a_library_at_once_give_the_streams_back():
    """Of two runs in threads the second kept the first one's silence for the real streams, and nothing more was heard."""
    def silence(first_s, then_s):
        time.sleep(first_s)
        with quiet():
            time.sleep(then_s)

    before = [os.fstat(stream).st_ino for stream in (1, 2)]
    threads = [threading.Thread(target=silence, args=times) for times in ((0.0, 0.1), (0.05, 0.2))]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert [os.fstat(stream).st_ino for stream in (1, 2)] == before
