"""One camera without depth on recordings: refused where its height is not known, run where it is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import rhs
from rhs.config.compose import compose_config


def words(folder, *more):
    return ["task=survey", "source=replay", f"source.path={folder}", "source.camera=[50,50,31.5,23.5]", "sensor=mono",
            f"output={folder.parent / 'run'}", "pictures=off", *more]


@pytest.fixture
def colour_alone(tmp_path):
    folder = tmp_path / "rgb_only"
    folder.mkdir()
    texture = np.random.default_rng(0).integers(0, 255, (12, 16, 3)).astype(np.uint8)
    for k in range(3):
        cv2.imwrite(str(folder / f"{k:04d}.png"), np.roll(cv2.resize(texture, (64, 48)), k, axis=1))
    return folder


def test_the_stack_of_one_camera_leads_a_simulator_and_leaves_a_recording_alone():
    led = compose_config(["sensor=mono"]).source.settings
    assert (led.step_m, led.turn, led.turn_step_deg) == (0.125, "arc", 6.5)
    assert compose_config(["sensor=mono"]).odometry.name == "ground_msckf"
    assert compose_config(["sensor=mono", "source=replay", "source.path=x"]).odometry.name == "monocular_vo"


def test_a_camera_held_in_a_hand_is_refused_with_what_to_type(colour_alone):
    with pytest.raises(rhs.RhsError, match=r"how high this one is; type source.camera_mount=\[0,0,HEIGHT_M") as error:
        rhs.run(words(colour_alone, "odometry=corridor_ekf"), quiet=True)
    assert "\n" not in str(error.value)


def test_a_folder_of_colour_alone_runs_when_the_camera_sits_on_a_robot(colour_alone):
    row = rhs.run(words(colour_alone, "source.camera_mount=[0,0,0.8,0,0,0]", "odometry=corridor_ekf",
                        "odometry.motion=none"), quiet=True)
    assert row["status"] == "ok" and row["views"] == 3 and row["scale_from"] == "camera height"
    with pytest.raises(rhs.RhsError, match="needs depth, which source=replay does not provide"):
        rhs.run([*words(colour_alone)[:4], "sensor=rgbd"], quiet=True)


def test_what_a_camera_log_threw_away_stands_in_columns_of_the_row(tmp_path):
    """Six colour stamps, one of them backward, one without depth and, in both, one after a break of two minutes; of the
    true poses one is unknown, one backward, one after the break."""
    folder = tmp_path / "log"
    for name, stamps in (("rgb", [0.0, 0.1, 0.05, 0.2, 0.3, 120.0]), ("depth", [0.0, 0.1, 0.2, 120.0])):
        (folder / name).mkdir(parents=True)
        lines = []
        for k, stamp in enumerate(stamps):
            image = np.full((48, 64, 3), 40 + k, np.uint8) if name == "rgb" else np.full((48, 64), 10000, np.uint16)
            cv2.imwrite(str(folder / name / f"{k}.png"), image)
            lines.append(f"{stamp} {name}/{k}.png\n")
        (folder / f"{name}.txt").write_text("".join(lines))
    poses = [f"{s} {s} 0 0 0 0 0 1\n" for s in (0.0, 0.1, 0.05, 0.2, 0.3, 120.0)]
    (folder / "groundtruth.txt").write_text("".join(poses) + "0.4 nan 0 0 0 0 0 1\n")
    row = rhs.run(["task=survey", "source=replay", f"source.path={folder}", "source.camera=[50,50,31.5,23.5]",
                   "pictures=off", f"output={tmp_path / 'run'}", "odometry=gicp", "loop_closer=none"], quiet=True)
    assert {name: row[name] for name in ("views", "stamps_rejected", "views_unpaired", "truth_rejected", "stamps_jumped",
                                         "stamps_repaired")} == {
        "views": 4, "stamps_rejected": 1, "views_unpaired": 1, "truth_rejected": 2, "stamps_jumped": 1, "stamps_repaired": 0}
