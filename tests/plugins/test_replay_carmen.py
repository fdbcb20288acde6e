"""CARMEN logs of every kind of scan line: the same drive is the same views, and what is damaged is refused with its line."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

RANGES = ([1.0, 2.0, 50.0], [1.5, 0.0, 2.5])
POSES = ((1.0, 1.0, np.pi / 2), (1.0, 1.3, np.pi / 2))  # of the robot: 0.3 m north, looking north
MOUNT = (0.2, 0.0, 0.0)  # the laser sits 0.2 m ahead
HEAD = "4 -1.570796 3.141592 1.570796 30.0 0.01 0"


def words(*values):
    return " ".join(str(value) for value in values)


def flaser(ranges, laser, robot, stamp):
    return f"FLASER {len(ranges)} {words(*ranges, *laser, *robot)} {stamp} host {stamp}"


def robotlaser(ranges, laser, robot, stamp, *, remissions=" 2 7 9"):
    return (f"ROBOTLASER1 {HEAD} {len(ranges)} {words(*ranges)}{remissions} {words(*laser, *robot)} 0 0 1 1 0 "
            f"{stamp} host {stamp}")


def old_robotlaser(ranges, laser, robot, stamp):
    return robotlaser(ranges, laser, robot, stamp, remissions="").replace(" 0 0 1 1 0 ", " 0 0 1 1 ")


def laser_of(robot, mount=MOUNT):
    pose = se2(*robot) @ se2(*mount)
    return (*pose[:2, 3], float(np.arctan2(pose[1, 0], pose[0, 0])))


def views(path, lines, **settings):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    source = Replay(path=str(path), **settings).build(None)
    seen = []
    while (capture := source.lead()) is not None:
        seen.append((capture, source.truth()))
    source.close()
    return seen


@pytest.mark.parametrize("line", [flaser, robotlaser, old_robotlaser])
def test_a_scan_with_its_pose_is_read_whatever_its_line_is_called(tmp_path, line):
    lines = [line(RANGES[k], laser_of(POSES[k]), POSES[k], 10.0 + k) for k in range(2)]
    (first, _), (second, _) = views(tmp_path / "a.log", lines)
    assert (first.stamp_s, second.stamp_s) == (10.0, 11.0)
    np.testing.assert_allclose(first.scan.bearings_rad, [-np.pi / 2, 0.0, np.pi / 2], atol=1e-6)
    np.testing.assert_array_equal(first.scan.ranges_m, [1.0, 2.0, np.inf])  # 50 m is more than 30
    np.testing.assert_array_equal(second.scan.ranges_m, [1.5, np.nan, 2.5])
    np.testing.assert_allclose(second.travel, [0.3, 0.0, 0.0], atol=1e-9)


def test_a_scan_without_a_pose_takes_the_odometry_between_the_lines_about_it(tmp_path):
    raw = [f"RAWLASER1 {HEAD} 3 {words(*RANGES[k])} 0 {10.0 + k} host {10.0 + k}" for k in range(2)]
    odom = [f"ODOM {words(*pose)} 0 0 0 {stamp} host {stamp}" for stamp, pose in
            ((9.5, (0.0, 0.0, 3.1)), (10.5, (0.4, 0.0, -3.1)), (11.5, (0.8, 0.0, -3.1)))]
    (first, _), (second, _) = views(tmp_path / "a.log", [odom[0], raw[0], odom[1], raw[1], odom[2]])
    np.testing.assert_array_equal(first.scan.ranges_m, [1.0, 2.0, np.inf])
    turn = 2 * np.pi - 6.2  # from 3.1 to -3.1 the short way, half of it before the first scan
    np.testing.assert_allclose(second.travel[2], turn / 2, atol=1e-9)
    np.testing.assert_allclose(np.hypot(*second.travel[:2]), 0.4, atol=1e-9)
    alone = views(tmp_path / "b.log", raw)
    assert [capture.travel for capture, _ in alone] == [None, None]


def test_scans_that_carry_their_pose_are_taken_before_raw_ones(tmp_path):
    raw = f"RAWLASER1 {HEAD} 3 9 9 9 0 9.9 host 9.9"
    lines = [raw, flaser(RANGES[0], POSES[0], POSES[0], 10.0), raw, robotlaser(RANGES[1], POSES[1], POSES[1], 10.0)]
    assert [capture.stamp_s for capture, _ in views(tmp_path / "a.log", lines)] == [10.0]  # the second would be it again


def test_true_poses_of_a_simulator_are_those_of_its_laser(tmp_path):
    lines = [line for k, pose in enumerate(POSES) for line in (
        f"TRUEPOS {words(5.0, 2.0 + k, np.pi / 2)} {words(*pose)} {10.0 + k} host 1",
        flaser(RANGES[k], laser_of(pose), pose, 10.0 + k))]
    (_, first), (_, second) = views(tmp_path / "a.log", lines)
    np.testing.assert_allclose(first[:2, 3], [5.0, 2.2], atol=1e-9)
    np.testing.assert_allclose(second[:2, 3], [5.0, 3.2], atol=1e-9)


def test_poses_that_somebody_corrected_are_the_truth_where_that_is_typed(tmp_path):
    lines = [flaser(RANGES[0], (0, 0, 0), POSES[0], 10.0), flaser(RANGES[1], (0.5, 0.1, 0), POSES[1], 11.0)]
    (_, first), (second, truth) = views(tmp_path / "a.log", lines, truth="corrected")
    np.testing.assert_allclose(second.travel, [0.3, 0.0, 0.0], atol=1e-9)  # the odometry, not what was corrected
    np.testing.assert_allclose(first[:2, 3], [0.0, 0.0])
    np.testing.assert_allclose(truth[:2, 3], [0.5, 0.1])
    with pytest.raises(ConfigError, match="nobody has corrected them"):
        views(tmp_path / "b.log", [flaser(RANGES[0], POSES[0], POSES[0], 10.0)] * 2, truth="corrected")


@pytest.mark.parametrize(("line", "said"), [
    (f"ROBOTLASER1 {HEAD} 3 1 2", "a.log:1: found 11 words for 3 beams; expected ROBOTLASER1 type"),
    (f"ROBOTLASER1 {HEAD} 3 1 2 3 99 1 2 3 1 2 3 0 0 1 1 0 1 host 1", "the poses of laser and robot behind 3 ranges"),
    ("ROBOTLASER1 4 nan 3 1 30 0 0 3 1 2 3 0 0 0 0 0 0 0 0 0 1 1 0 1 host 1", "3 beams from nan"),
    ("ROBOTLASER1 4 0 3 5 30 0 0 3 1 2 3 0 0 0 0 0 0 0 0 0 1 1 0 1 host 1", "expected at most a turn"),
    (f"RAWLASER1 {HEAD} nan 1 2", "found 11 words for 0 beams"),
    (f"RAWLASER1 {HEAD} many 1 2", "'many' where a number was expected"),
])
def test_damaged_scans_are_refused_with_their_line(tmp_path, line, said):
    with pytest.raises(ConfigError, match=said):
        views(tmp_path / "a.log", [line])


def test_a_scanner_that_says_nothing_by_its_largest_reading(tmp_path):
    """8.19 m of a scanner that ends there, in one beam of three, is free space; walls up to 7.9 m stay walls."""
    rng = np.random.default_rng(0)
    walls = np.round(rng.uniform(0.5, 7.9, (200, 2)), 2)
    lines = [flaser([a, 8.19, b], laser_of(POSES[0]), POSES[0], 10.0 + 0.1 * k) for k, (a, b) in enumerate(walls)]
    for (capture, _), (a, b) in zip(views(tmp_path / "a.log", lines), walls, strict=True):
        np.testing.assert_array_equal(capture.scan.ranges_m, [a, np.inf, b])


def test_the_furthest_wall_is_no_end_of_range(tmp_path):
    rng = np.random.default_rng(0)
    walls = np.round(rng.uniform(0.5, 8.19, (200, 3)), 2)
    lines = [flaser(row, laser_of(POSES[0]), POSES[0], 10.0 + 0.1 * k) for k, row in enumerate(walls)]
    seen = np.array([capture.scan.ranges_m for capture, _ in views(tmp_path / "a.log", lines)])
    np.testing.assert_array_equal(seen, walls)


@pytest.mark.parametrize(("unit", "refused"), [(1, False), (40, False), (100, True), (1000, True)])
def test_readings_in_millimetres_or_centimetres_are_refused(tmp_path, unit, refused):
    """As metres nearly all would be further than a laser sees, and the robot in a void; 40 times: out of doors."""
    ranges = [unit * metres for metres in (1.0, 1.5, 2.0, 2.5, 3.0)]
    lines = [flaser(ranges, laser_of(POSES[k]), POSES[k], 10.0 + k) for k in range(2)]
    if refused:
        with pytest.raises(ConfigError, match=f"a.log: a typical reading is {2 * unit}; expected metres"):
            views(tmp_path / "a.log", lines)
    else:
        assert len(views(tmp_path / "a.log", lines)) == 2


@pytest.mark.parametrize(("beams", "degrees", "said"), [(181, 180.0, False), (360, 180.0, False), (541, 180.0, True),
                                                        (541, 270.0, False)])
def test_a_number_of_beams_that_is_no_half_turns_is_said(tmp_path, caplog, beams, degrees, said):
    """FLASER does not say what its beams cover: 541 of a Hokuyo (270 degrees) were laid over 180 without a word."""
    line = f"FLASER {beams} {'2.00 ' * beams}0 0 0 0 0 0 {{0:.2f}} host {{0:.2f}}\n"
    (tmp_path / "a.log").write_text("".join(line.format(0.1 * k) for k in range(3)))
    open_recording(Replay(path=str(tmp_path / "a.log"), laser_fov_deg=degrees))
    assert ("type source.laser_fov_deg" in caplog.text) == said
