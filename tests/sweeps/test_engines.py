"""Engines: rows = jobs, each once, whatever dies; what is refused; what the words of a sweep mean."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import threading
import time
from collections import Counter
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest
from installing import FAKES, environment, installed

from rhs.api.engine import Engine
from rhs.api.errors import ConfigError, ContractError, EngineError
from rhs.base.processes import children, descendants
from rhs.cli.main import main
from rhs.cli.progress import Progress
from rhs.config import registry
from rhs.reports.table import rows, to_csv
from rhs.runfolder.shards import Line, Shard, read_lines, shards, words_key
from rhs.sweeps import sweep
from rhs.sweeps.chunks import Chunk
from rhs.sweeps.drive import Driver, check_engine
from rhs.sweeps.jobs import Outcome
from rhs.sweeps.keep import Keeper
from rhs.sweeps.sweep import plan

PLANNING = ["task=planning", "world=map1", "planner=fake", "recording=off", "pictures=off"]


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


# --- the driver, on an engine that answers by itself ----------------------------------------------------------------


class Answering(Executor):
    """Calls `answer(words of the chunk)` at once, in place of running it."""

    def __init__(self, answer) -> None:
        self.answer, self.sizes, self.out, self.most_out = answer, [], 0, 0

    def submit(self, fn, /, *args, **kwargs):
        words = json.loads(args[0])["words"]
        self.sizes.append(len(words))
        future: Future = Future()
        try:
            future.set_result(self.answer(words))
        except Exception as error:
            future.set_exception(error)
        return future


class FakeEngine(Engine):
    def __init__(self, answer, width: int = 2, chunk_s: float = 30.0) -> None:
        self.width, self.chunk_s, self.executor, self.closed = width, chunk_s, Answering(answer), []
        self.gone = False

    def open(self):
        return self.executor

    def alive(self):
        return not self.gone

    def close(self, now):
        self.closed.append(now)


def rows_of(words, each_s: float = 1.0) -> str:
    """What a worker answers whose jobs all end well."""
    lines = [Line(" ".join(one), words_key(one), {}, {"status": "ok", "config_hash": " ".join(one)}).text() for one in words]
    return "\n".join([*lines, json.dumps({"end": each_s * len(words)})])


def driver(engine: Engine, folder: Path, **more) -> Driver:
    chunk = Chunk([], [], {"timeout_s": 5.0}, "none", str(folder), "", str(folder))
    return Driver(engine, chunk, Keeper(folder, "none"), Outcome(), told=lambda status: None, **more)


def drive(engine: Engine, folder: Path, jobs: int, **more) -> Driver:
    one = driver(engine, folder, total=jobs, **more)
    try:
        one.run(iter([[f"seed={i}"] for i in range(jobs)]))
    finally:
        one.keeper.close()
    return one


def test_every_job_gives_one_row_and_chunks_grow_to_what_they_should_last(tmp_path):
    engine = FakeEngine(rows_of)
    done = drive(engine, tmp_path, 500)
    assert sorted(read_lines(shards(tmp_path), [])) == sorted(words_key([f"seed={i}"]) for i in range(500))
    assert done.outcome.counts == {"ok": 500} and engine.closed == [False]
    assert engine.executor.sizes[0] == 1 and max(engine.executor.sizes) == 30  # 30 s of jobs of 1 s each


def test_chunks_whose_worker_dies_are_sent_again_and_nothing_is_lost_or_doubled(tmp_path):
    tries: Counter = Counter()

    def dies_often(words):
        tries[words[0][0]] += 1
        if tries[words[0][0]] == 1:
            raise RuntimeError("KilledWorker")
        return rows_of(words) if tries[words[0][0]] == 3 else "\n".join(rows_of(words).splitlines()[1:])  # one row short

    done = drive(FakeEngine(dies_often), tmp_path, 200)
    text = shards(tmp_path)[0].read_text()
    assert text.count("\n") == 200 == len(read_lines(shards(tmp_path), []))
    assert done.outcome.counts == {"ok": 200}


def test_a_job_that_kills_its_worker_is_left_without_a_row_and_named(tmp_path):
    def poisoned(words):
        if ["seed=13"] in words:
            raise RuntimeError("worker died")
        return rows_of(words)

    done = drive(FakeEngine(poisoned), tmp_path, 50)
    assert len(read_lines(shards(tmp_path), [])) == 49
    assert done.outcome.counts == {"ok": 49, "skipped": 1} and "seed=13" in next(iter(done.outcome.reasons))


def test_an_engine_that_only_fails_ends_the_sweep_without_a_row(tmp_path):
    def never(words):
        raise OSError("no route to host")

    engine = FakeEngine(never)
    with pytest.raises(EngineError, match=r"no route to host \(10 times\)"):
        drive(engine, tmp_path, 100)
    assert shards(tmp_path) == [] and engine.closed == [True]


def test_a_scheduler_that_dies_silently_is_noticed(tmp_path):
    engine = FakeEngine(rows_of)
    engine.executor.submit = lambda fn, *args: Future()  # type: ignore[method-assign]  # nobody will ever answer
    engine.gone = True
    begin = time.monotonic()
    with pytest.raises(EngineError, match="no longer answers"):
        drive(engine, tmp_path, 10)
    assert time.monotonic() - begin < 10.0


def test_a_future_that_was_cancelled_without_a_word_is_seen(tmp_path):
    """As Dask's are when its scheduler is killed: `wait` does not wake."""
    engine, sent = FakeEngine(rows_of), []

    def submit(fn, *args):
        future = Answering(rows_of).submit(fn, *args)
        if not sent:
            future = Future()
            future.cancel()
        sent.append(future)
        return future

    engine.executor.submit = submit  # type: ignore[method-assign]
    assert drive(engine, tmp_path, 20).outcome.counts == {"ok": 20}


def test_two_words_of_one_configuration_give_one_row(tmp_path):
    def same(words):
        return "\n".join([*(Line("x", words_key(one), {}, {"status": "ok", "config_hash": "c"}).text() for one in words),
                          json.dumps({"end": 1.0})])

    done = drive(FakeEngine(same), tmp_path, 10)
    assert (done.outcome.counts, done.repeated) == ({"ok": 1}, 9)


def test_fail_fast_stops_an_engine_too(tmp_path):
    def failing(words):
        lines = [Line(" ".join(one), words_key(one), {}, {"status": "failed", "reason": "r", "config_hash": one[0]}).text()
                 for one in words]
        return "\n".join([*lines, json.dumps({"end": 1.0})])

    done = drive(FakeEngine(failing), tmp_path, 1000, same_failures=5)
    assert "jobs ended alike" in done.outcome.stopped and done.outcome.counts["failed"] < 100


# --- shards ---------------------------------------------------------------------------------------------------------


def test_a_torn_or_changed_line_is_passed_over_and_counted(tmp_path):
    shard = Shard(tmp_path)
    for i in range(4):
        row = {"status": "ok", "v": i, "x": float("nan"), "y": float("inf")}
        shard.add(Line(f"r{i}", words_key([str(i)]), {}, row).text())
    shard.close()
    data = shard.path.read_bytes()
    shard.path.write_bytes(data.replace(b'"v": 1', b'"v": 7')[:-20])
    broken: list[str] = []
    found = read_lines([shard.path], broken)
    assert sorted(line.row["v"] for line in found.values()) == [0, 2] and broken == [f"{shard.path}: 2 lines are torn"]
    assert all(line.row["x"] is None and line.row["y"] == float("inf") for line in found.values())


def test_of_two_rows_of_one_job_the_later_counts(tmp_path):
    for status in ("failed", "ok"):
        shard = Shard(tmp_path)
        shard.add(Line("r", words_key(["seed=1"]), {}, {"status": status}).text())
        shard.close()
        time.sleep(0.002)
    assert [line.row["status"] for line in read_lines(shards(tmp_path), []).values()] == ["ok"]


def test_the_key_of_words_knows_neither_order_nor_folder():
    assert words_key(["a=1", "b=2", "output=x"]) == words_key(["b=2", "output=y", "a=1"]) != words_key(["a=1", "b=3"])


# --- words ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("words", "says"), [
    (["-m", "engine=dusk"], "did you mean"), (["engine=dask"], "add -m"), (["keep=none"], "add -m"),
    (["-m", "engine=dask", "engine.adress=x"], "did you mean engine.address"), (["-m", "keep=some"], "all, failures, none"),
    (["-m", "engine=process,dask"], "several values"), (["-m", "engine=dask", "engine.cluster=lsd"], "cluster=lsd"),
    (["-m", "engine=slurm", "engine.cpus=0"], "engine.cpus=0"), (["-m", "engine.address=x"], "unknown key engine.address"),
    (["-m", "hydra/launcher=submitit_slurm"], "type engine=slurm"),
])
def test_a_wrong_word_about_engines_is_refused_in_one_line(words, says, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main([*words, *PLANNING]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1 and list(tmp_path.iterdir()) == []


def test_an_extra_that_is_missing_is_named_with_what_to_type(monkeypatch):
    monkeypatch.setattr(registry.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"type: pip install 'rhs\[dask\]'"):
        plan([*PLANNING, "engine=dask"])


def test_a_hundred_thousand_jobs_are_planned_in_seconds_and_wrong_ends_are_refused():
    begin = time.process_time()
    found = plan([*PLANNING, "planner.samples=5,6", "seed=range(50000)"])
    assert time.process_time() - begin < 4.0
    assert len(found) == 100_000 and found.choice.keep == "failures" and found.sharded
    with pytest.raises(ConfigError, match="seed=-1"):
        plan([*PLANNING, "seed=range(-1,2000)"])
    with pytest.raises(ConfigError, match="samples=-5"):
        plan([*PLANNING, "planner.samples=5,-5", "seed=range(2000)"])


def test_progress_off_a_terminal_is_a_line_now_and_then():
    out, outcome = io.StringIO(), Outcome(workers=3)
    progress = Progress(10, out=out, every_s=0.0)
    for status in ("ok", "failed"):
        outcome.count(status, status, "" if status == "ok" else "too dark")
        progress.tell(status, outcome)
    assert "2 of 10 jobs" in out.getvalue().splitlines()[-1]
    assert "1 ok, 1 failed, 3 workers (1 x failed: too dark)" in out.getvalue()


def test_what_ended_before_we_began_says_nothing_of_the_rate():
    out, outcome = io.StringIO(), Outcome()
    progress = Progress(1000, unit="run", found=lambda: "half fail at 3", out=out)
    for number in range(900):
        outcome.count(str(number), "ok", "")
        progress.tell("ok", outcome, known=True)
    line = progress.line(outcome, progress.began + 1)
    assert line == "900 of 1000 runs, 0 a second, no run back yet; 900 ok, half fail at 3"
    outcome.count("900", "ok", "")
    progress.tell("ok", outcome)
    assert "901 of 1000 runs, 0.1 a second, 16 min left" in progress.line(outcome, progress.began + 10)


# --- for real -------------------------------------------------------------------------------------------------------


def canonical(sweep: Path) -> str:
    return to_csv(rows([sweep]), canonical=True)


def test_rows_in_shards_are_the_rows_of_folders_and_a_large_sweep_goes_on(tmp_path, monkeypatch, capfd):
    """The same four jobs: whole folders; nothing kept; composed one by one, as a large sweep, and begun twice."""
    monkeypatch.chdir(tmp_path)
    words = ["-m", *PLANNING, "planner.samples=5,6", "--jobs", "2"]
    assert main([*words, "seed=0,1", "output=all"]) == 3  # the fake planner finds no way; the jobs end well
    monkeypatch.setattr(sweep, "MOST_PLANNED", 1)
    assert main([*words, "seed=0", "output=none", "keep=none"]) == 3
    left = next((tmp_path / "all").glob("*samples=5,seed=1_*"))  # as a sweep leaves it that is killed at the wrong moment
    shutil.copytree(left, tmp_path / "none" / left.name)
    assert main(["--resume", "none", "seed=0,1"]) == 3
    assert "4 jobs: 4 ok (3 finished before)" in capfd.readouterr().out
    assert canonical(tmp_path / "none") == canonical(tmp_path / "all")
    assert [path.name for path in (tmp_path / "none").iterdir() if path.is_dir()] == ["rows"]
    assert main(["--resume", "none", "seed=0,1", "planner.samples=6"]) == 2
    assert "another configuration" in capfd.readouterr().err


@pytest.mark.slow
def test_dask_gives_the_same_rows_though_a_job_server_is_killed(tmp_path, monkeypatch, capfd):
    pytest.importorskip("distributed")
    monkeypatch.chdir(tmp_path)
    for name, value in environment(FAKES).items():
        monkeypatch.setenv(name, value)
    words = ["-m", *PLANNING, "seed=range(5)", "--jobs", "1"]
    killed: list[int] = []
    threading.Thread(target=kill_a_job_server, args=(tmp_path / "dask", killed), daemon=True).start()
    assert main([*words, "output=dask", "engine=dask", "keep=failures"]) == 3  # no way found: whole folders stay
    assert "5 jobs: 5 ok" in capfd.readouterr().out and killed
    assert len(list((tmp_path / "dask").glob("seed=*/plan.json"))) == 5
    assert main([*words, "output=here", "keep=none"]) == 3
    assert canonical(tmp_path / "dask") == canonical(tmp_path / "here")
    assert not [pid for pid in children(os.getpid()) if "jobserver" in command(pid)]


def kill_a_job_server(folder: Path, killed: list[int]) -> None:
    """Once a row is there, or after 20 s."""
    end = time.monotonic() + 60.0
    while not killed and time.monotonic() < end:
        for pid in descendants(os.getpid()):
            if "rhs.sweeps.jobserver" in command(pid):
                os.kill(pid, signal.SIGKILL)
                killed.append(pid)
                return
        time.sleep(0.05)


def command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " ")
    except OSError:
        return ""


def test_why_a_batch_system_took_no_job_is_kept_in_its_own_words(caplog):
    """dask-jobqueue raises sbatch's refusal in a task of its event loop, which only logs it."""
    pytest.importorskip("distributed")
    import logging

    from rhs_engines.dask_engine import Answer

    answer, log = Answer(), logging.getLogger("tornado.application")
    with answer.heard():
        try:
            raise RuntimeError("Command exited with code 1\nstderr:\nsbatch: error: invalid partition specified: nowhere\n")
        except RuntimeError:
            log.error("Exception in callback", exc_info=True)
    assert answer.text == "sbatch: error: invalid partition specified: nowhere"
    assert not caplog.records and answer not in log.handlers


@pytest.mark.parametrize(("name", "value"), [
    ("width", 0), ("width", "2"), ("width", None), ("processes", 0), ("chunk_s", -1.0)])
def test_numbers_of_an_engine_that_cannot_be_are_named(name, value):
    engine = FakeEngine(rows_of)
    setattr(engine, name, value)
    with pytest.raises(ContractError, match=f"{name} is {value!r}; expected a number"):
        check_engine(engine)


def test_what_an_engine_raises_as_it_closes_hides_nothing(tmp_path, caplog):
    class Careless(FakeEngine):
        def close(self, now):
            raise AttributeError("of mine")

    assert drive(Careless(rows_of), tmp_path, 3).outcome.counts == {"ok": 3}
    assert "could not be closed: AttributeError: of mine" in caplog.text
    broken = Careless(rows_of)
    broken.open = lambda: 1 / 0
    with pytest.raises(EngineError, match="ZeroDivisionError"):
        drive(broken, tmp_path, 3)


@pytest.mark.parametrize("given", [None, "text"])
def test_an_executor_that_gives_no_future_is_told_so(tmp_path, given):
    engine = FakeEngine(rows_of)
    engine.executor.submit = lambda function, text: given
    with pytest.raises(EngineError, match=f"submit.. returned {type(given).__name__}; expected a concurrent.futures.Future"):
        drive(engine, tmp_path, 3)


def test_an_answer_that_is_no_text_is_told_so(tmp_path):
    done = drive(FakeEngine(lambda words: None), tmp_path, 1)
    assert "a chunk was answered by NoneType" in next(iter(done.outcome.reasons))
