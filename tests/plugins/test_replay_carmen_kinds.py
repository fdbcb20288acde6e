"""CARMEN logs of other programs and other lasers: what their beams cover, poses in whole numbers, other endings."""

from __future__ import annotations

import logging

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

STANDING = "0 0 0 0 0 0 0 0 1 1 0 1.0 a 1.0"  # what follows the ranges of a robot that stands


def opened(path, lines, **settings):
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [capture for capture, _ in open_recording(Replay(path=str(path), **settings)).views]


def flaser(beams, k=0, word="FLASER"):
    return f"{word} {beams} {' '.join(['2.5'] * beams)} {k} 0 0 {k} 0 0 {10 + k}.0 host {10 + k}.0"


def robotlaser(beams, head, tail):
    return f"ROBOTLASER1 0 {head} 80 0.01 0 {beams} {' '.join(['2.5'] * beams)} {tail}"


@pytest.mark.parametrize(("beams", "step_deg", "half_deg", "said"), [
    (541, 0.5, 135.0, "to cover 270 degrees, as the log says 0.5 a beam"),
    (1081, 0.25, 135.0, "to cover 270 degrees, as the log says 0.25 a beam"),
    (361, 0.5, 90.0, ""), (180, 1.0, 89.5, ""),
    (181, 0.5, 90.0, "to cover 180 degrees, though the log says 0.5 a beam"),  # the setting of another laser, left in
    (1081, 0.5, 90.0, "to cover 180 degrees, though the log says 0.5 a beam"),  # would be a turn and a half
])
def test_the_resolution_in_a_logs_parameters_says_what_its_beams_cover(tmp_path, caplog, beams, step_deg, half_deg, said):
    with caplog.at_level(logging.WARNING, "rhs.replay"):
        first, *_ = opened(tmp_path / "a.log", [f"PARAM laser_front_laser_resolution {step_deg} nohost 0", flaser(beams)])
    assert np.degrees(first.scan.bearings_rad[[0, -1]]) == pytest.approx([-half_deg, half_deg])
    assert said in caplog.text and bool(caplog.text) == bool(said)


@pytest.mark.parametrize("value", ["", "nohost 0", "nan nohost 0", "-1 nohost 0"])
def test_a_parameter_without_a_number_says_nothing(tmp_path, caplog, value):
    with caplog.at_level(logging.WARNING, "rhs.replay"):
        first, *_ = opened(tmp_path / "a.log", [f"PARAM laser_front_laser_resolution {value}", flaser(541)])
    assert np.degrees(first.scan.bearings_rad[0]) == pytest.approx(-90.0) and "to cover 180 degrees" in caplog.text


@pytest.mark.parametrize(("beams", "half_deg"), [(401, 50.0), (400, 49.875)])
def test_a_sick_in_steps_of_a_quarter_of_a_degree_sees_100_degrees(tmp_path, caplog, beams, half_deg):
    with caplog.at_level(logging.WARNING, "rhs.replay"):
        first, *_ = opened(tmp_path / "a.log", [flaser(beams)])
    assert np.degrees(first.scan.bearings_rad[[0, -1]]) == pytest.approx([-half_deg, half_deg])
    assert f"its {beams} beams are taken to cover 100 degrees, as the log does not say" in caplog.text


def test_a_field_of_view_that_is_typed_wins_over_the_logs_parameters(tmp_path):
    lines = ["PARAM laser_front_laser_resolution 0.5 nohost 0", flaser(541)]
    first, *_ = opened(tmp_path / "a.log", lines, laser_fov_deg=240.0)
    assert np.degrees(first.scan.bearings_rad[0]) == pytest.approx(-120.0)


@pytest.mark.parametrize("tail", ["3 0 0 3 0 0 0 0 1 1 {} host {}", "3 0 0 3 0 0 0 0 1 1 0 {} host {}",
                                  "2 7 9 3 0 0 3 0 0 0 0 1 1 0 {} host {}", "0 3 0 0 3 0 0 0 0 1 1 0 {} host {}"])
def test_a_pose_in_whole_numbers_is_no_number_of_remissions(tmp_path, tail):
    head = "-1.5708 3.14159 1.5708"
    lines = [robotlaser(3, head, tail.format(k, k).replace("3 0 0", f"{k} 0 0")) for k in (1, 2, 3)]
    _, second, third = opened(tmp_path / "a.log", lines)
    np.testing.assert_allclose([second.travel, third.travel], [[1.0, 0.0, 0.0]] * 2, atol=1e-9)


def test_beams_whose_step_contradicts_their_field_of_view_lie_in_it(tmp_path):
    """361 beams from -90 degrees over 180, said to be a degree apart: they do not go round to behind the robot."""
    first, *_ = opened(tmp_path / "a.log", [robotlaser(361, "-1.570796 3.141593 0.017453", STANDING)])
    assert np.degrees(first.scan.bearings_rad[[0, -1]]) == pytest.approx([-90.0, 90.0], abs=1e-3)
    right, *_ = opened(tmp_path / "b.log", [robotlaser(181, "-3.141593 3.141593 0.017453", STANDING)])
    assert np.degrees(right.scan.bearings_rad[[0, -1]]) == pytest.approx([-180.0, 0.0], abs=0.01)


@pytest.mark.parametrize("name", ["intel.txt", "intel.script", "intel"])
def test_a_log_is_known_by_its_lines_whatever_it_is_called(tmp_path, name):
    assert len(opened(tmp_path / name, ["# CARMEN Logfile", flaser(180), flaser(180, 1)])) == 2


@pytest.mark.parametrize(("line", "said"), [
    (flaser(180, word="RLASER"), "sed s/^RLASER/FLASER/"),
    ("LASER_READING 3 1 2 3 0 0 0 1.0", "GMapping's own log"),
])
def test_a_log_of_other_lines_says_what_to_do(tmp_path, line, said):
    with pytest.raises(ConfigError) as caught:
        opened(tmp_path / "a.log", [line])
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_a_folder_of_laser_logs_names_the_first(tmp_path):
    (tmp_path / "intel.log").write_text(flaser(180) + "\n")
    with pytest.raises(ConfigError, match=r"found 1 laser log; type source\.path=.*intel\.log"):
        open_recording(Replay(path=str(tmp_path)))


@pytest.mark.parametrize(("laser_m", "said"), [(0.0, True), (0.35, False)])
def test_a_laser_whose_place_the_log_says_and_its_poses_leave_out_is_said(tmp_path, caplog, laser_m, said):
    lines = [flaser(180, k).replace(f" {k} 0 0 {k} 0 0", f" {k + laser_m} 0 0 {k} 0 0") for k in range(2)]
    with caplog.at_level(logging.WARNING, "rhs.replay"):
        opened(tmp_path / "a.log", ["PARAM robot_frontlaser_offset 0.35 nohost 0", *lines])
    assert ("type source.scan_mount=[0.35,0,0,0,0,0]" in caplog.text) == said
