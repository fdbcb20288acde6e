"""`fused`: each direction from whoever knows it; the heading held against walls that stand square."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_odometry.clouds.clouds import Cloud
from rhs_odometry.fused.config import Fused
from rhs_odometry.fused.fused import Heading, Planar, distance, folded, joined, wall_direction


def cloud_of(angles_rad: np.ndarray) -> Cloud:
    """Upright surfaces facing these directions."""
    normals = np.stack([np.cos(angles_rad), np.sin(angles_rad), np.zeros(len(angles_rad))], axis=1)
    return Cloud(np.ones((len(normals), 3)), normals, np.full(len(normals), 0.01), np.ones((2, 2)))


def test_each_direction_comes_from_whoever_knows_it():
    """One knows the way forward to a centimetre, the other the side and the turn: the result has the best of both."""
    forward = Planar(np.array([0.10, 0.30, 0.2]), np.diag([1e-4, 1.0, 1.0]))
    aside = Planar(np.array([0.50, 0.02, 0.0]), np.diag([1.0, 1e-4, 1e-6]))
    both = joined(forward, aside)
    assert both.mean == pytest.approx([0.10, 0.02, 0.0], abs=1e-3)
    assert np.diag(both.covariance) == pytest.approx([1e-4, 1e-4, 1e-6], rel=1e-2)


def test_equal_estimates_average_and_halve_the_variance():
    a, b = (Planar(np.full(3, v), 0.04 * np.eye(3)) for v in (0.0, 1.0))
    both = joined(a, b)
    assert both.mean == pytest.approx([0.5] * 3)
    assert both.covariance == pytest.approx(0.02 * np.eye(3))
    assert distance(a, b) == pytest.approx(3 / 0.08)


def test_angles_that_differ_by_a_quarter_turn_are_the_same_direction():
    assert folded(np.radians([91.0, -89.0, 181.0, 44.0, 46.0])) == pytest.approx(np.radians([1.0, 1.0, 1.0, 44.0, -44.0]))


@pytest.mark.parametrize("true_deg", [0.0, 0.7, 33.0, 89.5])
def test_the_direction_of_square_walls_is_read_from_their_normals(true_deg):
    """Two walls at a right angle, two degrees of noise on 400 normals: a tenth of a degree is left of it."""
    rng = np.random.default_rng(0)
    walls = true_deg + rng.choice([0.0, 90.0, 180.0], 400) + rng.normal(0.0, 2.0, 400)
    read = wall_direction(cloud_of(np.radians(walls)), 0.6)
    assert abs(np.degrees(folded(read - np.radians(true_deg)))) < 0.3


def test_clutter_and_bare_views_tell_no_direction():
    rng = np.random.default_rng(1)
    assert wall_direction(cloud_of(rng.uniform(0.0, 6.3, 500)), 0.6) is None
    assert wall_direction(cloud_of(np.zeros(20)), 0.6) is None


def test_heading_does_not_drift_where_walls_are_seen():
    """Turns measured 5 % too large round four corners: with the walls the heading comes back, without it is 18 deg off."""
    rng = np.random.default_rng(2)

    def lap(with_walls: bool) -> float:
        heading, true = Heading(0.3, Fused()), 0.3
        heading.turn(0.0, 0.0, -true if with_walls else None)
        for turn in [*np.zeros(20), *np.full(15, np.radians(6.0))] * 4:
            true += turn
            reading = folded(-true + np.radians(0.5) * rng.standard_normal()) if with_walls else None
            heading.turn(1.05 * turn, (0.06 * turn + 0.003) ** 2, reading)
        return abs(np.degrees(heading.mean[0] - true))

    assert lap(True) < 0.5
    assert lap(False) == pytest.approx(18.0, abs=0.1)


def test_a_wall_askew_does_not_turn_the_robot():
    heading = Heading(0.0, Fused())
    for _ in range(20):
        heading.turn(0.0, 1e-8, 0.0)
    heading.turn(0.0, 1e-8, np.radians(20.0))
    assert abs(np.degrees(heading.mean[0])) < 0.1
    assert np.linalg.eigvalsh(heading.covariance)[0] > 0


def test_settings_are_checked():
    with pytest.raises(ConfigError, match="walls_share"):
        Fused(walls_share=float("nan"))
