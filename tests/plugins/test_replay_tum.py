"""Replaying TUM folders: pairing, units, truth, and refusals in one line."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL
from rhs_sources.replay_config import Replay
from rhs_sources.replay_stamps import Truth, ascending, associate

INTRINSICS = [50.0, 50.0, 31.5, 23.5]


def write_folder(folder, *, depth_dtype=np.uint16, depth_size=(48, 64), depth_value=10000, stamps=(0.0, 0.1, 0.2)):
    """A TUM folder of small images whose depth is depth_value everywhere, with the pose x = stamp."""
    for name in ("rgb", "depth"):
        (folder / name).mkdir()
        lines = []
        for stamp in stamps:
            file = f"{name}/{stamp:.6f}.png"
            image = np.full((48, 64, 3), (10, 20, 200), np.uint8)  # BGR on disk: a red picture
            if name == "depth":
                image = np.full(depth_size, depth_value if depth_dtype == np.uint16 else 200, depth_dtype)
                image[0, 0], image[0, 1] = 0, np.iinfo(depth_dtype).max
            cv2.imwrite(str(folder / file), image)
            lines.append(f"{stamp:.6f} {file}")
        (folder / f"{name}.txt").write_text("# stamp file\n" + "\n".join(lines) + "\n")
    poses = [f"{s:.6f} {s} 0 0 0 0 0 1" for s in np.arange(0.0, 0.25, 0.05)]
    (folder / "groundtruth.txt").write_text("\n".join(poses) + "\n")
    return folder


def replay(folder, **settings):
    return Replay(path=str(folder), **{"camera": INTRINSICS, **settings}).build(None)


def all_views(source):
    out = []
    while (capture := source.lead()) is not None:
        out.append((capture, source.truth()))
    source.close()
    return out


def test_views_come_in_order_in_rgb_and_metres_with_unknown_depth_as_nan(tmp_path):
    views = all_views(replay(write_folder(tmp_path)))
    assert [c.stamp_s for c, _ in views] == [0.0, 0.1, 0.2]
    capture = views[0][0]
    assert capture.image[5, 5].tolist() == [200, 20, 10]
    assert capture.depth.dtype == np.float32 and capture.depth[5, 5] == 2.0  # 10000 / 5000
    assert np.isnan(capture.depth[0, :2]).all()  # 0 and 65535


def test_truth_is_the_camera_mount_as_a_body_looking_along_its_x_axis(tmp_path):
    _, truth = all_views(replay(write_folder(tmp_path)))[1]
    # The recorded camera pose is unrotated: right, down, forward are x, y, z. A body's forward (x) is the camera's z.
    np.testing.assert_allclose(truth[:3, :3], BODY_FROM_OPTICAL.T, atol=1e-12)
    np.testing.assert_allclose(truth[:3, 3], [0.1, 0.0, 0.0], atol=1e-12)


def test_truth_is_interpolated_between_stamps_and_unknown_outside(tmp_path):
    folder = write_folder(tmp_path, stamps=(0.025, 0.9))
    views = all_views(replay(folder))
    np.testing.assert_allclose(views[0][1][:3, 3], [0.025, 0.0, 0.0], atol=1e-12)
    assert views[1][1] is None


def test_a_stamp_that_was_rounded_is_that_of_its_pose():
    """Poses a second apart, stamped 0.3333333 s and so on; a list of views that says 0.333 means the same moment, one that
    says 0.34 does not, and nothing is interpolated over a second."""
    poses = np.array([np.eye(4)] * 3)
    poses[:, 0, 3] = 0.0, 1.0, 2.0
    truth = Truth(np.arange(3) + 1 / 3, poses, max_gap_s=0.1)
    assert [truth.at(stamp)[0, 3] for stamp in (0.333, 1.3333, 2.334)] == [0.0, 1.0, 2.0]
    assert [truth.at(stamp) for stamp in (0.32, 0.34, 1.0, 2.34)] == [None] * 4


def test_start_stride_and_count_choose_views(tmp_path):
    folder = write_folder(tmp_path, stamps=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5))
    source = replay(folder, start=1, stride=2, count=2)
    assert source.views_expected == 2
    assert [c.stamp_s for c, _ in all_views(source)] == [0.1, 0.3]


@pytest.mark.parametrize(
    ("change", "settings", "words"),
    [
        ({"depth_dtype": np.uint8}, {}, "8-bit"),
        ({"depth_size": (24, 32)}, {}, "64x48 but depth is 32x24"),
        ({}, {"camera": "auto"}, "no camera intrinsics"),
        ({}, {"camera": "tum_fr1"}, "64x48 but source.camera=tum_fr1 is for 640x480"),
        ({}, {"camera": "kinect"}, "not one of auto, tum_fr1"),
        ({}, {"depth_scale": 1e6}, "typical depth is 0.01 m"),
        ({}, {"depth_scale": 5.0}, "typical depth is 2e.03 m"),  # a thousandth: all of it would be too far to be known
        ({}, {"start": 9}, "has 3 views"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_first_view(tmp_path, change, settings, words):
    folder = write_folder(tmp_path, **change)
    with pytest.raises(ConfigError, match=words) as caught:
        replay(folder, **settings)
    assert "\n" not in str(caught.value)


def test_missing_paths_and_foreign_folders_say_what_was_found(tmp_path):
    with pytest.raises(ConfigError, match="source.path is empty"):
        Replay().build(None)
    with pytest.raises(ConfigError, match="no such file"):
        replay(tmp_path / "nowhere")
    (tmp_path / "holiday.jpg").write_bytes(b"x")
    with pytest.raises(ConfigError, match="holiday.jpg"):
        replay(tmp_path)
    write_folder(tmp_path)
    (tmp_path / "depth.txt").unlink()
    with pytest.raises(ConfigError, match=r"depth.txt is not"):
        replay(tmp_path)


@pytest.mark.parametrize(
    ("pose", "words"), [("0 0 0 0", "has no direction"), ("0 0 one 1", "where a number")]
)
def test_a_truth_that_is_no_rotation_is_refused_with_its_line(tmp_path, pose, words):
    folder = write_folder(tmp_path)
    (folder / "groundtruth.txt").write_text(f"# truth\n0.0 1 2 3 {pose}\n")
    with pytest.raises(ConfigError, match=f"groundtruth.txt:2.*{words}"):
        replay(folder)


def test_true_poses_that_hold_nan_are_unknown_and_counted(tmp_path):
    folder = write_folder(tmp_path)
    lines = (folder / "groundtruth.txt").read_text().splitlines()
    lines[2] = "0.100000 nan nan nan nan nan nan nan"
    (folder / "groundtruth.txt").write_text("\n".join(lines) + "\n")
    source = replay(folder, max_truth_gap_s=0.06)
    assert source.rejected == {"truth_unknown": 1}
    assert [truth is not None for _, truth in all_views(source)] == [True, False, True]


def test_a_list_in_any_order_is_put_in_order_of_time(tmp_path):
    folder = write_folder(tmp_path)
    for name in ("rgb.txt", "depth.txt"):
        (folder / name).write_text("\n".join((folder / name).read_text().splitlines()[::-1]))
    source = replay(folder)
    assert source.rejected == {"reordered": 6}
    assert [capture.stamp_s for capture, _ in all_views(source)] == [0.0, 0.1, 0.2]


def test_a_later_view_that_cannot_be_read_is_left_out_and_said_to_be_lost(tmp_path):
    folder = write_folder(tmp_path)
    (folder / "rgb/0.100000.png").write_bytes(b"\x89PNG cut")
    source = replay(folder)
    assert [(c.index, c.stamp_s) for c, _ in all_views(source)] == [(0, 0.0), (1, 0.2)]
    assert "1 of 3 views cannot be read" in source.lost and "0.100000.png" in source.lost


def test_a_list_that_is_no_text_and_a_folder_too_high_are_refused_in_one_line(tmp_path):
    above = tmp_path / "above"
    (above / "sequence").mkdir(parents=True)
    folder = write_folder(above / "sequence")
    with pytest.raises(ConfigError, match=f"found no recording but one in it; type source.path={folder}"):
        replay(above)
    (folder / "rgb.txt").write_bytes(bytes(range(128, 256)))
    with pytest.raises(ConfigError, match="that are no text"):
        replay(folder)
    (folder / "rgb.txt").unlink()
    with pytest.raises(ConfigError, match="depth.txt is there but rgb.txt is not"):
        replay(folder)


def test_absolute_names_inside_the_recording_are_taken(tmp_path):
    folder = write_folder(tmp_path)
    lines = [line.split() for line in (folder / "rgb.txt").read_text().splitlines()[1:]]
    (folder / "rgb.txt").write_text("\n".join(f"{stamp} {folder / name}" for stamp, name in lines))
    assert len(all_views(replay(folder))) == 3


def test_images_that_are_links_are_taken(tmp_path):
    there, here = tmp_path / "there", tmp_path / "here"
    there.mkdir()
    here.mkdir()
    folder = write_folder(there)
    for name in ("rgb.txt", "depth.txt", "rgb", "depth"):
        (here / name).symlink_to(folder / name)
    assert len(all_views(replay(here))) == 3


def test_associations_with_depth_first_and_a_truth_of_another_name(tmp_path):
    folder = write_folder(tmp_path)
    stamps = ("0.000000", "0.100000", "0.200000")
    (folder / "associations.txt").write_text("".join(f"{s} depth/{s}.png {s} rgb/{s}.png\n" for s in stamps))
    for name in ("rgb.txt", "depth.txt"):
        (folder / name).unlink()
    (folder / "groundtruth.txt").rename(folder / "livingRoom0.gt.freiburg")
    views = all_views(replay(folder))
    assert views[0][0].depth[5, 5] == 2.0 and views[0][0].image[5, 5].tolist() == [200, 20, 10]
    assert views[2][1][0, 3] == pytest.approx(0.2)
    (folder / "livingRoom0.gt.freiburg").rename(tmp_path / "elsewhere.txt")
    assert all_views(replay(folder))[2][1] is None
    assert all_views(replay(folder, truth=str(tmp_path / "elsewhere.txt")))[2][1][0, 3] == pytest.approx(0.2)
    with pytest.raises(ConfigError, match="source.truth=nowhere.txt: no such file"):
        replay(folder, truth="nowhere.txt")


def test_a_camera_may_be_given_with_its_distortion(tmp_path):
    source = replay(write_folder(tmp_path), camera=[*INTRINSICS, 0.1, -0.2, 0.001, 0.002])
    source.close()
    assert source.camera.fx == 50.0 and source.camera.distortion == (0.1, -0.2, 0.001, 0.002)
    with pytest.raises(ConfigError, match="nor four, eight or nine numbers"):
        Replay(path="x", camera=[*INTRINSICS, 0.1])


def test_file_names_may_not_lead_out_of_the_recording(tmp_path):
    folder = write_folder(tmp_path)
    (folder / "rgb.txt").write_text("0.0 ../../etc/passwd\n")
    with pytest.raises(ConfigError, match="leads out of the recording"):
        replay(folder)


def test_association_is_one_to_one_nearest_first_and_survives_a_dropped_frame():
    color = np.arange(10) / 30.0
    depth = np.delete(color + 0.012, 4)  # the fifth depth image was dropped, all lag 12 ms
    pairs = associate(color, depth, 0.02)
    assert pairs == [(i, i if i < 4 else i - 1) for i in range(10) if i != 4]
    assert associate(np.array([0.0]), np.array([0.05]), 0.02) == []


def test_stamps_that_do_not_ascend_are_rejected_and_counted():
    stamps = [0.0, 0.1, 0.1, 0.05, 3600.2, 0.2, np.nan, 0.3, 7200.0, 7200.1]
    kept, counts = ascending(stamps, 60.0)
    assert [stamps[i] for i in kept] == [0.0, 0.1, 0.2, 0.3, 7200.0, 7200.1]
    assert counts == {"duplicate": 1, "backward": 1, "outlier": 1, "not_finite": 1, "jump": 1}


def test_rejected_lines_are_counted_by_the_source(tmp_path):
    folder = write_folder(tmp_path)
    lines = (folder / "rgb.txt").read_text().splitlines()
    (folder / "rgb.txt").write_text("\n".join([*lines, lines[-1], lines[1]]) + "\n")
    source = replay(folder)
    assert source.rejected == {"duplicate": 1, "backward": 1}
    assert len(all_views(source)) == 3


def test_the_real_recording_gives_sixty_pairs_with_truth(real_data):
    views = all_views(replay(real_data("rgbd/tum_fr1_rpy_60"), camera="tum_fr1"))
    assert len(views) == 60
    assert all(truth is not None for _, truth in views)
    assert all(0.4 < np.nanmedian(c.depth) < 5.0 for c, _ in views)


def test_a_recording_provides_only_what_it_holds(tmp_path):
    """A TUM folder has no wheels: asked for them, one line says so before anything runs."""
    import rhs

    folder = write_folder(tmp_path)
    assert replay(folder).provides == {"image", "gray", "depth"}
    words = ["source=replay", f"source.path={folder}", f"source.camera={INTRINSICS}".replace(" ", "")]
    with pytest.raises(ConfigError, match="odometry=wheel needs wheel, which source=replay does not provide"):
        rhs.run([*words, "odometry=wheel", "recording=off", f"output={tmp_path / 'run'}"])
