"""Recordings by rhs replayed: bit for bit, also when they were cut."""

import dataclasses

import numpy as np
import pytest
from helpers.replayed import views
from helpers.synthetic_run import FACTS, make_steps

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov
from rhs.recording.writer import Recorder

CAMERA = camera_from_fov(96, 72, 60.0, height_m=1.0)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "run.mcap"
    recorder = Recorder(path, "full", CAMERA, FACTS)
    for step in [*make_steps(30, camera=CAMERA), *make_steps(5, camera=CAMERA, phase="patrol", first=30)]:
        recorder.step(step)
    recorder.close()
    return path


def test_a_recorded_survey_is_handed_out_again_exactly(run):
    source, captures = views(run)
    assert len(captures) == 30 and source.lost == ""
    for step, (capture, truth) in zip(make_steps(30, camera=CAMERA), captures, strict=True):
        np.testing.assert_array_equal(capture.image, step.observation.image)
        np.testing.assert_array_equal(capture.depth, step.observation.depth)
        np.testing.assert_array_equal(truth, step.truth)
        assert capture.stamp_s == step.stamp_s
    assert source.facts.start == FACTS.start and source.facts.places == ()
    np.testing.assert_array_equal(source.camera.body_from_camera, CAMERA.body_from_camera)


def test_a_recording_of_a_way_that_nobody_bounded_is_one_when_it_is_replayed(tmp_path):
    for known in (True, False):
        recorder = Recorder(tmp_path / f"{known}.mcap", "full", CAMERA, dataclasses.replace(FACTS, bounds_known=known))
        recorder.step(next(make_steps(1, camera=CAMERA)))
        recorder.close()
        assert views(tmp_path / f"{known}.mcap")[0].facts.bounds_known is known


def test_phases_and_thinning(run):
    assert len(views(run, phase="patrol")[1]) == 5
    assert len(views(run, phase="all")[1]) == 35
    _, thinned = views(run, start=2, stride=3, count=4)
    assert [capture.index for capture, _ in thinned] == [2, 5, 8, 11]


def test_a_cut_recording_says_what_it_lost(run, tmp_path):
    (tmp_path / "cut.mcap").write_bytes(run.read_bytes()[: run.stat().st_size // 2])
    source, captures = views(tmp_path / "cut.mcap")
    assert 5 < len(captures) < 30
    assert "the file " in source.lost and str(tmp_path) not in source.lost


def test_what_cannot_be_replayed(run, tmp_path):
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(ConfigError, match="not an MCAP file"):
        views(tmp_path / "empty.mcap")
    recorder = Recorder(tmp_path / "light.mcap", "light", CAMERA, FACTS)
    recorder.step(next(make_steps(1)))
    recorder.close()
    with pytest.raises(ConfigError, match="recording=full"):
        views(tmp_path / "light.mcap")
    (tmp_path / "stub.mcap").write_bytes(run.read_bytes()[:3000])
    with pytest.raises(ConfigError, match="no complete view"):
        views(tmp_path / "stub.mcap")


def test_the_folder_of_a_run_is_its_recording(run, tmp_path):
    (tmp_path / "run.mcap").write_bytes(run.read_bytes())
    (folder, _), (file, _) = views(tmp_path), views(run)
    assert folder.facts == file.facts and file.facts.name == FACTS.name
