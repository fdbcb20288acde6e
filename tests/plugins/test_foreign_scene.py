"""Somebody else's building as the simulator shows and judges it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.floorplan import Mesh as Building
from rhs.api.floorplan import distance_m
from rhs.api.footprints import nearest_m, outlines_between, touch
from rhs.api.geometry import camera_from_fov, se2
from rhs.worlds.soup import box, cylinder, dressed
from rhs.worlds.world import load_world
from rhs_sources.raster.renderer import Mesh, Renderer
from rhs_sources.simulator_scene import Look, scene_of

CAMERA = camera_from_fov(160, 120, 57.0, height_m=0.5)
RED_BLUE = np.array([[[255, 0, 0], [0, 0, 255]]], np.uint8).repeat(8, axis=0).repeat(8, axis=1)


def pane(copies: float) -> tuple[np.ndarray, np.ndarray]:
    """A pane of 4 x 2 m across the way, 2 m ahead, wearing its picture so many times; its corners clockwise as seen."""
    corners = np.array([[2.0, 2, 0], [2, -2, 0], [2, -2, 2], [2, 2, 2]])
    uv = np.array([[0.0, 0], [copies, 0], [copies, 1], [0, 1]])
    return corners[[[0, 2, 1], [0, 3, 2]]], uv[[[0, 2, 1], [0, 3, 2]]]


@pytest.mark.parametrize("probes", [0, 8])
def test_pictures_repeat_and_both_sides_of_a_face_are_seen(probes):
    corners, uv = pane(4.0)
    mesh = Mesh.of_triangles(corners, uv, np.zeros(2, int), [RED_BLUE])
    image, depth = Renderer(CAMERA, probes=probes).render(mesh, se2(0.0, 0.0, 0.0))
    np.testing.assert_allclose(depth[60, 20:140], 2.0, atol=1e-6)
    bearings = (np.arange(160) - CAMERA.cx) / CAMERA.fx * 2.0 + 2.0  # metres from the pane's left edge; a copy is 1 m wide
    middle = np.abs((bearings % 0.5) - 0.25) < 0.15
    red = (bearings % 1.0) < 0.5
    assert (image[60, middle & red, 0] > 200).all() and (image[60, middle & ~red, 2] > 200).all()
    _, behind = Renderer(CAMERA, probes=probes).render(mesh, se2(4.0, 0.0, np.pi))
    np.testing.assert_allclose(behind[60, 20:140], 2.0, atol=1e-6)


def test_outlines_are_cut_at_their_heights_and_their_distances_are_exact():
    ramp = np.array([[[0.0, 0, 0], [4, 0, 2], [0, 1, 0]]])
    (outline,) = outlines_between(ramp, 0.5, 1.0)
    assert set(map(tuple, outline.tolist())) == {(1.0, 0.0), (2.0, 0.0), (1.0, 0.75), (2.0, 0.5)}
    assert nearest_m(outline[None], 1.5, 0.3, 9.0) == 0.0
    assert nearest_m(outline[None], 1.5, -0.4, 9.0) == pytest.approx(0.4)
    assert nearest_m(outline[None], 5.0, 4.0, 2.0) == 2.0
    assert not len(outlines_between(ramp, 2.5, 3.0))
    touched = np.zeros((3, 4), bool)
    touch(outlines_between(ramp, 0.5, 1.0), 1.0, 0.0, -1.0, touched)
    assert np.argwhere(touched).tolist() == [[1, 1]]  # beside a border is not on it
    touch(np.array([[[3.0, -0.5]] * 3 + [[3.0, 0.5]] * 2]), 1.0, 0.0, -1.0, touched)
    assert np.argwhere(touched).tolist() == [[0, 2], [0, 3], [1, 1], [1, 2], [1, 3]]  # without thickness: both sides


def test_the_simulator_judges_and_shows_the_mesh(tmp_path):
    pytest.importorskip("pybullet")
    from rhs_sources.simulator_solid import Solid

    world = load_world("square_small")
    parts = [cylinder(0.25, 1.0).moved(se2(3.0, 1.0, 0.0)), box(np.array([0.2, 0.2, 0.02])).moved(se2(2.0, 1.0, 0.0))]
    corners, uv, texture, images = dressed(parts)
    world = replace(world, mesh=Building(corners, uv, texture, images, outlines_between(corners, 0.04, 1.2)))
    solid = Solid(world)
    for x in (1.6, 2.0, 2.6):
        expected = distance_m(world, np.array([x, 1.0]))[0] - world.robot_radius_m
        assert solid.distance_m(x, 1.0) == pytest.approx(expected, abs=3e-3)
    assert solid.distance_m(2.6, 1.0) < 0.0
    solid.close()
    scene = scene_of(world, CAMERA, Look(50.0, "raster", 8, Path(tmp_path)))
    _, depth = scene.render(se2(1.75, 1.0, 0.0))
    assert depth[60, 80] == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(ConfigError, match="source.renderer=tinyrenderer does not draw somebody else's building"):
        scene_of(world, CAMERA, Look(50.0, "tinyrenderer", 8, Path(tmp_path)))
