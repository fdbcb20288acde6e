"""Times and poses beside numbered images, in the plain forms that people write them in."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import exp_so3, quaternion_xyzw, se3
from rhs.base.errors import RecordingError
from rhs.metrics.trajectory_forms import read_trajectory
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

WAY = [se3(exp_so3(np.array([0.1 * k, 0.2, -0.05 * k])), np.array([0.1 * k, 1.0, 0.3])) for k in range(8)]
CAMERA = [50.0, 50.0, 31.5, 23.5]


def images(folder, count=5, first=0):
    (folder / "rgb").mkdir(exist_ok=True)
    for k in range(count):
        cv2.imwrite(str(folder / "rgb" / f"{first + k:05d}.png"), np.full((48, 64, 3), 40 + k, np.uint8))
    return folder


def views(folder, **settings):
    recording = open_recording(Replay(path=str(folder), camera=CAMERA, **settings))
    return list(recording.views), recording.timed


def at(folder, **settings):
    seen, timed = views(folder, **settings)
    return [capture.stamp_s for capture, _ in seen], timed


SECONDS = [7.0, 7.1, 7.2, 7.35, 7.4]


@pytest.mark.parametrize(("name", "head"), [("timestamps.txt", "# seconds"), ("times.txt", "time [s]"),
                                            ("timestamps.csv", "frame,timestamp")])
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("line", ["{s}", "{n} {s}", "{n},{s}", "{s:e}"])
def test_a_time_a_line_is_when_the_views_were_taken(tmp_path, name, head, first, line):
    rows = (line.format(n=first + k, s=second) for k, second in enumerate(SECONDS))
    (images(tmp_path, first=first) / name).write_text(f"{head}\n" + "\n".join(rows) + "\n")
    stamps, timed = at(tmp_path)
    assert stamps == pytest.approx(SECONDS) and timed
    assert at(tmp_path, rate_hz=5.0)[0] == pytest.approx([0.2 * k for k in range(5)])  # what is typed wins


def test_true_poses_by_stamps_are_those_of_when_the_views_were_taken(tmp_path):
    """Twice as many poses as views, at 20 a second: at the 30 views a second of images without times they were of others."""
    (images(tmp_path, count=4) / "times.txt").write_text("".join(f"{0.1 * k}\n" for k in range(4)))
    (tmp_path / "groundtruth.txt").write_text("".join(
        f"{0.05 * k:.2f} {' '.join(f'{v:.9f}' for v in (*pose[:3, 3], *quaternion_xyzw(pose[:3, :3])))}\n"
        for k, pose in enumerate(WAY)))
    seen, _ = views(tmp_path)
    for k, (capture, true) in enumerate(seen):
        assert (capture.index, true[0, 3]) == (k, pytest.approx(0.2 * k, abs=1e-6))


@pytest.mark.parametrize(("text", "said"), [
    ("7.0\n7.1\n7.2\n", r"3 lines but the last view is number 4; expected one of each view; type source\.rate_hz="),
    ("0\n33\n66\n99\n132\n", r"its times are 33 apart; expected seconds; type source\.rate_hz="),
    ("7.0\n7.1\nx\n7.3\n7.4\n", r"timestamps\.txt:3: found 'x'; expected"),
])
def test_times_that_are_too_few_of_another_unit_or_none_are_refused(tmp_path, text, said):
    (images(tmp_path) / "timestamps.txt").write_text(text)
    with pytest.raises(ConfigError, match=said):
        at(tmp_path)


def test_a_list_of_times_of_another_form_is_said_to_be_left_out(tmp_path, caplog):
    (images(tmp_path) / "timestamps.txt").write_text("rgb/00000.png at 7.0\n" * 5)
    assert at(tmp_path)[1] is False
    assert caplog.text.count("timestamps.txt is left out: found 'rgb/00000.png at 7.0'") == 1


def test_poses_without_stamps_are_one_a_view(tmp_path):
    poses = "".join(f"{' '.join(f'{v:.9f}' for v in (*pose[:3, 3], *quaternion_xyzw(pose[:3, :3])))}\n" for pose in WAY[:5])
    (images(tmp_path) / "poses.txt").write_text(poses)
    assert [true[0, 3] for _, true in views(tmp_path)[0]] == pytest.approx([0.1 * k for k in range(5)])
    (tmp_path / "poses.txt").write_text(poses.replace("1.000000000 0.300000000", "1.000000000"))
    with pytest.raises(ConfigError, match="found 6 columns.*; poses.txt was taken for the true poses .*: rename it to go"):
        views(tmp_path)


def test_a_matrix_column_by_column_is_refused_by_runs_and_by_evaluate(tmp_path):
    """Its first twelve numbers are a rotation, turned round, at 0 0 0: such poses stood still."""
    path = images(tmp_path) / "poses.txt"
    path.write_text("".join(" ".join(f"{v:.9f}" for v in pose.T.ravel()) + "\n" for pose in WAY[:5]))
    with pytest.raises(ConfigError, match="expected 0 0 0 1 .a matrix column by column"):
        views(tmp_path)
    with pytest.raises(RecordingError, match="last four numbers are 0 1 0.3 1; expected 0 0 0 1 .a matrix column by column"):
        read_trajectory(path)
