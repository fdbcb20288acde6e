"""Runs of which only a row was kept: verify, gate, blame and recover ask them again, or say what to type."""

from __future__ import annotations

import pytest
from installing import FAKES, installed

from rhs.base.errors import ConfigError
from rhs.cli.main import main
from rhs.config import overrides
from rhs.config.compose import config_hash, from_plain
from rhs.runfolder.shards import Line, Shard, words_key
from rhs.sweeps import sweep
from rhs.sweeps.runs import rows_of, values_of

WORDS = ["task=planning", "world=map1", "planner=fake", "recording=off", "pictures=off", "seed=range(5)", "keep=none"]


@pytest.fixture
def kept_rows(tmp_path):
    """A sweep folder as keep=none leaves it: what was asked, and a row each."""
    with installed(FAKES):
        planned = sweep.plan([*WORDS, f"output={tmp_path}"])
        sweep.remember(planned, tmp_path)
        shard = Shard(tmp_path)
        for job in planned.first:
            row = {"status": "killed" if job.config.seed == 4 else "ok", "task": "planning", "seed": job.config.seed,
                   "config_hash": config_hash(job.config)}
            shard.add(Line(job.name, words_key(job.words), {}, row).text())
        shard.close()
        yield tmp_path, [job.name for job in planned.first]


def test_configurations_come_back_from_the_words_of_the_sweep(kept_rows):
    folder, names = kept_rows
    rows = rows_of([folder])
    assert sorted(run.name for run in rows) == sorted(names)
    for run, values in values_of(rows).items():
        assert config_hash(from_plain(values)) == rows[run]["config_hash"]


@pytest.mark.parametrize(("command", "said"), [
    (["blame", "."], "is a sweep; name one of its runs"), (["blame", "./none"], "no row of that name"),
    (["blame", "./RUN"], "task=planning; blame takes patrols apart"), (["recover", "."], "--resume"),
])
def test_what_cannot_be_done_is_said_in_one_line(kept_rows, command, said, capfd, monkeypatch):
    folder, names = kept_rows
    monkeypatch.chdir(folder)
    assert main([word.replace("RUN", names[0]) for word in command]) in (0, 2)
    out = "".join(capfd.readouterr())
    assert said in out and len(out.splitlines()) == 1


def test_words_that_mean_something_else_now_are_refused(kept_rows):
    folder, names = kept_rows
    text = (folder / "sweep.json").read_text().replace('"world=map1"', '"world=map2"')
    (folder / "sweep.json").write_text(text)
    with pytest.raises(ConfigError):
        values_of([folder / names[0]])


def test_more_words_than_are_remembered_are_read_again(monkeypatch):
    monkeypatch.setattr(overrides, "MOST_READ", 5)
    found = overrides.sweep_words(overrides.parse(["task=planning", "world=map1", "seed=range(20)"]), most=100)
    assert [[word.text for word in words][-1] for words in found] == [f"seed={k}" for k in range(20)]
