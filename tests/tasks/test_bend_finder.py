"""A bend found from two views: told from a tilt, from points alone; and what is known of it adds up."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs.worlds.tubes import RoundSection, Tube
from rhs_tasks.unroll.bend_finder import PairFit
from rhs_tasks.unroll.bending import KNOT, Profile, Winding
from rhs_tasks.unroll.settings import Unrolling
from rhs_tasks.unroll.unrolling import seen_from

CAMERA = Camera(320, 240, 160.0, 160.0, 159.5, 119.5)
ROUND = RoundSection(1.0)
AHEAD = slice(0, 13)


def points(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(1.6, 5.5, 200), rng.uniform(0.0, 2 * np.pi, 200)])


def fitted(true_bends: np.ndarray, places: tuple[np.ndarray, np.ndarray], noise_px: float = 0.0) -> PairFit:
    """A fit that begins at a straight tube and untilted views, of points seen in the true one."""
    wall, true = points(), Winding(ROUND, true_bends)
    seen = np.concatenate([seen_from(true, CAMERA, place, wall) for place in places], axis=1)
    seen += noise_px * np.random.default_rng(1).standard_normal(seen.shape)
    profile = Profile()
    profile.reach(KNOT * (len(true_bends) - 2))
    along = [np.array([place[0], 0.0, 0.0, 0.0, 0.0, 0.0]) for place in places]
    fit = PairFit(Winding(ROUND, np.zeros(len(true_bends))), CAMERA, (along[0], along[1]), AHEAD)
    fit.run(wall, seen, *profile.prior(AHEAD))
    profile.add(AHEAD, *fit.says())
    fit.profile = profile
    return fit


def test_a_winding_of_one_curvature_is_the_arc_of_a_tube():
    """0.1 rad a size for ten sizes: both tubes turn by 57.3 degrees and end in the same place."""
    winding, tube = Winding(ROUND, np.full(30, 0.1)), Tube(ROUND, ((20.0, 0.1),))
    assert np.allclose(winding.pose(10.0), tube.pose(10.0), atol=1e-4)
    assert np.degrees(winding.heading(10.0)) == pytest.approx(57.3, abs=0.01)
    wall = np.array([[0.5, 0.0], [3.0, 2.0], [9.0, 5.0]])
    assert np.allclose(winding.points(*wall.T), tube.points(*wall.T), atol=1e-4)


def test_a_bend_is_found_and_not_taken_for_a_tilt():
    """Five degrees a size to the left, the camera straight in it; found to a tenth."""
    fit = fitted(np.full(15, np.radians(5.0)), (np.zeros(6), np.array([0.8, 0, 0, 0, 0, 0])))
    assert np.degrees(fit.profile.bends[3:9]) == pytest.approx(5.0, abs=0.5)
    assert abs(np.degrees(fit.later[5])) < 0.5


def test_a_tilt_is_found_and_not_taken_for_a_bend():
    """A straight tube, both views turned to the left by two degrees and 0.05 sizes aside: one sigma of the prior. What the
    tube does before the first wall that is seen no pair can tell, so the tilt is measured against the tube three sizes
    ahead."""
    turned = np.array([0.0, 0.05, 0.0, 0.0, 0.0, np.radians(2.0)])
    fit = fitted(np.zeros(15), (turned, turned + [0.8, 0, 0, 0, 0, 0]))
    assert np.degrees(np.abs(fit.profile.bends[4:9]).max()) < 1.0
    winding = Winding(ROUND, fit.bends)
    tilt = fit.later[5] + winding.heading(0.8) - winding.heading(3.0)
    assert np.degrees(tilt) == pytest.approx(2.0, abs=0.3)
    assert fit.later[1] == pytest.approx(0.05, abs=0.02)


def test_pairs_add_up():
    """The same said twice is twice as sure; of what no pair has seen little is known."""
    profile = Profile()
    profile.reach(10.0)
    free = np.linalg.inv(profile.information)[4, 4]
    profile.add(slice(4, 5), np.array([[1e4]]), np.array([1e4 * 0.1]))
    once = np.linalg.inv(profile.information)[4, 4]
    profile.add(slice(4, 5), np.array([[1e4]]), np.array([1e4 * 0.1]))
    twice = np.linalg.inv(profile.information)[4, 4]
    assert profile.bends[4] == pytest.approx(0.1, rel=0.02)
    assert once / twice == pytest.approx(2.0, rel=0.02) and free > 50 * once


def test_a_bend_cannot_be_told_and_found():
    with pytest.raises(ConfigError, match=r"unroll.bend=given"):
        Unrolling(bend="found", pieces=[1.0, 30.0])
    with pytest.raises(ConfigError, match="bend"):
        Unrolling(bend="guessed")
