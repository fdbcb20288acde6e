"""What the wheels get wrong always is learnt from what the scans saw, whatever single readings leap."""

import numpy as np
import pytest

from rhs_odometry.scan_to_map.wheel_bias import WheelBias

BOTH = (True, True)


def driven(bias, seen=BOTH, leap_every=0):
    """200 steps of 0.1 m, turning to both sides: the wheels count 5 % too few metres, and 3 degrees a metre are missing."""
    rng = np.random.default_rng(0)
    for k in range(200):
        turn = rng.uniform(-0.15, 0.15)
        reading = np.array([0.1 / 1.05, 0.0, turn - np.radians(3.0) * 0.1])
        if leap_every and k % leap_every == 0:
            reading = reading + (0.5, 0.0, 0.7)
        bias.learn(reading, np.array([0.1, 0.0, turn]), seen)
    return bias.corrected(np.array([1.0, 0.0, 0.0]))


@pytest.mark.parametrize("leap_every", [0, 25])
def test_metres_and_drift_are_found_though_readings_leap(leap_every):
    metres, _, turn = driven(WheelBias(), leap_every=leap_every)
    assert metres == pytest.approx(1.05, abs=0.01) and np.degrees(turn) == pytest.approx(3.0, abs=0.6)


def test_what_the_scans_did_not_see_teaches_nothing():
    assert driven(WheelBias(), seen=(False, False)) == pytest.approx([1.0, 0.0, 0.0])
