"""A run folder is a transaction: what was there stays whole until an attempt is done, which sees none of it."""

from __future__ import annotations

import os

import pytest

from rhs.api.errors import ConfigError
from rhs.runfolder.folders import claim_run, claim_sweep, is_in_use
from rhs.runfolder.row import begin_row, read_row, sound, write_row


def finish(folder, **row):
    write_row(folder, {"status": "ok", "seed": 0, **row})


def names(folder):
    return sorted(path.name for path in folder.iterdir() if path.name != ".lock")


def test_a_row_that_begins_is_running_while_its_folder_is_held_and_killed_afterwards(tmp_path):
    with claim_run(str(tmp_path / "run"), seed=0) as claim:
        begin_row(claim.folder, {"world": "room"})
        row = read_row(claim.folder / "row.json")
        assert (row["status"], row["world"], row["pid"]) == ("running", "room", os.getpid())
        assert is_in_use(claim.folder)
    row = read_row(tmp_path / "run" / "row.json")
    assert row["status"] == "killed" and "recover" in str(row["reason"])


def test_an_attempt_to_overwrite_sees_nothing_of_the_earlier_run(tmp_path):
    home = tmp_path / "run"
    with claim_run(str(home), seed=0) as claim:
        (claim.folder / "steps.csv").write_text("old")
        (claim.folder / "places").mkdir()
        (claim.folder / "places" / "1.png").write_text("old")
        finish(claim.folder)
    with claim_run(str(home), seed=1, overwrite=True) as claim:
        assert names(claim.folder) == []
        (claim.folder / "places").mkdir()
        finish(claim.folder, seed=1)
        assert read_row(home / "row.json")["seed"] == 0 and (home / "steps.csv").read_text() == "old"
        assert claim.publish() == home == claim.folder
    assert names(home) == ["places", "row.json"] and names(home / "places") == []
    assert read_row(home / "row.json")["seed"] == 1


def test_an_attempt_that_never_ended_leaves_the_earlier_run_and_itself_to_be_seen(tmp_path):
    home = tmp_path / "run"
    with claim_run(str(home), seed=0) as claim:
        finish(claim.folder)
    with claim_run(str(home), seed=1, overwrite=True) as claim:
        begin_row(claim.folder, {"seed": 1})
    found = {str(path.parent.relative_to(home)): read_row(path)["status"] for path in home.rglob("row.json")}
    assert found == {".": "ok", f".attempt-{os.getpid()}": "killed"}


def test_an_attempt_that_was_refused_leaves_nothing(tmp_path):
    home = tmp_path / "run"
    with claim_run(str(home), seed=0) as claim:
        finish(claim.folder)
    with pytest.raises(ConfigError), claim_run(str(home), seed=1, overwrite=True):
        raise ConfigError("refused")
    assert names(home) == ["row.json"] and read_row(home / "row.json")["seed"] == 0
    with pytest.raises(ConfigError), claim_run(str(tmp_path / "new"), seed=1):
        raise ConfigError("refused")
    assert not (tmp_path / "new").exists()


def test_an_interrupted_attempt_that_has_its_row_is_published(tmp_path):
    with claim_run(str(tmp_path / "run"), seed=0) as claim:
        finish(claim.folder)
    with pytest.raises(KeyboardInterrupt), claim_run(str(tmp_path / "run"), seed=1, overwrite=True) as claim:
        finish(claim.folder, seed=1)
        raise KeyboardInterrupt
    assert read_row(tmp_path / "run" / "row.json")["seed"] == 1 and names(tmp_path / "run") == ["row.json"]


@pytest.mark.parametrize(("content", "says"), [("row", "finished run"), ("begun", "killed run"), ("notes", "other files")])
def test_what_a_folder_holds_is_never_written_into(tmp_path, content, says):
    if content == "notes":
        (tmp_path / "map.yaml").write_text("mine")
    else:
        begin_row(tmp_path, {"seed": 0}) if content == "begun" else finish(tmp_path)
    with pytest.raises(ConfigError, match=says):
        claim_run(str(tmp_path), seed=0)
    if content == "notes":
        with pytest.raises(ConfigError, match="other files"):
            claim_run(str(tmp_path), seed=0, overwrite=True)
        assert (tmp_path / "map.yaml").read_text() == "mine"


def test_a_folder_is_claimed_once(tmp_path):
    with claim_run(str(tmp_path / "run"), seed=0), pytest.raises(ConfigError, match="in use"):
        claim_run(str(tmp_path / "run"), seed=0)


def test_a_home_that_nobody_has_is_refused():
    with pytest.raises(ConfigError, match="nosuchuser"):
        claim_run("~nosuchuser/x", seed=0)


def test_what_a_row_cannot_hold_is_named_and_the_rest_kept(tmp_path):
    row = sound({"status": "ok", "good": 1.5, "list": [1], "long": "x" * 5000, "huge": 10**5000})
    write_row(tmp_path, row)
    read = read_row(tmp_path / "row.json")
    assert read["good"] == 1.5 and "list" not in read and "huge" not in read
    assert "list: RhsError" in str(read["row_failures"]) and "(5000 characters)" in str(read["long"])


def test_a_folder_whose_name_this_locale_cannot_read_is_refused():
    with pytest.raises(ConfigError, match=r"/\?\?_runs: this locale cannot read the folder's name; set PYTHONUTF8=1"):
        claim_run("\udcc3\udcb6_runs", seed=0)


def test_a_working_directory_that_is_gone_is_told(tmp_path, monkeypatch):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    for claim in (lambda: claim_run(str(tmp_path / "run"), seed=0), lambda: claim_sweep("")):
        with pytest.raises(ConfigError, match="the folder that this was started in is gone; cd to one"):
            claim()
