"""Scans whose beams go round while the robot turns: put right by the wheels where the scans show it, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest
from bags import BagFile
from laser_rooms import box

from rhs_sources.replay_config import Replay

WALLS = np.concatenate([box(-3.0, -2.0, 4.0, 3.0), box(1.0, 1.0, 1.6, 1.5), box(-2.0, -1.5, -1.2, -0.8)])
BEAMS, RATE_HZ, COUNT = 240, 10.0, 120
BEARINGS = np.linspace(-np.pi, np.pi, BEAMS, endpoint=False)
T0_S = 1000.0


def poses_at(time_s):
    """(N, 3): there and back along x while it turns to and fro at up to 1.2 rad/s."""
    return np.stack([0.4 * np.sin(0.5 * time_s), 0.0 * time_s, 1.2 * np.sin(time_s)], axis=-1)


def ranges_at(time_s, bearings):
    """What beams see that leave at times (N,)."""
    pose = poses_at(time_s)
    ray = np.stack([np.cos(pose[:, 2] + bearings), np.sin(pose[:, 2] + bearings)], axis=1)[:, None]
    start, along = WALLS[None, :, 0] - pose[:, None, :2], (WALLS[:, 1] - WALLS[:, 0])[None]
    cross = ray[..., 0] * along[..., 1] - ray[..., 1] * along[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]) / cross
        share = (start[..., 0] * ray[..., 1] - start[..., 1] * ray[..., 0]) / cross
    return np.where((reach > 0) & (share >= 0) & (share <= 1), reach, np.inf).min(axis=1)


def bag_of(folder, *, way: float, said_s: float = 0.0) -> Replay:
    """way: 1.0, the beams go to the left during a scan; -1.0, to the right; 0.0, all at once. said_s: time_increment."""
    after_s = np.arange(BEAMS)[::-1 if way < 0.0 else 1] / (BEAMS * RATE_HZ) * abs(way)
    with BagFile(folder, "ros2_mcap") as bag:
        for k in range(COUNT):
            for time_s in k / RATE_HZ + np.arange(0.0, 1.0 / RATE_HZ, 0.02):
                bag.odometry("/odom", T0_S + time_s, *poses_at(time_s))
            stamp_s = k / RATE_HZ
            ranges = ranges_at(stamp_s + after_s, BEARINGS).astype(np.float32)
            bag.clock_s = T0_S + stamp_s + 1.0 / RATE_HZ
            bag.put("/scan", T0_S + stamp_s, bag.make(
                "sensor_msgs/msg/LaserScan", header=bag.header(T0_S + stamp_s, "laser"), angle_min=-np.pi,
                angle_max=float(BEARINGS[-1]), angle_increment=2.0 * np.pi / BEAMS, time_increment=said_s, scan_time=0.1,
                range_min=0.1, range_max=30.0, ranges=ranges, intensities=np.zeros(0, np.float32)))
            bag.clock_s = None
    return Replay(path=str(bag.path))


def off_m(settings: Replay) -> float:
    """Typical distance, metres, of the ends of fast turning scans from where the walls are as seen at their stamps."""
    source, errors = settings.build(None), []
    while (view := source.lead()) is not None:
        time_s = view.stamp_s - T0_S
        if 1.0 < time_s < COUNT / RATE_HZ - 1.0 and abs(np.cos(time_s)) > 0.7:
            met = np.isfinite(view.scan.ranges_m)
            true = ranges_at(np.full(met.sum(), time_s), view.scan.bearings_rad[met])
            errors.append(np.abs(view.scan.ranges_m[met] - true).mean())
    source.close()
    return float(np.mean(errors))


@pytest.mark.parametrize(("way", "said_s"), [(1.0, 1.0 / (BEAMS * RATE_HZ)), (1.0, 0.0), (-1.0, 1.0 / (BEAMS * RATE_HZ))])
def test_scans_are_put_right_whatever_the_driver_says_of_its_beams(tmp_path, way, said_s, caplog):
    settings = bag_of(tmp_path, way=way, said_s=said_s)
    after = off_m(settings)
    assert "a scan takes 100 ms" in caplog.text
    settings.deskew = False
    assert after < 0.01 and off_m(settings) > 0.05


def test_scans_of_one_instant_are_left_as_they_are(tmp_path, caplog):
    settings = bag_of(tmp_path, way=0.0, said_s=1.0 / (BEAMS * RATE_HZ))
    assert off_m(settings) < 1e-6 and "a scan takes" not in caplog.text
