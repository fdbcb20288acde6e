"""Tubes: rays meet their walls, and walls open flat and close again."""

import numpy as np
import pytest

from rhs.worlds.tubes import RectangularSection, RoundSection, Tube

BENT = ((1.0, 0.0), (2.0, 0.4), (1.5, -0.5), (1.0, 0.0))


@pytest.mark.parametrize("section", [RoundSection(0.5), RectangularSection(1.0, 1.25)])
def test_around_and_wall_are_inverse(section):
    u = np.linspace(0.0, section.perimeter_m, 101)[:-1]
    left, up = section.wall(u)
    assert np.allclose(section.slack(left, up), 0.0, atol=1e-12)
    assert np.allclose(section.around(left, up), u, atol=1e-9)


def test_a_rectangle_is_walked_from_the_floor_over_the_right_wall_and_the_ceiling():
    section = RectangularSection(1.0, 1.25)
    left, up = section.wall(np.array([0.0, 1.0 + 1.25, 1.0 + 2.5 + 1.0, 4.5 + 1.0 + 1.25]))
    assert left == pytest.approx([0.0, -1.0, 0.0, 1.0])
    assert up == pytest.approx([-1.25, 0.0, 1.25, 0.0])


def test_a_quarter_bend_ends_where_a_compass_draws_it():
    tube = Tube(RoundSection(0.25), ((1.0, 0.0), (np.pi, 0.5)))  # radius 2 m, a quarter of a circle to the left
    end = tube.pose(1.0 + np.pi)
    assert end[:3, 3] == pytest.approx([3.0, 2.0, 0.0])
    assert end[:3, 0] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    right = Tube(RoundSection(0.25), ((1.0, 0.0), (np.pi, -0.5))).pose(1.0 + np.pi)
    assert right[:3, 3] == pytest.approx([3.0, -2.0, 0.0])


@pytest.mark.parametrize("section", [RoundSection(0.3), RectangularSection(0.3, 1.2)])
@pytest.mark.parametrize("pieces", [(), BENT])
def test_flat_and_points_are_inverse(section, pieces):
    tube, rng = Tube(section, pieces), np.random.default_rng(0)
    flat = np.stack([rng.uniform(-0.5, 6.0, 500), rng.uniform(0.0, section.perimeter_m, 500)], axis=1)
    assert np.allclose(tube.flat(tube.points(*flat.T)), flat, atol=1e-9)


@pytest.mark.parametrize("section", [RoundSection(0.3), RectangularSection(0.3, 1.2)])
def test_traced_rays_end_on_the_first_wall_they_meet(section):
    tube, rng = Tube(section, BENT), np.random.default_rng(1)
    pose = tube.pose(1.8)
    rays = np.column_stack([np.ones(400), rng.uniform(-1, 1, (400, 2))]) @ pose[:3, :3].T
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    reach = tube.trace(pose[:3, 3], rays, 20.0)
    assert np.isfinite(reach).mean() > 0.99
    hits = pose[:3, 3] + reach[:, None] * rays
    known = np.isfinite(reach)
    _, left, up = tube.locate(hits[known])
    assert np.abs(section.slack(left, up)).max() < 1e-5
    for share in np.linspace(0.02, 0.98, 49):  # nothing stands in between
        _, left, up = tube.locate(pose[:3, 3] + share * (hits[known] - pose[:3, 3]))
        assert section.slack(left, up).min() > -1e-6


def test_a_straight_tube_is_met_at_its_radius():
    reach = Tube(RoundSection(2.0)).trace(np.array([0.0, 0.5, 0.0]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), 50.0)
    assert reach[0] == pytest.approx(1.5, abs=1e-4)
    assert np.isnan(reach[1])  # along the tube there is no wall
