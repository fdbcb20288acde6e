"""Clouds of a lidar that turns while it drives: when each point was seen, and where it would have been at the stamp."""

from __future__ import annotations

import numpy as np
import pytest
from bags import BagFile

from rhs.api.geometry import exp_se3, inverse, log_se3, transform
from rhs.api.records import Observation, Scan
from rhs.testing.room import FURNISHED, cloud_of
from rhs_odometry.lidar.config import VgicpLidar
from rhs_odometry.lidar.deskew import deskewed, deskewed_scan
from rhs_sources.replay_config import Replay
from rhs_sources.replay_stamps import seconds_after

TWIST = np.array([1.0, 0.2, -0.1, 0.1, -0.2, 1.5])  # metres and radians a second


def test_still_points_seen_by_a_body_of_constant_velocity_come_to_lie_where_they_are():
    rng = np.random.default_rng(0)
    still, after = rng.uniform(-20.0, 20.0, (50, 3)), np.concatenate([[0.0], rng.uniform(-0.1, 0.1, 49)])
    seen = np.array([transform(inverse(exp_se3(t * TWIST)), point[None])[0] for t, point in zip(after, still, strict=True)])
    np.testing.assert_allclose(deskewed(seen, after, exp_se3(0.2 * TWIST), 0.2), still, atol=1e-9)


@pytest.mark.parametrize(("times", "after"), [
    ([0.0, 0.05, 0.1], [0.0, 0.05, 0.1]),  # seconds after the stamp
    ([-0.1, -0.05, 0.0], [-0.1, -0.05, 0.0]),  # a stamp at the end of the turn
    ([0, 50_000_000, 100_000_000], [0.0, 0.05, 0.1]),  # nanoseconds (Ouster)
    ([0, 50_000, 100_000], [0.0, 0.05, 0.1]),  # microseconds
    ([1.7e9 + 0.5, 1.7e9 + 0.55, 1.7e9 + 0.6], [0.0, 0.05, 0.1]),  # since 1970 (Hesai)
    ([1.7e18 + 5e8, 1.7e18 + 5.5e8, 1.7e18 + 6e8], [0.0, 0.05, 0.1]),  # the same in nanoseconds (Livox)
    ([80.0, 80.05, 80.1], [0.0, 0.05, 0.1]),  # of another clock: the first point is of the stamp
])
def test_the_times_of_a_turn_in_seconds_whatever_a_driver_writes(times, after):
    np.testing.assert_allclose(seconds_after(1.7e9 + 0.5, np.array(times)), after, atol=1e-6)


@pytest.mark.parametrize("times", [[0.0, 0.0, 0.0], [np.nan, 0.0, 0.1], [0.0, 1.0, 2.0], []])
def test_what_are_no_times_of_one_turn_are_none(times):
    assert seconds_after(0.0, np.array(times)) is None


def test_times_of_points_are_read_from_files_and_bags_and_left_out_with_points_without_a_place(tmp_path):
    points, times = np.array([[1.0, 2.0, 3.0], [np.nan, 0.0, 0.0], [4.0, 5.0, 6.0]]), [0.0, 0.05, 0.1]
    rows = "".join(f"{t} {x} {y} {z}\n" for t, (x, y, z) in zip(times, points, strict=True))
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "0.pcd").write_text("FIELDS time x y z\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nPOINTS 3\n"
                                              f"DATA ascii\n{rows}")
    with BagFile(tmp_path, "ros2_mcap") as bag:
        bag.cloud("/points", 3.0, points, times_ns=np.array([0, 50_000_000, 100_000_000]))
    for path in (tmp_path / "files", bag.path):
        source = Replay(path=str(path)).build(None)
        extras = source.lead().extras
        source.close()
        np.testing.assert_allclose(extras["cloud"], points[[0, 2]], atol=1e-6)
        np.testing.assert_allclose(extras["cloud_time_s"], [0.0, 0.1], atol=1e-6)


def turned(poses, k, slices=12):
    """Cloud k of a scanner that turns once from one pose to the next, and when each point was seen."""
    step, points, times = inverse(poses[k]) @ poses[k + 1], [], []
    for i in range(slices):
        cloud = cloud_of(poses[k] @ exp_se3(i / slices * log_se3(step)), FURNISHED, k)
        turn = (np.arctan2(cloud[:, 1], cloud[:, 0]) + np.pi) / (2.0 * np.pi)
        points.append(cloud[(turn >= i / slices) & (turn < (i + 1) / slices)])
        times.append(np.full(len(points[-1]), 0.1 * i / slices))
    return {"cloud": np.concatenate(points), "cloud_time_s": np.concatenate(times)}


def test_a_turning_scanner_is_followed_better_where_its_points_have_times():
    """1 m/s and 1.5 rad/s: in one turn of the scanner the room moves by 10 cm and 9 degrees."""
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.15])
    start = exp_se3(np.array([-0.5, -0.5, 0.0, 0.0, 0.0, 0.0]))
    poses = [start @ exp_se3(k * twist) for k in range(10)]
    errors = {}
    for deskew in (True, False):
        odometry, here = VgicpLidar(deskew=deskew).build(None), np.eye(4)
        for k in range(9):
            here = here @ odometry.update(Observation(k, 0.1 * k, None, extras=turned(poses, k))).previous_from_body
        off = inverse(here) @ inverse(poses[0]) @ poses[8]
        errors[deskew] = float(np.linalg.norm(off[:3, 3]))
    assert errors[True] < 0.01 and errors[True] < 0.4 * errors[False]


@pytest.mark.parametrize("before", [True, False])
def test_clouds_that_were_deskewed_before_are_known_by_their_beams(before, caplog):
    """On a robot that turns to and fro by up to 1 rad/s a scanner turns ten times a second. Deskewed twice a cloud is bent
    the other way."""
    start = exp_se3(np.array([-0.5, -0.5, 0.0, 0.0, 0.0, 0.0]))
    poses, odometry, errors = [start], VgicpLidar().build(None), []
    for k in range(60):
        poses.append(poses[-1] @ exp_se3(np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.1 * np.sin(k / 5)])))
    for k in range(59):
        extras = turned(poses, k)
        if before:
            step = inverse(poses[k]) @ poses[k + 1]
            extras["cloud"] = deskewed(extras["cloud"].astype(float), extras["cloud_time_s"], step, 0.1)
        motion = odometry.update(Observation(k, 0.1 * k, None, extras=extras)).previous_from_body
        if k > 41:
            errors.append(np.abs(inverse(motion) @ inverse(poses[k - 1]) @ poses[k] - np.eye(4)).max())
    assert ("deskewed before" in caplog.text) == before
    assert np.mean(errors) < 0.004


def test_the_scans_for_the_map_are_as_of_their_stamps(tmp_path):
    """A wall 4 m ahead, seen from -45 to 45 degrees while the robot drives up to it at 1 m/s for 0.1 s."""
    bearings = np.radians(np.arange(-45.0, 46.0, 1.0))
    after = 0.1 * (bearings - bearings[0]) / (bearings[-1] - bearings[0])
    ranges = (4.0 - after) / np.cos(bearings)
    ends = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(ranges))])
    scan = Scan(bearings, np.where(np.arange(91) == 40, np.nan, ranges), 50.0)
    straight = deskewed_scan(scan, ends, after, exp_se3(np.array([0.2, 0, 0, 0, 0, 0])), 0.2)
    known = np.isfinite(straight.ranges_m)
    assert known.sum() == 90
    x, y = straight.ranges_m[known] * [np.cos(straight.bearings_rad[known]), np.sin(straight.bearings_rad[known])]
    np.testing.assert_allclose(x, 4.0, atol=1e-9)
    np.testing.assert_allclose(y, np.delete(ends[:, 1], 40), atol=1e-9)


def test_only_logs_with_times_have_scans_settled_anew():
    twist = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.15])
    poses = [exp_se3(np.array([-0.5, -0.5, 0.0, 0.0, 0.0, 0.0])) @ exp_se3(k * twist) for k in range(5)]
    scan = Scan(np.radians(np.arange(-179.0, 180.0)), np.full(359, 1.0), 50.0)
    for deskew in (True, False):
        odometry = VgicpLidar(deskew=deskew).build(None)
        motions = [odometry.update(Observation(k, 0.1 * k, None, scan=scan, extras=turned(poses, k))) for k in range(4)]
        revision = odometry.revise()
        assert (revision is not None) == deskew
        if revision is not None:
            np.testing.assert_allclose(revision.poses[2], motions[1].previous_from_body @ motions[2].previous_from_body)
            assert all(np.ptp(one.ranges_m) > 0.05 for one in revision.scans)
