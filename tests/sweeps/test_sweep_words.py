"""Sweeps by pattern and by experiment: which jobs the words give."""

import os
import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from rhs.api.errors import ConfigError
from rhs.config import registry
from rhs.sweeps import sweep
from rhs.sweeps.jobs import Limits, _Pool


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


def test_zip_takes_values_in_pairs_beside_other_sweeps():
    jobs = [job.config for job in sweep.plan(["task=planning", "zip(world=map1,map2 seed=5,6)", "planner=prm,rrt"]).jobs]
    assert [(c.world, c.seed, c.planner.name) for c in jobs] == [
        ("map1", 5, "prm"), ("map1", 5, "rrt"), ("map2", 6, "prm"), ("map2", 6, "rrt")]


def test_quoted_texts_of_a_zip_are_taken_whole(tmp_path):
    jobs = sweep.plan(["task=planning", "zip(world='a b','c \\' (d) e' seed=1,2)"]).jobs
    assert [(job.config.world, job.config.seed) for job in jobs] == [("a b", 1), ("c ' (d) e", 2)]


@pytest.mark.parametrize(("word", "says"), [
    ("zip(world=map1,map2 seed=1,2,3)", "found 2 of world and 3 of seed"), ("zip(seed=1,2)", "found 2 of seed;"),
    ("zip()", "found no key"), ("zip(seed=1,2 world=map1", "a bracket or a quote is not closed")])
def test_a_zip_whose_columns_are_not_as_long_is_refused(word, says):
    with pytest.raises(ConfigError, match="expected as many values for each of two keys or more") as caught:
        sweep.plan([word])
    assert says in str(caught.value)


@pytest.mark.parametrize(("word", "says"), [
    ("seed=rnage(3)", "there is no rnage(...); did you mean range?"),
    ("seed=tag(1,2)", "there is no tag(...) (there is range"),
    ("seed=range(a,b)", "range(...) does not take this"), ("seed=range(3", "a bracket or a quote is not closed"),
    ("planner='prm", "a bracket or a quote is not closed"), ("planner=prm,", "no value after the last comma"),
    ("planner=prm;rrt", "quote text with special characters: planner=\"'...'\""), ("output='a[b',}", "a bracket or a quote"),
    ("planner=glob(zz*)", "it has no values, so this sweep has no jobs (there is astar, ")])
def test_a_word_that_cannot_be_read_is_refused_in_our_words(word, says):
    with pytest.raises(ConfigError) as caught:
        sweep.plan(["task=planning", word])
    assert says in str(caught.value)
    assert not any(theirs in str(caught.value) for theirs in ("Hydra", "expecting", "evaluating", "viable", "token"))


def test_hydras_own_word_for_a_folder_is_taken_as_output():
    assert sweep.plan(["seed=0,1", "hydra.sweep.dir=here"]).output == "here"


def test_a_word_of_an_earlier_version_is_taken_with_a_warning():
    with pytest.warns(FutureWarning, match="loop_closer=one_eye is now loop_closer=monocular"):
        jobs = sweep.plan(["sensor=mono", "loop_closer=one_eye", "seed=0,1"]).jobs
    assert jobs[0].config.loop_closer.settings.advanced.depth_share > 0.0


def test_a_job_is_named_by_the_last_of_words_typed_twice():
    found = sweep.plan(["task=planning", "world=map1", "planner=prm", "planner=astar,prm", "seed=1"])
    assert [job.name.rpartition("_")[0] for job in found.first] == ["planner=astar", "planner=prm"]


def test_ctrl_c_waits_while_a_process_starts_and_threads_start_theirs_in_turn(tmp_path):
    """The process that loads what all jobs need would tell of it by a traceback; the environment is one for all threads."""
    masks, before = [], dict(os.environ)

    class Slow:
        def start(self):
            masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, []))
            time.sleep(0.05)

    def begin():
        pool = _Pool(iter([]), tmp_path, Limits(), lambda job, status: None)
        pool.context = SimpleNamespace(Process=lambda **_: Slow())
        pool._process(print)

    threads = [threading.Thread(target=begin) for _ in range(3)]
    [thread.start() for thread in threads]
    [thread.join() for thread in threads]
    assert len(masks) == 3 and all(signal.SIGINT in mask for mask in masks) and dict(os.environ) == before
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, [])
