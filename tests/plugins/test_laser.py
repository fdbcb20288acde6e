"""Sensor laser: hands on what was recorded."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from rhs.api.errors import ConfigError, ContractError
from rhs.api.geometry import Camera
from rhs.api.records import Capture, Scan
from rhs_sensors.laser import Laser


def test_near_readings_are_unknown_and_far_ones_free():
    sensor = Laser(min_range_m=0.1, max_range_m=8.0).build(SimpleNamespace(camera=Camera(1, 1, 1, 1, 0, 0)))
    scan = Scan(np.linspace(-1, 1, 4), np.array([0.05, 3.0, 9.0, np.nan]), 30.0)
    seen = sensor.sense(Capture(0, 1.0, scan=scan, travel=np.array([0.1, 0.0, 0.02])))
    np.testing.assert_array_equal(seen.scan.ranges_m, [np.nan, 3.0, np.inf, np.nan])
    assert seen.scan.max_range_m == 8.0
    np.testing.assert_array_equal(seen.wheel, [0.1, 0.0, 0.02])


def test_a_capture_without_a_scan_and_an_empty_range_are_refused():
    sensor = Laser().build(SimpleNamespace(camera=Camera(1, 1, 1, 1, 0, 0)))
    with pytest.raises(ContractError, match="no laser scan"):
        sensor.sense(Capture(3, 1.0))
    with pytest.raises(ConfigError, match="not below"):
        Laser(min_range_m=5.0, max_range_m=4.0)
