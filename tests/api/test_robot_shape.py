"""A robot that is not round: how far its side is, on paper and by brute force; what is no footprint is refused."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.robot_shape import footprint_of

LONG = ((0.4, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.4, -0.2))
WEDGE = ((0.5, 0.0), (-0.2, 0.25), (-0.3, 0.0), (-0.2, -0.25))


def test_a_rectangle_by_hand():
    """0.65 m long, 0.4 m wide, turning 0.25 m before its back."""
    robot = footprint_of(LONG, "it")
    assert robot.radius_m == pytest.approx(np.hypot(0.4, 0.2)) and robot.half_m == pytest.approx(0.2)
    points = np.array([[0.7, 0.0], [-0.35, 0.1], [0.0, 0.5], [0.7, 0.6], [0.0, 0.0], [0.38, 0.0]])
    np.testing.assert_allclose(robot.gaps_m(points), [0.3, 0.1, 0.3, 0.5, -0.2, -0.02], atol=1e-12)
    np.testing.assert_allclose(robot.reach_m(np.radians([0.0, 90.0, 180.0, 45.0])), [0.4, 0.2, 0.25, 0.2 * np.sqrt(2.0)])
    assert footprint_of(LONG[::-1], "it").gaps_m(points) == pytest.approx(robot.gaps_m(points)), "either way round"
    np.testing.assert_allclose(robot.at((1.0, 2.0, np.pi / 2))[0], [0.8, 2.4], atol=1e-12)
    assert footprint_of((), "it") is None


@pytest.mark.parametrize("corners", [LONG, WEDGE])
def test_the_gap_to_an_outline_is_that_of_their_borders(corners):
    rng, robot = np.random.default_rng(4), footprint_of(corners, "it")
    outlines = rng.uniform(-1.0, 1.0, (40, 1, 2)) + 0.15 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])[None]
    outlines[20:, 2:] = outlines[20:, 1:2]  # some are triangles, one corner given more than once
    outlines[30:, 1:] = outlines[30:, 1:2]  # and some are walls without thickness
    share = np.linspace(0.0, 1.0, 200)[:, None]
    for number, outline in enumerate(outlines):
        stand = (*rng.uniform(-0.7, 0.7, 2), rng.uniform(-np.pi, np.pi))
        mine = robot.at(stand)
        borders = [np.concatenate([a + share * (b - a) for a, b in zip(p, np.roll(p, -1, axis=0), strict=True)])
                   for p in (mine, outline)]
        nearest = np.linalg.norm(borders[0][:, None] - borders[1][None], axis=2).min()
        gap = robot.gap_to_m(outlines[number:number + 1], stand, 5.0)
        c, s = np.cos(stand[2]), np.sin(stand[2])
        in_body = (borders[1] - np.array(stand[:2])) @ np.array([[c, -s], [s, c]])
        if (robot.gaps_m(in_body) < -0.01).any():
            assert gap < 0.0
        elif gap > 0.0:
            assert gap == pytest.approx(nearest, abs=3e-3)
    all_m = min(robot.gap_to_m(outlines[k:k + 1], stand, 5.0) for k in range(len(outlines)))
    assert robot.gap_to_m(outlines, stand, 5.0) == all_m
    assert robot.gap_to_m(outlines + 50.0, stand, 2.0) == 2.0


@pytest.mark.parametrize(("corners", "words"), [
    (((0.3, 0.2), (-0.3, 0.2)), "three corners or more"),
    (((0.3, 0.2), (-0.3, 0.2), (0.0, np.nan)), "three corners or more"),
    (((0.3, 0.2), (-0.3, 0.2), (0.0,)), "three corners or more"),
    (((0.3, 0.2), (-0.3, -0.2), (-0.3, 0.2), (0.3, -0.2)), "no convex polygon"),
    (((0.3, 0.3), (-0.3, 0.3), (0.0, 0.05), (-0.3, -0.3), (0.3, -0.3)), "no convex polygon"),
    (((0.4, 0.2), (0.1, 0.2), (0.1, -0.2), (0.4, -0.2)), "must lie within it"),
    (((3.0, 2.0), (-3.0, 2.0), (-3.0, -2.0), (3.0, -2.0)), "expected 0.05 to 2.0 m"),
    (((0.02, 0.02), (-0.02, 0.02), (-0.02, -0.02), (0.02, -0.02)), "expected 0.05 to 2.0 m"),
])
def test_what_is_no_footprint_is_refused_in_one_line(corners, words):
    with pytest.raises(ConfigError, match="^it: ") as caught:
        footprint_of(corners, "it")
    assert words in str(caught.value) and "\n" not in str(caught.value)
