"""Where in its cell a thing stands is known to a fraction of the cell."""

import numpy as np
import pytest
from flatland import BEARINGS
from test_guard import STILL, guard, seen

from rhs.api.geometry import se2
from rhs.api.records import Motion, Tracking


@pytest.mark.parametrize("wall_m", [1.502, 1.525, 1.548])
def test_a_wall_is_where_it_was_seen_wherever_that_is_in_a_cell(wall_m):
    """Cells are 5 cm wide; the robot comes 30 cm nearer in steps that are no multiple of that."""
    watched = guard()
    watched.observe(seen(1, wall_m / np.cos(BEARINGS)), STILL)
    for number in range(2, 6):
        left_m = (wall_m - 0.077 * (number - 1)) / np.cos(BEARINGS)
        watched.observe(seen(number, left_m), Motion(se2(0.077, 0.0, 0.0), 1e-6 * np.eye(6), Tracking.OK))
    ahead_m = watched.around.things()[:, 0]
    assert len(ahead_m) > 10
    np.testing.assert_allclose(ahead_m, wall_m - 4 * 0.077, atol=0.002)


def test_the_last_views_of_a_thing_are_averaged_and_what_comes_anew_begins_anew():
    watched = guard()
    for number, wall_m in enumerate((1.515, 1.535, 1.52, 1.53, 1.515, 1.535, 1.52, 1.53), 1):
        watched.observe(seen(number, wall_m / np.cos(BEARINGS)), STILL)
    np.testing.assert_allclose(watched.around.things()[:, 0], 1.525, atol=0.004)
    for number in range(9, 40):  # it is seen through
        watched.observe(seen(number, 5.0), STILL)
    assert not len(watched.around.things())
    watched.observe(seen(40, 1.541 / np.cos(BEARINGS)), STILL)
    np.testing.assert_allclose(watched.around.things()[:, 0], 1.541, atol=0.002)


def test_what_was_touched_stands_where_it_was_touched():
    watched = guard()
    watched.observe(seen(1, 5.0), STILL)
    touched_m = watched.bump()
    known_m = watched.around.things()
    assert len(known_m) and np.linalg.norm(known_m[:, None] - touched_m, axis=2).min(axis=1).max() < 0.036
