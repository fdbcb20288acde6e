"""Poses of an SDF that are told relative to other things (SDFormat, "Pose frame semantics"), and what of an SDF is named
because it is not read."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.worlds.scene_files import read_scene

CUBE = "<visual name='v'><geometry><box><size>0.4 0.4 0.4</size></box></geometry></visual>"
HOUSE = ("<model name='house'><pose>10 5 0 0 0 1.5707963267948966</pose><link name='desk'><pose>2 0 0 0 0 0</pose></link>"
         "<frame name='corner'><pose>1 3 0 0 0 0</pose></frame></model>")


def scene(tmp_path, inside):
    path = tmp_path / "a.sdf"
    path.write_text(f"<sdf version='1.9'><world name='w'>{inside}</world></sdf>", encoding="utf-8")
    return read_scene(path)


def middle(found):
    """(2,) of the last part."""
    corners = found.parts[-1].corners_m.reshape(-1, 3)
    return (0.5 * (corners.min(axis=0) + corners.max(axis=0)))[:2]


def lamp(pose, more=""):
    return f"<model name='lamp'{more}>{pose}<link name='l'>{CUBE}</link></model>"


@pytest.mark.parametrize(("inside", "at"), [
    (HOUSE + lamp("<pose relative_to='house'>1 0 0 0 0 0</pose>"), (10.0, 6.0)),
    (HOUSE + lamp("<pose relative_to='house::desk'>1 0 0 0 0 0</pose>"), (10.0, 8.0)),
    (HOUSE + lamp("<pose relative_to='house::corner'>1 0 0 0 0 0</pose>"), (7.0, 7.0)),
    (HOUSE + "<frame name='f' attached_to='house'><pose>2 1 0 0 0 0</pose></frame>"
     + lamp("<pose relative_to='f'>0 0 0 0 0 0</pose>"), (9.0, 7.0)),
    ("<frame name='f'><pose>3 0 0 0 0 0</pose></frame><frame name='g'><pose relative_to='f'>0 2 0 0 0 0</pose></frame>"
     + lamp("<pose relative_to='g'>1 0 0 0 0 0</pose>"), (4.0, 2.0)),
    ("<model name='lamp' placement_frame='foot'><pose>3 0 0 0 0 0</pose><frame name='foot'><pose>1 0 0 0 0 0</pose></frame>"
     f"<link name='l'>{CUBE}</link></model>", (2.0, 0.0)),
    ("<model name='lamp'><link name='pole'/><joint name='j' type='fixed'><pose relative_to='pole'>2 0 0 0 0 0</pose>"
     f"<parent>pole</parent><child>l</child></joint><link name='l'><pose relative_to='j'>1 0 0 0 0 0</pose>{CUBE}</link>"
     "</model>", (3.0, 0.0)),
])
def test_things_stand_where_their_frame_says(tmp_path, inside, at):
    found = scene(tmp_path, inside)
    assert middle(found) == pytest.approx(at) and not found.missing


def test_an_include_stands_by_its_placement_frame_and_others_by_its_name(tmp_path):
    (tmp_path / "chair").mkdir()
    (tmp_path / "chair" / "model.sdf").write_text(
        f"<sdf version='1.9'><model name='chair'><frame name='leg'><pose>1 0 0 0 0 0</pose></frame><link name='l'>{CUBE}"
        "</link></model></sdf>", encoding="utf-8")
    chair = ("<include><uri>model://chair</uri><name>mine</name><placement_frame>leg</placement_frame>"
             "<pose>2 1 0 0 0 0</pose></include>")
    assert middle(scene(tmp_path, chair)) == pytest.approx((1.0, 1.0))
    found = scene(tmp_path, chair + lamp("<pose relative_to='mine'>0 3 0 0 0 0</pose>"))
    assert middle(found) == pytest.approx((2.0, 4.0))


def test_what_is_not_read_is_named(tmp_path):
    """The frame first: what stands by it stands elsewhere."""
    found = scene(tmp_path, "<population name='cans'><model name='can'/></population>"
                  + lamp("<pose relative_to='nobody'>1 0 0 0 0 0</pose>"))
    assert "the frame nobody" in found.missing[0] and found.missing[1:] == ["the population cans"]


def test_an_ellipsoid_has_its_radii(tmp_path):
    shape = "<visual name='v'><geometry><ellipsoid><radii>0.3 0.2 0.5</radii></ellipsoid></geometry></visual>"
    corners = scene(tmp_path, f"<model name='m'><link name='l'>{shape}</link></model>").parts[0].corners_m.reshape(-1, 3)
    assert np.ptp(corners, axis=0) == pytest.approx([0.6, 0.4, 1.0], abs=0.02)


def test_a_urdf_with_the_sums_of_a_xacro_says_so(tmp_path):
    path = tmp_path / "x.urdf"
    shape = "<visual><geometry><box size='1 1 ${h}'/></geometry></visual>"
    path.write_text(f"<robot name='r'><link name='a'>{shape}</link></robot>")
    with pytest.raises(ConfigError, match="expand it first: xacro x.urdf > robot.urdf"):
        read_scene(path)
