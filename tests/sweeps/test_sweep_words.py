"""Sweeps by pattern and by experiment: which jobs the words give."""

from pathlib import Path

import pytest

from rhs.api.errors import ConfigError
from rhs.config import registry
from rhs.sweeps import sweep


def planners(words, conf: tuple[Path, ...] = ()) -> list[str]:
    return [job.config.planner.name for job in sweep.plan(words, conf).jobs]


def test_a_pattern_takes_every_part_that_fits_it():
    assert planners(["planner=glob(rrt*)"]) == [n for n in registry.names("planner") if n.startswith("rrt")]
    with pytest.raises(ConfigError, match="seed=glob"):
        sweep.plan(["seed=glob(*)"])


def test_an_experiment_brings_its_own_sweep_and_typed_words_win(tmp_path):
    folder = tmp_path / "experiment"
    folder.mkdir()
    (folder / "two.yaml").write_text("# @package _global_\ndefaults:\n  - override /task: planning\n"
                                      "sweep:\n  planner: rrt,prm\n  seed: range(3)\n")
    jobs = [job.config for job in sweep.plan(["experiment=two"], (tmp_path,)).jobs]
    assert sorted((c.planner.name, c.seed) for c in jobs) == [(p, s) for p in ("prm", "rrt") for s in range(3)]
    assert all(c.task.name == "planning" for c in jobs)
    typed = [job.config for job in sweep.plan(["experiment=two", "planner=prm", "seed=7,8"], (tmp_path,)).jobs]
    assert [(c.planner.name, c.seed) for c in typed] == [("prm", 7), ("prm", 8)]
