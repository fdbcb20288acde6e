"""A laser that sits otherwise than told is known by the wheels; one that sits as told is never doubted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from laser_rooms import box, drive, observed

import rhs
from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.estimation.scans.mount_fit import fit_mount, heading_figures
from rhs.estimation.scans.planar_poses import between
from rhs.worlds.maps import save_map

ROOM = np.concatenate([box(0, 0, 12, 8), box(3, 2, 4, 5), box(7, 4, 10, 5), box(6, 0, 6.5, 2)])
WAY = drive([(1, 1), (5, 1), (5, 7), (1.5, 7), (1.5, 1), (5, 1.2), (5, 6.5), (11, 6.5), (11, 1), (7.5, 1), (7.5, 3)])


def seen(**more):
    views = observed(ROOM, WAY, **more)
    return [one.scan for one in views], [one.wheel for one in views]


def upside_down(scan):
    return replace(scan, bearings_rad=-scan.bearings_rad[::-1], ranges_m=scan.ranges_m[::-1])


@pytest.mark.parametrize("yaw_deg", [0, 30, 90, -90, 180])
@pytest.mark.parametrize("rolled", [False, True])
def test_a_mount_that_nobody_told_of_is_found(rolled, yaw_deg):
    """The scanner is rolled first, then turned; what it reports is as if it were neither."""
    scans, wheels = seen()
    turned = [replace(scan, bearings_rad=scan.bearings_rad - np.radians(yaw_deg)) for scan in scans]
    fit = fit_mount([upside_down(scan) for scan in turned] if rolled else turned, wheels)
    assert fit.upside_down == rolled
    off_deg = (fit.yaw_deg - yaw_deg + 180.0) % 360.0 - 180.0
    assert off_deg == pytest.approx(0.0, abs=5.0)  # it is looked for in steps of five degrees


@pytest.mark.parametrize("worse", ["noise", "drift", "short", "leaps"])
def test_bad_wheels_are_no_mount(worse):
    rng = np.random.default_rng(1)
    scans, wheels = seen()
    bad = np.array([np.zeros(3) if wheel is None else wheel for wheel in wheels])
    way_m = np.hypot(bad[:, 0], bad[:, 1])
    if worse == "noise":
        bad *= 1.0 + 0.3 * rng.standard_normal(bad.shape)
    elif worse == "drift":
        bad[:, 2] += 0.1 * way_m
    elif worse == "short":
        bad *= 0.8
    else:
        bad[rng.random(len(bad)) < 0.03] += [0.3, 0.3, 0.7]
    fit = fit_mount(scans, list(bad))
    assert not fit.upside_down and fit.yaw_deg == 0.0


@pytest.mark.parametrize("yaw_deg", [0, 8, 15, -20])
@pytest.mark.parametrize("worse", ["", "noise", "drift", "short"])
def test_a_small_turn_of_the_mount_is_known_by_the_way_as_it_was_solved(yaw_deg, worse):
    """The way as a sensor sees it that is turned by so much on its robot. Wheels whose heading drifts by 6 degrees a metre
    are no mount."""
    rng = np.random.default_rng(1)
    poses = np.array([se2(*pose) @ se2(0.0, 0.0, np.radians(yaw_deg)) for pose in WAY])
    wheels = np.vstack([np.zeros(3), between(WAY[:-1], WAY[1:])])
    if worse == "noise":
        wheels *= 1.0 + 0.3 * rng.standard_normal(wheels.shape)
    elif worse == "drift":
        wheels[:, 2] += 0.1 * np.hypot(wheels[:, 0], wheels[:, 1])
    elif worse == "short":
        wheels *= 0.8
    found = heading_figures(poses, list(wheels))
    assert found["mount_heading_off_deg"] == pytest.approx(yaw_deg, abs=1.5)
    assert heading_figures(poses, [None] * len(poses)) == {}


def test_without_wheels_or_way_or_walls_nothing_is_said():
    scans, wheels = seen()
    assert fit_mount(scans, [None] * len(scans)) is None
    assert fit_mount(scans, [np.zeros(3)] * len(scans)) is None
    assert fit_mount([None] * len(scans), wheels) is None
    assert fit_mount(scans[:20], wheels[:20]) is None  # three metres ahead and no turn


@pytest.mark.parametrize("rolled", [True, False])
def test_a_log_of_a_laser_upside_down_says_so_and_what_to_type(tmp_path, rolled):
    scans, wheels = seen()
    lines, at = [], np.concatenate([WAY[:1], WAY[1:]])
    for k, (scan, pose) in enumerate(zip(scans, at, strict=True)):
        ranges = " ".join(f"{r:.3f}" for r in (scan.ranges_m[::-1] if rolled else scan.ranges_m))
        pose_words = " ".join(f"{v:.6f}" for v in pose)
        lines.append(f"FLASER 181 {ranges} {pose_words} {pose_words} {0.2 * k:.2f} host {0.2 * k:.2f}\n")
    (tmp_path / "room.log").write_text("".join(lines))
    words = ["source=replay", f"source.path={tmp_path / 'room.log'}", "sensor=laser", "pictures=off"]
    save_map(tmp_path / "empty", OccupancyGrid(np.zeros((40, 40), np.float32), 0.5, (-10.0, -10.0)))
    found = rhs.run([*words, "task=localise", f"map={tmp_path / 'empty.yaml'}", "localiser=odometry_only", "start=[0,0,0]",
                     "odometry=wheel", f"output={tmp_path / 'localised'}"], quiet=True)
    row = rhs.run([*words, f"output={tmp_path / 'run'}"], quiet=True)
    assert found["mount_heading_off_deg"] == 0.0  # it believes in the wheels
    assert found["mount_roll_off_deg"] == 180.0 * rolled and (found["success"] == 0.0) == rolled  # no truth: else unknown
    assert ("mounted upside down" in found["failure"]) == rolled
    assert row["mount_roll_off_deg"] == 180.0 * rolled and row["mount_yaw_off_deg"] == 0.0
    if rolled:
        assert row["success"] == 0.0 and "the laser is mounted upside down" in row["failure"]
        assert "type source.scan_mount=[0,0,0,180,0,0]" in row["failure"]
        mended = rhs.run([*words, "source.scan_mount=[0,0,0,180,0,0]", f"output={tmp_path / 'mended'}"], quiet=True)
        assert mended["mount_roll_off_deg"] == 0.0 and mended["success"] == 1.0
    else:
        assert row["success"] == 1.0
