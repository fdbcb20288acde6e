"""Recordings between forms; recovery of a cut one."""

import hashlib
import json

import numpy as np
import pytest
from helpers.synthetic_run import FACTS, make_steps

from rhs.api.errors import ConfigError
from rhs.api.geometry import camera_from_fov
from rhs.api.trajectory import read_tum
from rhs.cli.convert import convert, main
from rhs.recording.reader import read, read_head
from rhs.recording.writer import Recorder

CAMERA = camera_from_fov(96, 72, 60.0, height_m=1.0)  # large enough for several chunks


@pytest.fixture
def run(tmp_path):
    recorder = Recorder(tmp_path / "run.mcap", "full", CAMERA, FACTS)
    for step in make_steps(30, camera=CAMERA):
        recorder.step(step)
    recorder.close()
    return tmp_path / "run.mcap"


def cut(path, share=0.6):
    short = path.with_name("cut.mcap")
    short.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    return short


def payloads(path):
    return [(m.channel.topic, m.channel.schema.name, m.log_ns, m.data) for m in read(path)]


def test_recovery_opens_everywhere_and_holds_what_it_says(run, tmp_path, capsys):
    from mcap.reader import make_reader
    from rosbags.highlevel import AnyReader

    short, whole = cut(run), tmp_path / "whole.mcap"
    with pytest.raises(Exception), short.open("rb") as file:  # noqa: B017
        list(make_reader(file).iter_messages())
    before = hashlib.sha256(short.read_bytes()).hexdigest()
    assert main([str(short), str(whole)]) == 3
    out, err = capsys.readouterr()
    count = int(out.split(":")[1].split()[0])
    assert "the file " in err and len(err.splitlines()) == 1
    with whole.open("rb") as file:
        assert len(list(make_reader(file, validate_crcs=True).iter_messages())) == count > 100
    with AnyReader([whole]) as bag:
        assert bag.message_count == count
    assert payloads(whole) == payloads(run)[:count]
    assert read_head(whole).facts == FACTS
    assert "the file " in _notes(whole)["rhs.recovered"]["what"]
    assert hashlib.sha256(short.read_bytes()).hexdigest() == before


def _notes(path):
    reading = read(path)
    list(reading)
    return reading.notes


def test_recovering_a_whole_file_changes_nothing_in_it(run, tmp_path):
    _, report = convert(run, tmp_path / "copy.mcap")
    assert report is not None and report.whole
    assert payloads(tmp_path / "copy.mcap") == payloads(run)


def test_the_output_is_never_the_input(run, tmp_path, capsys):
    before = run.read_bytes()
    (tmp_path / "link.mcap").symlink_to(run)
    (tmp_path / "hard.mcap").hardlink_to(run)
    for same in (run, tmp_path / "link.mcap", tmp_path / "hard.mcap", tmp_path / "." / "run.mcap"):
        assert main([str(run), str(same), "--force"]) == 2
        assert "is the input itself" in capsys.readouterr().err
    assert run.read_bytes() == before


def test_an_existing_output_is_kept_unless_told(run, tmp_path, capsys):
    (tmp_path / "there.mcap").write_text("precious")
    assert main([str(run), str(tmp_path / "there.mcap")]) == 2
    assert (tmp_path / "there.mcap").read_text() == "precious" and "--force" in capsys.readouterr().err
    assert main([str(run), str(tmp_path / "there.mcap"), "--force"]) == 0


def test_an_unreadable_input_leaves_no_output(tmp_path, capsys):
    (tmp_path / "a.mcap").write_bytes(b"")
    assert main([str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap")]) == 1
    assert main([str(tmp_path / "none.mcap"), str(tmp_path / "b.mcap")]) == 2
    assert [p.name for p in tmp_path.iterdir()] == ["a.mcap"]
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_a_tum_folder_and_back(run, tmp_path):
    """Colour exact, depth to 0.1 mm, stamps to a nanosecond, truth through the camera's place on the body and back."""
    folder, again = tmp_path / "tum", tmp_path / "again.mcap"
    convert(run, folder)
    assert len((folder / "rgb.txt").read_text().splitlines()) == 30
    camera = json.loads((folder / "camera.json").read_text())
    convert(folder, again, settings=[f"camera=[{camera['fx']},{camera['fy']},{camera['cx']},{camera['cy']}]"])
    first, second = list(read(run).views()), list(read(again).views())
    assert len(second) == 30
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(b.capture.image, a.capture.image)
        np.testing.assert_allclose(b.capture.depth, a.capture.depth, atol=1.01e-4)
        assert b.capture.stamp_s == pytest.approx(a.capture.stamp_s, abs=1e-9) and b.truth is not None
    camera_height = np.array([0, 0, CAMERA.height_m])
    moved = first[-1].truth[:3, 3] + camera_height - (second[-1].truth @ read_head(again).camera.body_from_camera)[:3, 3]
    np.testing.assert_allclose(moved, 0, atol=1e-6)


def test_a_trajectory_and_back(run, tmp_path):
    convert(run, tmp_path / "belief.tum")
    convert(run, tmp_path / "truth.tum", topic="/truth")
    truth = read_tum(tmp_path / "truth.tum")
    np.testing.assert_allclose(truth.poses[-1], list(make_steps(30))[-1].truth, atol=1e-8)
    convert(tmp_path / "truth.tum", tmp_path / "truth.mcap")
    convert(tmp_path / "truth.mcap", tmp_path / "again.tum")
    assert (tmp_path / "again.tum").read_text() == (tmp_path / "truth.tum").read_text()


def test_a_topic_without_poses_names_those_with(run, tmp_path):
    with pytest.raises(ConfigError, match="/belief, /odom, /truth"):
        convert(run, tmp_path / "a.tum", topic="/camera/depth")


def test_a_pair_that_makes_no_sense(tmp_path):
    (tmp_path / "a.xyz").write_text("x")
    with pytest.raises(ConfigError, match="--help"):
        convert(tmp_path / "a.xyz", tmp_path / "b.xyz")


def test_real_recording(real_data, tmp_path):
    """TUM freiburg1_rpy: 60 pairs become a recording whose views are those of the folder."""
    folder = real_data("rgbd/tum_fr1_rpy_60")
    convert(folder, tmp_path / "fr1.mcap", settings=["camera=tum_fr1", "count=10"])
    views = list(read(tmp_path / "fr1.mcap").views())
    assert len(views) == 10 and views[0].capture.image.shape == (480, 640, 3)
    assert 1.3e9 < views[0].capture.stamp_s < 1.4e9 and views[3].truth is not None
