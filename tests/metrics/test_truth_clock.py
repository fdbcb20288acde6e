"""The truth by another clock: found from how a body turns and goes, said where it is the error, never of a bad estimate."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import exp_se3, se2
from rhs.api.trajectory import Trajectory, write_tum
from rhs.cli.evaluate import main
from rhs.metrics.survey import trajectory_values
from rhs.metrics.truth_clock import truth_offset


def walk(seed: int, stamps: np.ndarray) -> Trajectory:
    """A robot that drives at 0.2 to 0.8 m/s and turns at up to 0.7 rad/s, smoothly, the same at any rate of stamps."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, 60.0, 0.01)
    waves = rng.uniform(0.05, 0.4, (2, 4)), rng.uniform(0.0, 7.0, (2, 4))
    speed, turn = np.sin(2.0 * np.pi * waves[0][..., None] * fine + waves[1][..., None]).mean(axis=1)
    yaw = np.cumsum(1.4 * turn) * 0.01
    x, y = (np.cumsum((0.5 + 0.6 * speed) * way(yaw)) * 0.01 for way in (np.cos, np.sin))
    return Trajectory(stamps, np.array([se2(*pose) for pose in zip(*(np.interp(stamps, fine, v) for v in (x, y, yaw)),
                                                                     strict=True)]))


def estimated(truth: Trajectory, seed: int, noise: float = 0.0005, scale: float = 1.0, drift: float = 0.0) -> Trajectory:
    """The truth as an odometry sums it up: noise (m, rad a view), metres too long, a heading that drifts (rad a view)."""
    rng, poses = np.random.default_rng([seed, 1]), [np.eye(4)]
    off = np.array([0.0, 0.0, 0.0, 0.0, 0.0, drift])
    for a, b in zip(truth.poses[:-1], truth.poses[1:], strict=True):
        step = np.linalg.inv(a) @ b
        step[:3, 3] *= scale
        poses.append(poses[-1] @ step @ exp_se3(noise * rng.standard_normal(6) * [1, 1, 0, 0, 0, 1] + off))
    return Trajectory(truth.stamps_s, np.array(poses))


@pytest.mark.parametrize("offset_s", [-2.0, -0.5, -0.2, 0.2, 0.7, 2.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_offset_is_found_to_a_twentieth_of_a_second(seed, offset_s):
    estimate, truth = estimated(walk(seed, np.arange(0.0, 50.0, 0.1)), seed), walk(seed, np.arange(0.0, 59.0, 0.02))
    found_s, there_m = truth_offset(estimate, Trajectory(truth.stamps_s + offset_s, truth.poses), "se3")
    assert found_s == pytest.approx(offset_s, abs=0.05) and there_m < 0.2


@pytest.mark.parametrize("wrong", [{}, {"noise": 0.02}, {"scale": 1.2}, {"drift": 0.01}, {"noise": 0.05, "drift": -0.02}])
@pytest.mark.parametrize("seed", range(4))
def test_a_bad_estimate_by_the_same_clock_has_no_offset(seed, wrong):
    stamps = np.arange(0.0, 50.0, 0.1)
    truth = walk(seed, stamps)
    assert truth_offset(estimated(truth, seed, **wrong), truth, "se3")[0] == 0.0


def test_an_estimate_that_stood_still_for_a_while_has_no_offset():
    """It lost two seconds of way: behind them it is late along the path, but turns when the truth turns."""
    truth = walk(5, np.arange(0.0, 50.0, 0.1))
    poses = truth.poses.copy()
    poses[200:220] = poses[200]
    poses[220:] = poses[200] @ np.linalg.inv(truth.poses[220]) @ truth.poses[220:]
    assert truth_offset(Trajectory(truth.stamps_s, poses), truth, "se3")[0] == 0.0


def test_what_never_changes_pace_or_is_too_short_tells_nothing():
    poses = np.array([se2(np.cos(0.02 * k), np.sin(0.02 * k), 0.02 * k) for k in range(300)])
    circle = Trajectory(0.1 * np.arange(300), poses)
    offset_s, _ = truth_offset(circle, Trajectory(circle.stamps_s + 1.0, circle.poses), "se3")
    assert np.isnan(offset_s) or offset_s == 0.0
    assert np.isnan(truth_offset(circle.take(np.arange(5)), circle, "se3")[0])


def test_the_figures_stay_and_the_command_says_what_to_do(tmp_path, capsys):
    truth = walk(1, np.arange(0.0, 50.0, 0.1))
    late = Trajectory(truth.stamps_s + 0.5, truth.poses)
    estimate = estimated(truth, 1)
    figures = trajectory_values(estimate, late)
    assert figures["truth_offset_s"] == pytest.approx(0.5, abs=0.02)
    assert figures["ate_at_offset_m"] < 0.5 * figures["ate_rmse_m"]
    for name, way in (("estimate", estimate), ("late", late), ("truth", truth)):
        write_tum(tmp_path / name, way)
    assert main([str(tmp_path / "estimate"), str(tmp_path / "late")]) == 3
    out, err = capsys.readouterr()
    assert f"{'ate_rmse_m':<33}{figures['ate_rmse_m']:.6g}" in out
    assert "0.50 s late" in err and "subtract that from the stamps of the truth" in err and len(err.splitlines()) == 1
    assert main([str(tmp_path / "estimate"), str(tmp_path / "truth")]) == 0 and not capsys.readouterr().err
