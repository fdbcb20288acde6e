"""A SLAM in the place of four parts, and modalities that rhs has never heard of, through loop, recording and replay."""

import json
from pathlib import Path

import numpy as np
import pytest
from installing import CHOICE, FAKES, installed

import rhs
from rhs.api.metric import Metric
from rhs.base.errors import ConfigError
from rhs.cli.main import main
from rhs.config import registry
from rhs.config.compose import compose_config
from rhs.recording.reader import read

BROKEN = (Metric("broken_m", "m", "fails always", "nowhere", lambda run: 1.0 / 0.0, tasks=("survey",)),)
OTHERS = [word for word in CHOICE if word.split("=")[0] not in ("odometry", "loop_closer", "mapper", "localiser")]


@pytest.fixture(autouse=True)
def fakes():
    with installed(FAKES):
        yield


def test_a_slam_maps_and_patrols_in_the_place_of_four_parts(tmp_path):
    row = rhs.run([*OTHERS, "slam=fake", f"output={tmp_path / 'run'}"], quiet=True)
    assert (row["status"], row["slam"], row["places_visited"]) == ("ok", "fake", 2)
    assert "odometry" not in row and row["ate_rmse_m"] < 0.01
    config = (tmp_path / "run" / "config.yaml").read_text()
    assert "localiser:" not in config


def test_a_slam_and_a_part_it_replaces_are_refused_together():
    with pytest.raises(ConfigError, match="slam=fake brings its own .* leave out odometry="):
        compose_config([*OTHERS, "slam=fake", "odometry=fake"])


def test_an_odometry_gets_the_modality_it_needs_and_is_refused_without(tmp_path):
    words = [word for word in CHOICE if not word.startswith(("source", "odometry"))]
    with pytest.raises(ConfigError, match="odometry=fake_inertial needs imu, which source=fake does not provide; type .*"
                                          "source=fake_imu"):
        compose_config([*words, "source=fake", "odometry=fake_inertial"])
    run = tmp_path / "run"
    row = rhs.run([*words, "source=fake_imu", "odometry=fake_inertial", "task=survey", f"output={run}"], quiet=True)
    assert row["status"] == "ok"
    views = list(read(run / "run.mcap").views())
    assert [view.capture.extras["imu"].shape for view in views] == [(5, 7)] * len(views)
    assert views[2].capture.extras["imu"][-1, 0] == views[2].capture.stamp_s


def test_extra_modalities_are_recorded_bit_for_bit_whatever_their_type(tmp_path):
    from dataclasses import replace

    from helpers.synthetic_run import CAMERA, FACTS, make_steps

    from rhs.recording.writer import Recorder

    extras = {"right_image": np.arange(24, dtype=np.uint8).reshape(2, 4, 3), "temperature_k": np.array(293.15),
              "labels": np.array([[1, -2]], dtype=">i8")}
    recorder = Recorder(tmp_path / "a.mcap", "full", CAMERA, FACTS)
    for step in make_steps(2):
        recorder.step(replace(step, observation=replace(step.observation, extras=extras)))
    recorder.close()
    for view in read(tmp_path / "a.mcap").views():
        assert set(view.capture.extras) == set(extras)
        for name, array in extras.items():
            found = view.capture.extras[name]
            assert found.dtype == array.dtype and found.shape == array.shape and np.array_equal(found, array)


@pytest.fixture
def broken(fakes, monkeypatch):
    """For this test only: a metric stands in every row of the process."""
    monkeypatch.setattr(registry, "_by_hand", {})
    rhs.register("metric", "broken", BROKEN)


def test_a_strangers_metric_stands_in_the_row_and_a_broken_one_costs_only_itself(tmp_path, broken):
    row = rhs.run([*CHOICE, "task=survey", f"output={tmp_path / 'run'}"], quiet=True)
    assert row["views_seen"] == 6 and row["status"] == "ok"
    assert np.isnan(row["broken_m"]) and "broken_m: ZeroDivisionError" in row["metric_failures"]
    assert json.loads((tmp_path / "run" / "row.json").read_text())["broken_m"] is None


def test_a_broken_metric_is_said_at_the_end_of_a_run_with_its_line(tmp_path, capsys, broken):
    assert main([*CHOICE, "task=survey", f"output={tmp_path / 'run'}"]) == 3
    said = capsys.readouterr().err
    assert f"broken_m: ZeroDivisionError: float division by zero ({Path(__file__).name}:" in said
