"""W01 to W07: jobs that fail, sweeps that are killed, interrupted, started twice, resumed with other words."""

from __future__ import annotations

import json
import signal
import time

from faults.bench import LIGHT, Bench, accounts, parts
from faults.catalogue import fault
from faults.plugins import bad_company

from rhs.reports.table import rows, to_csv

FAKE = [*parts(), "source.views=3", *LIGHT]
FAULTY = [*parts(odometry="faulty"), "source.views=3", *LIGHT]


def table_of(bench: Bench, sweep: str) -> str:
    """The canonical table without the hash of the configuration, which knows the path of a flag."""
    return to_csv(rows([bench.folder / sweep]).drop(columns=["config_hash"]), canonical=True).replace(
        str(bench.folder / sweep), ""
    )


def under_way(bench: Bench, lines: int = 0) -> bool:
    """Whether a job has begun, and written so many steps."""
    files = bench.folder.glob("s/*/steps.jsonl*" if lines else "s/*/config.yaml")
    return any(len(path.read_text().splitlines()) >= lines for path in files)


@fault("W01", "some jobs of a sweep raise or crash", "3; a row and an account for every job, the reasons told")
def jobs_that_fail(bench: Bench) -> None:
    answer = bench.once(bad_company)
    told = accounts(answer.folder / "s")
    assert told == {
        path.parent.name: row["status"]
        for path, row in ((path, json.loads(path.read_text())) for path in (answer.folder / "s").glob("*/row.json"))
    }
    assert "7 jobs: 2 ok, 2 failed, 2 killed, 1 timeout" in answer.out
    assert len((answer.folder / "s" / "table.csv").read_text().splitlines()) == 8
    log = next((answer.folder / "s").glob("odometry.how=raise_*/job.log")).read_text()
    assert "Traceback" in log and "the odometry of this test" in log


@fault("W02", "all jobs fail for one reason", "3; with --fail-fast N stopped after N, the reason told once")
def all_jobs_fail_alike(bench: Bench) -> None:
    answer = bench.process(
        "-m",
        *FAULTY,
        "seed=range(9)",
        "odometry.how=raise",
        "output=s",
        "--jobs",
        "1",
        "--fail-fast",
        "2",
        code=3,
        says="9 of 9 jobs did not end well",
    )
    assert (
        "9 jobs: 2 failed, 7 skipped" in answer.out
        and "stopped after 2 jobs ended alike: failed: odometry=faulty" in answer.out
    )


@fault(
    "W03",
    "SIGKILL to the driver of a sweep, then --resume",
    "0; only what was missing runs, the table is the undisturbed one",
)
def killed_driver(bench: Bench) -> None:
    flag = bench.folder / "well"
    words = ["-m", *FAULTY, "seed=range(3)", "odometry.how=sleep", f"odometry.flag={flag}", "--jobs", "1"]
    process = bench.start(*words, "output=s")
    bench.wait(lambda: under_way(bench))
    process.kill()
    bench.ends(process, -9)
    flag.touch()
    bench.file("s/left.tmp-123", "half a ro")
    bench.process("--resume", "s", "--jobs", "2", code=0)
    bench.process(*words, "output=t", code=0)
    assert table_of(bench, "s") == table_of(bench, "t")
    assert "(3 finished before)" in bench.process("--resume", "s", code=0).out


def interrupted(bench: Bench, number: signal.Signals, code: int) -> None:
    process = bench.start(
        "-m", *parts(), "seed=range(3)", "source.views=600", "source.delay_s=0.05", "output=s", "--jobs", "1"
    )
    bench.wait(lambda: under_way(bench, 3))
    process.send_signal(number)
    answer = bench.ends(process, code, says="interrupted")
    assert "1 interrupted, 2 skipped" in answer.out and "--resume" in answer.out
    assert {row["status"] for row in answer.rows().values()} == {"interrupted"}
    assert not list(bench.folder.glob("s/*/*.tmp-*"))


@fault("W04", "Ctrl-C, once and twice", "130; rows so far are kept, the job under way is interrupted, nothing runs on")
def control_c(bench: Bench) -> None:
    interrupted(bench, signal.SIGINT, 130)
    process = bench.start("-m", *FAULTY, "seed=0", "odometry.how=spin", "output=t")
    bench.wait(lambda: any(len(path.read_text().splitlines()) >= 2 for path in bench.folder.glob("t/*/steps.jsonl*")))
    process.send_signal(signal.SIGINT)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    bench.ends(process, 130, says=None, timeout_s=15.0)


@fault("W05", "SIGTERM, as a batch system sends it", "143; the same")
def terminated(bench: Bench) -> None:
    interrupted(bench, signal.SIGTERM, 143)


@fault("W06", "two runs in one second, two sweeps in one folder", "0, a folder each; 2, in use")
def started_twice(bench: Bench) -> None:
    both = [bench.start(*FAKE) for _ in range(2)]
    for process in both:
        bench.ends(process, 0)
    assert len(list((bench.folder / "results" / "runs").glob("*/row.json"))) == 2
    process = bench.start("-m", *FAULTY, "seed=0", "odometry.how=sleep", "output=s")
    bench.wait(lambda: under_way(bench))
    bench.ask(
        "-m", *FAULTY, "seed=0", "odometry.how=sleep", "output=s", "--resume", says="is in use by another run", alone=False
    )
    process.kill()
    bench.ends(process, -9)


@fault(
    "W07",
    "a sweep resumed with another configuration or version, or with no folder",
    "2, which key differs; --force goes on",
)
def resumed_with_other_words(bench: Bench) -> None:
    words = ["-m", *FAKE, "output=s", "--jobs", "2"]
    bench.ask(*words, "seed=0,1", code=0)
    bench.ask("--resume", says="which sweep?")
    bench.ask("--resume", "absent", says="holds no sweep")
    bench.ask(*words, "seed=0,1", says="already holds a sweep; go on with it by --resume")
    bench.ask(*words, "seed=0,1", "source.views=4", "--resume", says="source.views was 3, is 4")
    assert "3 jobs: 3 ok (2 finished before)" in bench.ask(*words, "seed=0,1,2", "--resume", code=0).out
    path = bench.folder / "s" / "sweep.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"rhs": "0.0.1"}))
    bench.ask(*words, "seed=0,1,2", "--resume", says="was made by rhs 0.0.1")
    bench.ask(*words, "seed=0,1,2", "--resume", "--force", code=0)
