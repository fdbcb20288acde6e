"""Bags of several files, one of them cut, and bags whose metadata is broken: the line names the file, and what to type."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from bags import BagFile

from rhs.api.errors import ConfigError
from rhs_sources.replay import open_recording
from rhs_sources.replay_config import Replay

SCANS, BEAMS = 40, 400  # of each part


def split(folder, kind):
    """A bag of three files, as ros2 bag record --max-bag-duration writes it."""
    out, told = folder / "walk", []
    out.mkdir()
    for part in range(3):
        (folder / str(part)).mkdir()
        with BagFile(folder / str(part), kind) as bag:
            for k in range(SCANS):
                bag.scan("/scan", 1.0 + 0.1 * (SCANS * part + k), [2.0] * BEAMS)
        told.append(yaml.safe_load((bag.path / "metadata.yaml").read_text())["rosbag2_bagfile_information"])
        file = bag.path / told[-1]["relative_file_paths"][0]
        shutil.copy(file, out / f"walk_{part}{file.suffix}")
    names = [file.name for file in sorted(out.iterdir())]
    told[0] |= {"relative_file_paths": names, "message_count": 3 * SCANS}
    told[0]["topics_with_message_count"][0]["message_count"] = 3 * SCANS
    told[0]["files"] = [told[0]["files"][0] | {"path": name} for name in names]
    (out / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": told[0]}))
    return out


def scans(path):
    return len(list(open_recording(Replay(path=str(path))).views))


@pytest.mark.parametrize(("kind", "whole"), [("ros2_mcap", "whole.mcap"), ("ros2_sqlite", "whole.db3")])
def test_what_a_bag_with_a_cut_file_is_told_to_type_saves_what_is_whole(tmp_path, kind, whole):
    path = split(tmp_path, kind)
    assert scans(path) == 3 * SCANS
    last = max(path.glob("walk_2*"))
    last.write_bytes(last.read_bytes()[: int(0.7 * last.stat().st_size)])
    with pytest.raises(ConfigError, match="if it was cut: .*walk_2.* and put it in its place") as told:
        scans(path)
    typed = str(told.value).split("cut: ")[1].removesuffix(" and put it in its place")
    if kind == "ros2_sqlite" and shutil.which("sqlite3") is None:
        pytest.skip("sqlite3 is not installed")
    subprocess.run(typed.replace("python -m", f"{sys.executable} -m"), shell=True, cwd=tmp_path, check=False)
    shutil.copy(Path(tmp_path, whole), last)
    assert 2 * SCANS <= scans(path) < 3 * SCANS


@pytest.mark.parametrize("kept", [0, 40])
def test_metadata_that_is_broken_is_named(tmp_path, kept):
    path = split(tmp_path, "ros2_sqlite")
    (path / "metadata.yaml").write_text((path / "metadata.yaml").read_text()[:kept])
    with pytest.raises(ConfigError, match=r"its metadata.yaml is broken; type: rm .*/metadata.yaml; ros2 bag reindex "):
        scans(path)
