"""P01 to P11: plugins that cannot be loaded, raise, return nonsense, hang, crash, leak, or reach for what is not theirs."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from faults.bench import HOSTILE, LIGHT, Bench, hostile, parts
from faults.catalogue import fault

FAKE = parts()
FAULTY = [*parts(odometry="faulty"), "source.views=4", *LIGHT]
PLAN = ["task=planning", "world=map1", *LIGHT]


def distribution(bench: Bench, name: str, points: str, **modules: str) -> str:
    """The folder of an installed distribution with these entry points and modules, for PYTHONPATH."""
    folder = bench.home / f"site_{name}"
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(points)
    for module, text in modules.items():
        (folder / f"{module}.py").write_text(text)
    return str(folder)


@fault("P01", "a plugin's module raises ImportError or SyntaxError", "0 for all others, listed with the reason; 2 if chosen")
def broken_module(bench: Bench) -> None:
    site = distribution(bench, "crooked", "[rhs.planner]\ncrooked = crooked:Crooked\n", crooked="def (:\n")
    for name, says in (
        ("broken", "cannot be imported: ModuleNotFoundError"),
        ("exits", "cannot be imported: SystemExit: 3"),
        ("crooked", "cannot be imported: SyntaxError"),
    ):
        bench.ask(*FAKE, f"planner={name}", says=says, site=site)
    bench.ask(*FAKE, *LIGHT, "source.views=2", "output=run", code=0, site=site)
    assert "NOT USABLE" in bench.ask("planner=crooked", "--help", code=0, site=site).out


@fault("P02", "the plugin that was chosen cannot be loaded", "2; no other takes its place")
def chosen_plugin_broken(bench: Bench) -> None:
    bench.ask(*FAKE, "planner=broken", says="planner=broken (rhs_fakes.broken:Broken from rhs-fakes 0.1) cannot be imported")
    bench.ask("-m", *FAKE, "planner=fake,broken", says="planner=broken (rhs_fakes.broken:Broken")
    bench.ask(*FAKE, "planner=nameless", says="is not a dataclass")


@fault(
    "P03",
    "a plugin raises in the middle of a run",
    "1 (3 in a sweep); a row with type, step and plugin; what it saw is kept",
)
def plugin_raises(bench: Bench) -> None:
    for how, says in (
        ("raise", "ValueError at step 2: the odometry of this test fails on purpose"),
        ("exit", "SystemExit at step 2: 3"),
    ):
        answer = bench.ask(*FAULTY, f"odometry.how={how}", f"output={how}", code=1, says=says)
        row = answer.row(how)
        assert row["status"] == "failed" and row["success"] == 0.0
        assert "odometry=faulty (rhs-fakes 0.1) failed in rhs_fakes/parts.py:" in row["reason"]
        assert answer.steps("index", how) == ["0", "1"]
    bench.ask(*FAULTY, "odometry.how=escape", "output=escape", code=1, says="ValueError")
    bench.ask(*FAULTY, "odometry.how=huge_reason", "output=huge", code=1, says="131073 characters")


@fault(
    "P04",
    "a plugin returns a wrong shape, None, NaN, or numbers that cannot be",
    "1; the contract, the plugin and the field are named; nothing of it enters the table",
)
def plugin_returns_nonsense(bench: Bench) -> None:
    for how, says in (
        ("none_result", "of type NoneType; expected a Motion"),
        ("nan_pose", "previous_from_body is not finite"),
        ("shape", "covariance is of shape (3, 3)"),
    ):
        bench.ask(*FAULTY, f"odometry.how={how}", f"output={how}", code=1, says=("odometry=faulty (rhs-fakes 0.1)", says))
    for kind, how, says in (
        ("localiser", "far", "map_from_body is 1e+07 m away"),
        ("localiser", "probability", "a chance in [0, 1]"),
        ("planner", "long", "points_m is 3000000 long"),
        ("mapper", "flat", "resolution_m is 0.0"),
        ("mapper", "chances", "probability is 7 in 2400 cells"),
        ("mapper", "turned", "probability is of shape"),
        ("sensor", "negative", "scan.ranges_m is -1"),
        ("sensor", "mismatch", "60 bearings and 59 ranges"),
    ):
        answer = bench.ask(*hostile(kind, how), f"output={kind}_{how}", code=1, says=(f"{kind}=hostile (hostile.py", says))
        row = answer.row(f"{kind}_{how}")
        assert row["status"] == "failed" and says in row["reason"]
        assert answer.spent is not None and answer.spent.peak_mb < 500.0


def bad_company(bench: Bench) -> Any:
    """One sweep in which every job but two goes wrong in a way of its own."""
    how = "none,raise,os_exit,kill,segfault,spin,leak"
    return bench.process(
        "-m",
        *FAULTY,
        f"odometry.how={how}",
        "output=s",
        "--jobs",
        "2",
        "--timeout",
        "12",
        code=3,
        says="5 of 7 jobs did not end well",
    )


@fault("P05", "a plugin loops for ever, or sleeps for an hour", "3; the row says timeout, the others are done")
def plugin_hangs(bench: Bench) -> None:
    answer = bench.once(bad_company)
    row = answer.rows()["odometry.how=spin"]
    assert row["status"] == "timeout" and "took longer than the 12 s of --timeout" in row["reason"]
    assert answer.rows()["odometry.how=none"]["status"] == "ok"


@fault("P06", "a plugin calls sys.exit or os._exit", "1 (3 in a sweep); a failed row, also for exit code 0")
def plugin_exits(bench: Bench) -> None:
    for how, code in (("os_exit", 3), ("os_exit_zero", 0)):
        answer = bench.ask(
            *FAULTY, f"odometry.how={how}", f"output={how}", code=1, says=f"a part ended the process by os._exit({code})"
        )
        assert answer.row(how)["status"] == "failed" and len(answer.steps("index", how)) == 2
    row = bench.once(bad_company).rows()["odometry.how=os_exit"]
    assert row["status"] == "failed" and "os._exit(3) at step 2" in row["reason"]


@fault(
    "P07",
    "a plugin segfaults, or its process is killed",
    "3; the row says killed and by what; alone: killed, for every tool",
)
def plugin_crashes(bench: Bench) -> None:
    rows = bench.once(bad_company).rows()
    for how, reason in (("kill", "SIGKILL"), ("segfault", "SIGSEGV")):
        assert rows[f"odometry.how={how}"]["status"] == "killed" and reason in rows[f"odometry.how={how}"]["reason"]
    assert [rows[f"odometry.how={how}"]["status"] for how in ("none", "leak")] == ["ok", "ok"]
    bench.ask(*FAULTY, "odometry.how=kill", "output=run", code=-9)
    told = bench.ask("table", "run", "--rows", code=0).out
    assert "killed" in told
    assert "steps from" in bench.ask("recover", "run", code=0).out


@fault(
    "P08",
    "a plugin leaks memory and open files, job after job",
    "0; memory and open files of the sweep stay within 10 %",
    not_tried="200 jobs: tests/benchmarks/hundred_jobs.py runs 100 hostile ones; here are 30",
)
def plugin_leaks(bench: Bench) -> None:
    process = bench.start(
        "-m", *PLAN, *HOSTILE, "planner=hostile", "planner.how=leak", "seed=range(30)", "output=s", "--jobs", "1"
    )
    held: list[tuple[int, int, int]] = []

    def over() -> bool:
        done = len(list(bench.folder.glob("s/*/row.json")))
        if done and process.poll() is None and (not held or held[-1][0] != done):
            try:
                files = len(os.listdir(f"/proc/{process.pid}/fd"))
                held.append((done, files, int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])))
            except (OSError, IndexError):
                pass
        return process.poll() is not None

    bench.wait(over, 200.0)
    answer = bench.ends(process, 3, says="30 of 30 jobs did not do all that was asked")
    ended = {(row["status"], row["reason"]) for row in answer.rows().values()}
    assert ended == {("ok", "")}  # that went well, and found no valid path
    middle, late = ([one for one in held if low <= one[0] < low + 10] for low in (5, 20))
    for column in (1, 2):
        assert max(one[column] for one in late) <= 1.1 * max(one[column] for one in middle), held


@fault("P09", "a plugin seeds the global random generators anew", "0; no number of another part changes")
def plugin_reseeds(bench: Bench) -> None:
    rows = [bench.ask(*FAULTY, f"odometry.how={how}", f"output={how}", code=0, says=says).row(how)
            for how, says in (("none", ""), ("reseed", "global generator was used"))]
    for name in ("end_error_m", "ate_rmse_m", "path_length_m", "places_visited"):
        assert rows[0][name] == rows[1][name] is not None


@fault("P10", "two plugins of one name; a plugin for a newer program", "2; both origins, both versions")
def same_name_twice(bench: Bench) -> None:
    site = distribution(bench, "other", "[rhs.planner]\nfake = other:Other\n", other="")
    bench.ask(*FAKE, says=("planner=fake", "rhs-fakes 0.1", "other 1.0"), site=site)
    bench.ask(*FAKE, "planner=newer", says="was written for plugin API 99; this rhs has 1")


@fault(
    "P11",
    "a plugin writes into the observation, the map, or the map it is judged on",
    "1 with the plugin's ValueError, or 0 and no number changes; the judge keeps its own map",
)
def plugin_writes_into_its_input(bench: Bench) -> None:
    bench.ask(*FAULTY, "odometry.how=mutate", "output=run", code=1, says="read-only")
    rows = [
        bench.ask(*parts(localiser=name), "source.views=4", *LIGHT, f"output={name}", code=0).row(name)
        for name in ("fake", "vandal")
    ]
    for name in ("end_error_m", "ate_rmse_m", "path_length_m", "places_visited", "map_agreement"):
        assert rows[0][name] == rows[1][name]
    answer = bench.ask(
        *PLAN, *HOSTILE, "planner=hostile", "planner.how=map", "output=forged", code=3, says="not achieved: invalid"
    )
    assert answer.row("forged")["plan_valid"] == 0.0
