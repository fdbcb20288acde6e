"""Sensor laser: hands on what was recorded."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import Camera
from rhs.api.records import Capture, Scan
from rhs_sensors.laser import Laser

CONTEXT = SimpleNamespace(camera=Camera(1, 1, 1, 1, 0, 0), rng=np.random.default_rng(0))


def test_near_readings_are_unknown_and_far_ones_free():
    sensor = Laser(min_range_m=0.1, max_range_m=8.0).build(CONTEXT)
    scan = Scan(np.linspace(-1, 1, 4), np.array([0.05, 3.0, 9.0, np.nan]), 30.0)
    seen = sensor.sense(Capture(0, 1.0, scan=scan, travel=np.array([0.1, 0.0, 0.02]), sensed=True))
    np.testing.assert_array_equal(seen.scan.ranges_m, [np.nan, 3.0, np.inf, np.nan])
    assert seen.scan.max_range_m == 8.0
    np.testing.assert_array_equal(seen.wheel, [0.1, 0.0, 0.02])


def test_a_capture_without_a_scan_and_an_empty_range_are_refused():
    sensor = Laser().build(CONTEXT)
    with pytest.raises(ContractError, match="no laser scan"):
        sensor.sense(Capture(3, 1.0))
    with pytest.raises(ConfigError, match="not below"):
        Laser(min_range_m=5.0, max_range_m=4.0)


def test_a_simulated_scanner_is_as_noisy_as_it_says_and_a_recorded_one_as_it_was():
    scan = Scan(np.linspace(-2, 2, 4000), np.full(4000, 3.0), 30.0)
    sensor = Laser(range_sigma_m=0.02).build(CONTEXT)
    noise = sensor.sense(Capture(0, 1.0, scan=scan)).scan.ranges_m - 3.0
    assert np.std(noise) == pytest.approx(0.02, rel=0.05) and abs(np.mean(noise)) < 0.002
    assert np.ptp(sensor.sense(Capture(1, 2.0, scan=scan, sensed=True)).scan.ranges_m) == 0.0
