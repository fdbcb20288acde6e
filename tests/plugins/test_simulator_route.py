"""How the camera is led along a route: counted and measured by hand."""

import numpy as np
import pytest

from rhs_sources.simulator_route import RoutePace, Wobble, waypoints

CORNER = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0]])
PIVOT = RoutePace(step_m=0.2, turn_step_rad=np.radians(10), speed_mps=0.5, turn_rate_radps=np.radians(30), arc_radius_m=0.0)
ARC = RoutePace(step_m=0.125, turn_step_rad=np.radians(6.4), speed_mps=0.5, turn_rate_radps=1.0, arc_radius_m=0.7)


def poses(views):
    return np.array([[v.x_m, v.y_m, v.yaw_rad] for v in views])


def test_a_corner_by_pivot_has_ten_steps_nine_turns_ten_steps():
    views = waypoints(CORNER, 0.0, PIVOT)
    assert len(views) == 1 + 10 + 9 + 10
    np.testing.assert_allclose(poses(views)[[0, 10, 19, 29]],
                               [[0, 0, 0], [2, 0, 0], [2, 0, np.pi / 2], [2, 2, np.pi / 2]], atol=1e-9)
    assert views[1].duration_s == pytest.approx(0.4) and views[15].duration_s == pytest.approx(1 / 3)
    assert sum(v.distance_m for v in views) == pytest.approx(4.0)


def test_a_start_that_looks_elsewhere_turns_first():
    views = waypoints(CORNER, np.pi / 2, PIVOT)
    assert len(views) == 1 + 9 + 10 + 9 + 10
    assert views[9].yaw_rad == pytest.approx(0.0) and views[9].distance_m == 0.0


def test_an_arc_of_07_m_takes_15_steps_and_stays_on_its_circle():
    views = poses(waypoints(CORNER, 0.0, ARC))
    # straights of 1.3 m in 11 steps each; 90 degrees in steps of at most 6.4 degrees are 15
    assert len(views) == 1 + 11 + 15 + 11
    arc = views[11:27]
    np.testing.assert_allclose(np.hypot(arc[:, 0] - 1.3, arc[:, 1] - 0.7), 0.7, atol=1e-9)
    np.testing.assert_allclose(np.diff(arc[:, 2]), np.radians(6.0), atol=1e-9)
    np.testing.assert_allclose(views[-1], [2, 2, np.pi / 2], atol=1e-9)


def test_an_arc_shrinks_where_the_leg_is_short_and_a_turn_back_is_a_pivot():
    short = poses(waypoints(np.array([[0.0, 0.0], [0.6, 0.0], [0.6, 0.6]]), 0.0, ARC))
    assert short[:, 0].max() == pytest.approx(0.6) and np.hypot(*(short[:, :2] - [0.3, 0.3]).T).min() < 0.31
    back = waypoints(np.array([[0.0, 0.0], [2.0, 0.0], [1.0, 0.0]]), 0.0, ARC)
    assert max(v.x_m for v in back) == pytest.approx(2.0)


def test_the_hand_wobbles_by_the_given_rms_and_not_at_the_start():
    rng = np.random.default_rng(1)
    away = np.linspace(2, 500, 5000)
    rms = [np.sqrt(np.mean([Wobble(rng, 0.02)(d) ** 2 for d in away])) for _ in range(5)]
    np.testing.assert_allclose(rms, 0.02, rtol=0.15)
    assert Wobble(rng, 0.02)(0.0) == 0.0
