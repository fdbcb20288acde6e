"""X01 to X07: data that wants to be code, names that lead elsewhere, archives, formulas, secrets."""

from __future__ import annotations

import json
import pickle
import zipfile

from faults.bench import LIGHT, Bench, parts
from faults.catalogue import fault
from faults.files import REPLAY, drive, seen, tum
from faults.words import WORLDS, experiment

FAKE = parts()
CODE = "!!python/object/apply:os.system ['touch canary']"


def untouched(bench: Bench) -> None:
    assert not list(bench.home.rglob("canary"))[1:], "code in a file of data was run"


@fault("X01", "`!!python/object/apply` in an experiment, a world, a map, a run's config", "2, file and line; nothing runs")
def code_in_yaml(bench: Bench) -> None:
    bench.ask(*experiment(bench, f"planner:\n  mode: {CODE}\n"), says=("e.yaml:3", "asks for a Python object"))
    bench.file("w.yaml", f"name: {CODE}\n")
    bench.ask(*FAKE, "world=w.yaml", says="w.yaml:1")
    bench.file("m.yaml", f"image: {CODE}\nresolution: 1\norigin: [0, 0, 0]\n")
    bench.ask("task=planning", "world=m.yaml", says="m.yaml:1")
    bench.ask(*FAKE, *LIGHT, "source.views=2", "output=run", code=0)
    (bench.folder / "run" / "config.yaml").write_text(f"task: {CODE}\n")
    bench.ask("verify", "run", says="config.yaml:1")
    untouched(bench)


@fault("X02", "`_target_: os.system` and its like", "2, unknown key; only plugins are built")
def named_code(bench: Bench) -> None:
    for word in (
        "planner._target_=os.system",
        "+planner._target_=pathlib.Path.unlink",
        "_target_=pandas.read_pickle",
        "planner={_target_: os.system}",
    ):
        bench.ask(*FAKE, word, says="unknown key")
    bench.ask(*experiment(bench, "planner:\n  _target_: os.system\n"), says="unknown key")
    bench.ask(*FAKE, *LIGHT, "-m", "seed=0,1", "source.views=2", "output=s", code=0)
    path = bench.folder / "s" / "sweep.json"
    evil = json.loads(path.read_text()) | {"plugins": [str(bench.file("evil.py", "open('canary', 'w')"))]}
    path.write_text(json.dumps(evil))
    bench.ask("--resume", "s", code=0)
    untouched(bench)


@fault("X03", "pickles where data are expected", "1, 2 or 3, said to be no such file; never read as a pickle")
def pickles(bench: Bench) -> None:
    class Evil:
        def __reduce__(self):
            return __import__("os").system, ("touch canary",)

    data = pickle.dumps(Evil())
    for name in ("x.mcap", "x.yaml", "x.tum", "x.map", "x.pgm", "s/a/row.json"):
        bench.file(name, data)
    bench.ask("x.mcap", "out.mcap", module="rhs.convert", code=1, says="x.mcap")
    bench.ask("x.tum", "x.tum", module="rhs.evaluate", code=(1, 2), says="x.tum")
    for name in ("x.yaml", "x.map"):
        bench.ask("task=planning", f"world={name}", says=name)
    bench.ask("table", "s", code=2, says="none of 1 row.json under s can be read")
    untouched(bench)


@fault(
    "X04",
    "names of places, jobs and files with `../`, absolute, or links that lead out",
    "2, or contained in the output folder",
)
def names_that_lead_elsewhere(bench: Bench) -> None:
    text = (WORLDS / "square_small.yaml").read_text()
    for name in ("../../x", "/tmp/x", "a/b", ".."):
        bench.file("w.yaml", text.replace("first_corridor:", f'"{name}":', 1))
        bench.ask(*FAKE, "world=w.yaml", says="w.yaml:")
    bench.ask(*FAKE, "planner=../planner/fake", says="there is no such planner")
    answer = bench.ask("-m", *FAKE, *LIGHT, "source.views=2", "planner.mode='../../x','/etc/passwd'", "output=s", code=0)
    assert len(answer.rows()) == 2
    tum(bench.folder / "tum", *seen(drive(2)))
    bench.file("tum/rgb.txt", "0.0 ../../etc/passwd\n")
    bench.ask(*REPLAY, says="leads out of the recording")


@fault(
    "X05", "an archive with `../` members, or of 10 GB unpacked, as a recording", "2, unpack it first; it is never opened"
)
def archives(bench: Bench) -> None:
    with zipfile.ZipFile(bench.folder / "x.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("../canary", "out")
        archive.writestr("zeros", bytes(50_000_000))
    bench.ask("task=survey", "source=replay", "source.path=x.zip", says="found an archive; unpack it first")
    bench.ask("x.zip", "out.mcap", module="rhs.convert", says="x.zip")
    untouched(bench)


@fault(
    "X06", "formulas in cells, scripts and escape sequences in names", "0; escaped in tables, reports and on the terminal"
)
def formulas_and_scripts(bench: Bench) -> None:
    for number, text in enumerate(("=cmd|'/C calc'!A0", "<script>alert(1)</script>", "\x1b]0;owned\x07")):
        row = {
            "status": "ok",
            "reason": "",
            "task": "survey",
            "world": text,
            "planner": "p",
            "seed": number,
            "ate_rmse_m": 0.5,
        }
        bench.file(f"s/{number}/row.json", json.dumps(row))
    answer = bench.ask("table", "s", "--csv", "t.csv", code=0)
    assert "\x1b" not in answer.out
    assert ",=cmd" not in (bench.folder / "t.csv").read_text() and not (bench.folder / "t.csv").read_text().startswith("=")
    bench.ask("report", "s", code=0)
    assert "<script>alert" not in next((bench.folder / "s").glob("*.html")).read_text()


@fault("X07", "a secret in the environment", "0; nothing of it in any file of the run")
def secrets(bench: Bench) -> None:
    bench.ask(
        *FAKE, "source.views=2", "pictures=off", "recording=full", "output=run", code=0, MY_SECRET_TOKEN="s3cr3t-value"
    )
    for path in (bench.folder / "run").rglob("*"):
        assert path.is_dir() or b"s3cr3t-value" not in path.read_bytes(), path
