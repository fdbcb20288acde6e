"""Which sensor a recording is given where nobody types one."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from bags import BagFile

import rhs
from rhs.config.compose import compose_config
from rhs_sources import replay_sensor

GOLDEN = Path(__file__).parents[1] / "golden"
P = "50 0 31.5 {} 0 50 23.5 0 0 0 1 0"


def images(folder, count=2):
    folder.mkdir(parents=True)
    for k in range(count):
        cv2.imwrite(str(folder / f"{k:06d}.png"), np.full((48, 64, 3), 10 + k, np.uint8))


def kitti(folder, sides):
    for side in sides:
        images(folder / f"image_{side}")
    calib = [f"P{k}: {P.format(0 if k % 2 == 0 else -25)}" for k in range(4)]
    (folder / "calib.txt").write_text("\n".join(calib) + "\n")
    (folder / "times.txt").write_text("0.0\n0.1\n")
    return folder


def bag(folder, *, scan, colour):
    folder.mkdir()
    with BagFile(folder, "ros2_mcap") as made:
        for k in range(2):
            if scan:
                made.scan("/scan", 1.0 + k, np.full(5, 2.0, np.float32))
            if colour:
                made.image("/camera/image", 1.0 + k, np.zeros((48, 64, 3), np.uint8), "rgb8")
                made.camera_info("/camera/camera_info", 1.0 + k)
    return made.path


def chosen(path, *words):
    config = compose_config(["source=replay", f"source.path={path}", *words])
    return config.sensor.name, config.odometry.name


def test_a_laser_log_is_a_lasers_and_what_was_typed_wins(tmp_path):
    assert chosen(GOLDEN / "laser.clf") == ("laser", "scan_to_map")
    assert chosen(GOLDEN / "laser.clf", "odometry=wheel") == ("laser", "wheel")
    with pytest.raises(rhs.RhsError, match="sensor=rgbd needs depth, which .* type sensor=laser"):
        rhs.run(["source=replay", f"source.path={GOLDEN / 'laser.clf'}", "sensor=rgbd", f"output={tmp_path / 'run'}"])


def test_a_localiser_in_a_given_map_reads_a_laser_log_without_further_words(tmp_path):
    words = ["task=localise", "localiser=particle_filter_scan", "world=building.yaml", "start=unknown"]
    assert chosen(GOLDEN / "laser.clf", *words) == ("laser", "scan_to_map")


def test_clouds_are_a_lidars_images_alone_one_cameras_and_two_cameras_stereo(tmp_path):
    shutil.copytree(GOLDEN / "clouds", tmp_path / "clouds")
    images(tmp_path / "rgb")
    assert chosen(tmp_path / "clouds") == ("lidar", "vgicp_lidar")
    assert chosen(tmp_path / "rgb", "source.camera=[50,50,31.5,23.5]") == ("mono", "monocular_vo")
    assert chosen(kitti(tmp_path / "one", (2,))) == ("mono", "monocular_vo")
    assert chosen(kitti(tmp_path / "two", (2, 3)))[0] == "stereo"


def test_a_bag_with_a_laser_and_no_depth_is_a_lasers(tmp_path):
    assert chosen(bag(tmp_path / "scan", scan=True, colour=False))[0] == "laser"
    assert chosen(bag(tmp_path / "both", scan=True, colour=True))[0] == "laser"
    one_eye = bag(tmp_path / "colour", scan=False, colour=True)
    assert chosen(one_eye, "source.depth_topic=none")[0] == "mono"


def test_the_jobs_of_a_sweep_open_a_recording_once(tmp_path, monkeypatch):
    folder, opened = kitti(tmp_path / "two", (2, 3)), []
    whole = replay_sensor.open_recording
    monkeypatch.setattr(replay_sensor, "open_recording", lambda settings: opened.append(1) or whole(settings))
    assert [chosen(folder, f"seed={seed}")[0] for seed in range(3)] == 3 * ["stereo"] and len(opened) == 1


def test_a_recording_that_cannot_be_read_is_left_to_be_refused_when_it_is(tmp_path):
    (tmp_path / "empty").mkdir()
    for path in (tmp_path / "empty", tmp_path / "missing"):
        assert chosen(path)[0] == "rgbd"


def test_a_run_that_is_refused_leaves_no_relations_behind(tmp_path):
    """`loc` could be typed again once the word that was missing is there."""
    log = shutil.copy(GOLDEN / "laser.clf", tmp_path / "log.clf")
    (tmp_path / "log.relations").write_text("1.0 2.0 0.1 0 0 0 0 0\n")
    words = ["task=survey", "source=replay", f"source.path={log}", f"output={tmp_path / 'loc'}"]
    with pytest.raises(rhs.RhsError, match="sensor=rgbd needs depth"):
        rhs.run([*words, "sensor=rgbd"], quiet=True)
    assert not (tmp_path / "loc" / "truth.relations").exists()
    assert rhs.run([*words, "odometry=wheel", "loop_closer=none"], quiet=True)["status"] == "ok"
    assert (tmp_path / "loc" / "truth.relations").exists()
