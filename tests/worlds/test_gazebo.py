"""A world saved by Gazebo: things stand where its <state> says, robots are left out, actors walk, doors decide what is led
through."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import distance_m
from rhs.worlds.scene_files import read_scene
from rhs.worlds.world import load_world

BOX = "<visual name='v'><pose>0 0 {z} 0 0 0</pose><geometry><box><size>{x} {y} {h}</size></box></geometry>{look}</visual>"


def model(name, size, at, *, look="", extra=""):
    x, y, h = size
    shape = BOX.format(x=x, y=y, h=h, z=h / 2, look=look)
    return f"<model name='{name}'><pose>{at} 0 0 0 0</pose><link name='l'>{shape}</link>{extra}</model>"


ROOM = (model("south", (8.2, 0.2, 2), "0 -3.1") + model("north", (8.2, 0.2, 2), "0 3.1")
        + model("west", (0.2, 6, 2), "-4.1 0") + model("east", (0.2, 6, 2), "4.1 0"))


def saved(tmp_path, inside, state=""):
    path = tmp_path / "saved.world"
    path.write_text(f"<sdf version='1.7'><world name='default'>{ROOM}{inside}{state}</world></sdf>", encoding="utf-8")
    return path


def test_the_state_counts_for_an_include_that_has_the_name_of_its_model(tmp_path):
    (tmp_path / "models/chest").mkdir(parents=True)
    (tmp_path / "models/chest/model.sdf").write_text(f"<sdf version='1.6'>{model('chest', (0.5, 0.4, 0.8), '0 0')}</sdf>")
    state = "<state world_name='d'><model name='chest'><pose>2 1 0 0 0 0</pose><scale>2 1 1</scale></model></state>"
    world = load_world(saved(tmp_path, "<include><uri>model://chest</uri><pose>-2 -1 0 0 0 0</pose></include>", state))
    assert distance_m(world, np.array([1.2, 1.0]))[0] == pytest.approx(0.3)  # a metre long, its middle at x = 2


def test_models_stand_and_are_as_large_as_the_state_says(tmp_path):
    state = ("<state world_name='default'><model name='chest'><pose>2 1 0 0 0 1.5707963267948966</pose><scale>2 1 1</scale>"
             "<link name='l'><pose>2 1 0 0 0 1.57</pose></link></model></state>")
    world = load_world(saved(tmp_path, model("chest", (0.5, 0.4, 0.8), "-2 -1"), state))
    assert distance_m(world, np.array([-2.0, -1.0]))[0] == pytest.approx(2.0)  # nothing where it was first put
    assert distance_m(world, np.array([2.0, 0.0]))[0] == pytest.approx(0.5)  # turned: 1 m along y
    assert distance_m(world, np.array([1.5, 1.0]))[0] == pytest.approx(0.3)


@pytest.mark.parametrize("name", ["libgazebo_ros_diff_drive.so", "gz-sim-diff-drive-system", "DifferentialDrive.so",
                                  "libgazebo_ros_planar_move.so", "libgazebo_ros_skid_steer_drive.so"])
def test_what_a_plugin_drives_is_a_robot_and_no_part_of_the_building(tmp_path, caplog, name):
    drive = f"<plugin name='p' filename='{name}'/>"
    other = "<plugin name='door_driver' filename='libLabel.so'/>"
    world = load_world(saved(tmp_path, model("my_bot", (0.5, 0.5, 0.5), "0 0", extra=drive)
                             + model("sign", (0.5, 0.5, 0.5), "2 0", extra=other)))
    assert distance_m(world, np.array([0.0, 0.0]))[0] == pytest.approx(1.75)
    assert "left out, as robots: my_bot" in caplog.text


def waypoints(*stops):
    return "".join(f"<waypoint><time>{t}</time><pose>{x} {y} 0 0 0 0</pose></waypoint>" for t, x, y in stops)


def actor(name, stops):
    return f"<actor name='{name}'><script><trajectory id='0' type='walk'>{waypoints(*stops)}</trajectory></script></actor>"


def test_actors_walk_their_trajectory_and_who_walks_through_a_wall_is_left_out(tmp_path, caplog):
    there = actor("there", [(0, -3, 2), (2, -3, 2), (6, -1, 2)])  # stands for 2 s, then 2 m in 4 s
    round_ = actor("round", [(0, -3, -2), (1, -2, -2), (2, -2, -1), (4, -3, -2)])
    through = actor("through", [(0, 0, 0), (5, 9, 0)])
    stands = "<actor name='stands'><pose>3 2 1 0 0 0</pose></actor>"
    world = load_world(saved(tmp_path, there + round_ + through + stands))
    first, second = world.moving.people
    assert (first.name, first.speed_mps) == ("there", 0.5)
    assert first.path_m.tolist() == [[-3, 2], [-1, 2]] and first.pauses_s == (2.0, 0.0)  # and back again
    assert second.path_m.tolist() == [[-3, -2], [-2, -2], [-2, -1]]
    assert second.speed_mps == pytest.approx((2 + 2**0.5) / 4)
    assert "left out, as they walk through walls or outside: through" in caplog.text
    assert distance_m(world, np.array([3.0, 1.0]))[0] == pytest.approx(0.8, abs=0.01)


@pytest.mark.parametrize("time", ["soon", "-1", "nan", "inf"])
def test_a_waypoint_at_no_time_is_refused_in_one_line(tmp_path, time):
    with pytest.raises(ConfigError, match="<time> of an actor's waypoint is .*; expected 0 to"):
        load_world(saved(tmp_path, actor("a", [(0, -3, 2), (time, -1, 2)])))


@pytest.mark.parametrize(("look", "colour"), [
    ("<script><name>Gazebo/Wood</name></script><ambient>1 1 1 1</ambient>", (160, 115, 70)),  # as the building editor writes
    ("<script><name>Gazebo/White</name></script><ambient>0.5 0.25 1 1</ambient>", (127, 63, 255)),
    ("<script><name>Gazebo/Wood</name></script><diffuse>1 0 0 1</diffuse>", (255, 0, 0)),
    ("<ambient>0 1 0 1</ambient>", (0, 255, 0)),
])
def test_a_material_is_what_its_script_paints_tinted_by_ambient(tmp_path, look, colour):
    path = tmp_path / "one.sdf"
    path.write_text(f"<sdf version='1.6'>{model('m', (1, 1, 1), '0 0', look=f'<material>{look}</material>')}</sdf>")
    (part,) = read_scene(path).parts
    assert np.abs(np.asarray(part.colours).reshape(-1, 3)[0].astype(int) - colour).max() <= 2


@pytest.mark.parametrize(("door_m", "rooms"), [(0.7, 2), (0.45, 1)])
def test_a_tour_goes_through_a_door_of_70_cm_and_says_which_rooms_it_leaves_out(tmp_path, caplog, door_m, rooms):
    half = (6.0 - door_m) / 2
    wall = "".join(model(f"w{sign}", (0.15, half, 2), f"0 {sign * (door_m / 2 + half / 2)}") for sign in (-1, 1))
    world = load_world(saved(tmp_path, wall))
    sides = {bool(x > 0) for x, _ in world.route_m}
    assert len(sides) == rooms
    assert ("leaves out 1 room of" in caplog.text) == (rooms == 1)


def test_models_are_found_where_gazebo_keeps_them(tmp_path, monkeypatch, caplog):
    """In a folder of GAZEBO_MODEL_PATH, and among those that Fuel has downloaded, the newest version."""
    cache = tmp_path / ".gz/fuel/fuel.gazebosim.org/me/models/my table"
    for folder, x in ((tmp_path / "mine" / "chest", 0.4), (cache / "2", 1.0), (cache / "10", 2.0)):
        folder.mkdir(parents=True)
        (folder / "model.sdf").write_text(f"<sdf version='1.7'>{model('m', (x, 0.4, 0.8), '0 0')}</sdf>")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"{tmp_path / 'none'}:{tmp_path / 'mine'}")
    fuel = "https://fuel.gazebosim.org/1.0"
    world = load_world(saved(tmp_path, (
        f"<include><uri>model://chest</uri><pose>-2 0 0 0 0 0</pose></include><include><uri>{fuel}/Me/models/My Table</uri>"
        f"<pose>2 0 0 0 0 0</pose></include><include><uri>{fuel}/OpenRobotics/models/Ground Plane</uri></include>"
        f"<include><uri>{fuel}/Me/models/Nowhere</uri></include>")))
    assert distance_m(world, np.array([-1.5, 0.0]))[0] == pytest.approx(0.3)
    assert distance_m(world, np.array([2.0, 1.0]))[0] == pytest.approx(0.8)
    assert distance_m(world, np.array([0.5, 0.0]))[0] == pytest.approx(0.5)  # version 10 is 2 m wide
    assert f"missing or unreadable: 1 files or shapes ({fuel}/Me/models/Nowhere); type: gz fuel download" in caplog.text
