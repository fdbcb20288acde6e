"""W08 to W14: disks that are full, folders that cannot be written, leftovers, numbers of jobs, values that break a table."""

from __future__ import annotations

import json
import resource
import signal
from pathlib import Path

import pandas
from faults.bench import LIGHT, Bench, parts
from faults.catalogue import fault

FAKE = [*parts(), "source.views=3", *LIGHT]
PLAN = ["-m", "task=planning", "world=map1", "planner=fake", *LIGHT]


def small_files(limit: int) -> None:
    """Files of this process end at so many bytes."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))


@fault("W08", "the disk is full while a table is written", "1, the path; the table before stays whole")
def full_disk_for_a_table(bench: Bench) -> None:
    bench.ask(*FAKE, "output=s/a", code=0)
    bench.ask("table", "s", "--csv", "table.csv", code=0)
    before = (bench.folder / "table.csv").read_bytes()
    bench.ask(*FAKE, "seed=1", "output=s/b", code=0)
    bench.process("table", "s", "--csv", "table.csv", code=1, says="table.csv", limit=lambda: small_files(500))
    assert (bench.folder / "table.csv").read_bytes() == before and not list(bench.folder.glob("*.tmp-*"))


@fault("W09", "the disk is full while a run is recorded", "1, the path; a row that says failed; what is whole can be read")
def full_disk_for_a_recording(bench: Bench) -> None:
    bench.process(
        *parts(), "source.views=60", "recording=full", "output=run", code=1, says="run", limit=lambda: small_files(20_000)
    )
    for path in (bench.folder / "run").glob("*.json"):
        json.loads(path.read_text())
    if (bench.folder / "run" / "row.json").exists():
        assert json.loads((bench.folder / "run" / "row.json").read_text())["status"] == "failed"


@fault(
    "W10",
    "the output folder is a file, read-only, or of an odd or endless name",
    "2, before anything runs; odd names work",
    not_tried="a read-only folder: who tests as root may write into it; /proc/nothing stands for it",
)
def odd_output(bench: Bench) -> None:
    bench.file("a file", "keep me")
    for output in ("a file", "a file/run", "/proc/nothing", "x" * 300):
        bench.ask(*FAKE, f"output='{output}'", says="")
    bench.ask(*FAKE, "output='~nosuchuser/x'", says="nosuchuser")
    for name in ("mit Leerzeichen und Ümläuten", "a=b,c"):
        bench.ask(*FAKE, f"output='{name}'", code=0)
        assert (bench.folder / name / "row.json").exists()


@fault("W11", "half a row and *.tmp files, left by a crash", "3, named and not counted; done again on --resume")
def half_a_row(bench: Bench) -> None:
    words = ["-m", *FAKE, "seed=0,1", "output=s", "--jobs", "2"]
    bench.ask(*words, code=0)
    path = next(bench.folder.glob("s/seed=1_*/row.json"))
    path.write_text(path.read_text()[:60])
    bench.file("s/seed=1_x.tmp-77/row.json.tmp-77", "half")
    bench.ask("table", "s", code=3, says="row.json")
    assert "2 jobs: 2 ok (1 finished before)" in bench.ask("--resume", "s", code=0).out
    bench.ask("table", "s", code=0)


@fault(
    "W12",
    "no job, one, the same twice, ten thousand million",
    "2; 0; each once; 2 at once; CPU time of composing below 50 ms a job",
    not_tried="10,000 jobs run through: 100 in tests/benchmarks/hundred_jobs.py",
)
def numbers_of_jobs(bench: Bench) -> None:
    for word, says in (
        ("seed=range(0)", "no jobs"),
        ("seed=range(10000000000)", "1e+10 jobs; at most 100000"),
        ("seed=range(1e300)", "at most 100000"),
        ("seed=range(0,1,0)", "the step not 0"),
        ("seed=0,-1", "seed=-1 is outside"),
    ):
        bench.ask("-m", *FAKE, word, says=says)
    assert (
        "1 combinations gave a configuration that was there already"
        in bench.ask("-m", *FAKE, "seed=3,3", "output=s", code=0).out
    )
    answer = bench.ask("-m", *FAKE, "seed=range(300)", "--cfg", code=0)
    assert len(answer.out.splitlines()) == 300 and answer.spent is not None and answer.spent.cpu_s / 300 < 0.05


@fault(
    "W13", "values that break a CSV: NA, commas, quotes, formulas, infinity, nothing", "0; read back as they were written"
)
def values_that_break_a_table(bench: Bench) -> None:
    texts = ["NA", "a,b", 'say "no"', "=1+1", "two\nlines", "", "None", "-0.0"]
    for number, text in enumerate(texts):
        row = {
            "status": "ok",
            "reason": "",
            "task": "survey",
            "world": "w",
            "planner": text,
            "seed": number,
            "ate_rmse_m": 0.5 * number,
            "missions": None if number == 2 else 2**62 + number,
        }
        bench.file(f"s/{number}/row.json", json.dumps(row))
    bench.file(
        "s/8/row.json", '{"status": "ok", "task": "survey", "world": "w", "planner": "p", "seed": 8, "ate_rmse_m": 1e999}'
    )
    bench.ask("table", "s", "--parquet", "t.parquet", "--csv", "t.csv", code=0)
    table = pandas.read_parquet(bench.folder / "t.parquet").sort_values("seed")
    assert table["planner"].tolist() == [*texts, "p"] and table["ate_rmse_m"].tolist() == [
        *(0.5 * n for n in range(8)),
        float("inf"),
    ]
    assert [None if pandas.isna(value) else int(value) for value in table["missions"]] == [
        *(None if n == 2 else 2**62 + n for n in range(8)),
        None,
    ]
    read = pandas.read_csv(bench.folder / "t.csv", keep_default_na=False, dtype=str).sort_values("seed")
    assert [text.removeprefix("'") for text in read["planner"]] == [*texts, "p"]


@fault(
    "W14",
    "more workers than cores, libraries that would take a thread per core",
    "0; one thread a job, the rows of one worker",
    not_tried="twice as fast with two workers: needs a machine with nothing else to do",
)
def more_workers_than_cores(bench: Bench) -> None:
    words = ["-m", *parts(), *LIGHT, "source.views=12", "source.delay_s=0.06", "seed=range(4)"]
    process = bench.start(*words, "output=s", "--jobs", "8", OMP_NUM_THREADS="8", OPENBLAS_NUM_THREADS="8")
    found: list[int] = []

    def over() -> bool:
        for path in bench.folder.glob("s/*/row.json"):
            try:
                status = Path(f"/proc/{json.loads(path.read_text())['pid']}/status").read_text()
                found.append(int(status.split("Threads:")[1].split()[0]))
            except (OSError, KeyError, ValueError):
                continue
        return process.poll() is not None

    bench.wait(over, 200.0)
    bench.ends(process, 0)
    assert found and max(found) <= 3  # its own, the one that watches the sweep, and a reader
    bench.process(*words, "output=t", "--jobs", "1", code=0)
    tables = [
        bench.ask("table", name, "--canonical", f"{name}.csv", code=0) and (bench.folder / f"{name}.csv").read_text()
        for name in ("s", "t")
    ]
    assert tables[0].replace("s/", "t/") == tables[1]
