"""Which view can follow which."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import FEATURES, look

from rhs.continuity import Continuity, continuity
from rhs.geometry import inverse, se2
from rhs.vision import features


def _round(angle):
    return se2(1.4 * np.cos(angle), 1.4 * np.sin(angle), angle + 1.5)


@pytest.mark.parametrize("angle", [0.1, 1.0, 2.5, 4.0])
def test_a_view_goes_on_from_the_last_by_the_motion_between_and_not_from_across_the_room(angle):
    before, after, across = (look(_round(a)) for a in (angle, angle + 0.1, angle + 3.1))
    step = inverse(_round(angle)) @ _round(angle + 0.1)
    last = features(before, FEATURES)
    assert continuity(last, features(after, FEATURES), before.camera, step) is Continuity.GOES_ON
    assert continuity(last, features(across, FEATURES), before.camera, step) is Continuity.BROKEN


def test_without_a_view_before_or_without_depth_nobody_can_tell():
    before, after = look(_round(0.1)), look(_round(0.2))
    step = inverse(_round(0.1)) @ _round(0.2)
    last, seen = features(before, FEATURES), features(after, FEATURES)
    flat = replace(last, points=np.full_like(last.points, np.nan))
    assert continuity(None, seen, before.camera, step) is Continuity.UNKNOWN
    assert continuity(flat, seen, before.camera, step) is Continuity.UNKNOWN
