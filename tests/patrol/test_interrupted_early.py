"""Ctrl-C between the beginning of a row and the first step."""

import pytest

import rhs
from rhs.runfolder.row import read_row


def test_a_run_interrupted_as_it_begins_has_a_row_that_says_so(tmp_path, monkeypatch):
    def pressed():
        raise KeyboardInterrupt

    monkeypatch.setattr("rhs.patrol.run.versions", pressed)
    with pytest.raises(KeyboardInterrupt):
        rhs.run(["task=planning", "world=square_small", f"output={tmp_path / 'run'}"], quiet=True)
    assert read_row(tmp_path / "run" / "row.json")["status"] == "interrupted"
