"""Which pairs of views a loop closer looks at."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import rotation_z, se2
from rhs_loop_closers.candidates import beside, looked_back, progress_m, spread


def test_one_pair_of_each_stretch_comes_first_and_then_what_lies_beside_a_hit():
    """Ends in metres, best first: three pairs crowd at (0, 10), one lies at (3, 13), one at (8, 18)."""
    ends = np.array([[0.0, 10.0], [0.2, 10.1], [0.4, 10.3], [3.0, 13.0], [8.0, 18.0]])
    first = spread(ends, 1.0, 5)
    assert first.tolist() == [0, 3, 4]
    assert spread(ends, 1.0, 2).tolist() == [0, 3]
    assert beside(ends, first, [0], 1.0, 5).tolist() == [1, 2]
    assert beside(ends, np.array([0, 1]), [4], 1.0, 5).tolist() == [4, 2, 3]  # beside the last one first
    assert beside(ends, first, [], 1.0, 1).tolist() == [1]


def test_both_ends_must_be_near_for_a_pair_to_stand_in_for_another():
    ends = np.array([[0.0, 10.0], [0.0, 20.0]])
    assert spread(ends, 1.0, 2).tolist() == [0, 1]


def test_a_camera_that_looked_away_and_back_sees_a_place_again():
    """Heading 0, 60, 120, 60, 10, 0 degrees: from the first view it looked away by 120, more than 90."""
    turned = np.array([rotation_z(np.radians(a)) for a in (0.0, 60.0, 120.0, 60.0, 10.0, 0.0)])
    again = looked_back(turned, np.radians(90.0))
    assert np.argwhere(again).tolist() == [[0, 4], [0, 5]]
    assert not looked_back(turned, np.radians(130.0)).any()


def test_views_are_compared_a_few_at_a_time_as_if_all_at_once():
    turned = np.array([rotation_z(a) for a in np.random.default_rng(3).uniform(-3.0, 3.0, 40)])
    whole = looked_back(turned, 1.0)
    assert whole.any() and all(np.array_equal(looked_back(turned, 1.0, slice(k, k + 7)), whole[k : k + 7])
                               for k in range(0, 40, 7))


def test_a_radian_counts_as_a_metre():
    poses = np.array([se2(0, 0, 0), se2(3, 4, 0), se2(3, 4, 0.5)])
    assert progress_m(poses) == pytest.approx([0.0, 5.0, 5.5])
