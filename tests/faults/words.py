"""C01 to C12: what is typed or written down wrongly is refused before anything runs."""

from __future__ import annotations

from pathlib import Path

from faults.bench import LIGHT, Bench, parts
from faults.catalogue import fault
from faults.files import MAP, REPLAY, drive, pgm, seen, tum

FAKE = parts()
PLAN = ["task=planning", "planner=astar", *LIGHT]
WORLDS = Path(__file__).resolve().parents[2] / "worlds"


def experiment(bench: Bench, text: str | bytes) -> list[str]:
    """An experiment file e.yaml that says this; the words that ask for it."""
    head = "# @package _global_\n"
    bench.file("experiment/e.yaml", head + text if isinstance(text, str) else text)
    return [*FAKE, *LIGHT, "--config-dir", ".", "experiment=e"]


@fault("C01", "misspelt key, at the top level and nested", "2, names the key and the nearest valid one")
def misspelt_key(bench: Bench) -> None:
    bench.ask(*FAKE, "sed=3", says="unknown key sed; did you mean seed?")
    bench.ask(*FAKE, "planner.samles=3", says="unknown key planner.samles; did you mean planner.samples?")
    bench.ask("localiser=particle_filter", "localiser.partcles_min=5", says="did you mean localiser.particles_min?")


@fault("C02", "misspelt key under `hydra.`", "2, the same")
def misspelt_hydra_key(bench: Bench) -> None:
    bench.ask(*FAKE, "hydra.ouput_subdir=x", says="did you mean hydra.output_subdir?")


@fault("C03", "unknown plugin in a config group", "2, names the nearest and lists what there is")
def unknown_plugin(bench: Bench) -> None:
    bench.ask(*FAKE, "planner=fak", says=("there is no such planner; did you mean fake?", "(there is astar"))
    bench.ask(*FAKE, "experiment=nothing_like_it", says="there is no such experiment (there is")


@fault("C04", "number of particles negative, 0, 1e9, 906970164", "2, key, value and range; nothing is allocated")
def number_out_of_range(bench: Bench) -> None:
    for value in ("-5", "0", "1000000000", "906970164"):
        bench.ask(
            "localiser=particle_filter",
            f"localiser.particles_min={value}",
            says=(f"localiser.particles_min={value} is outside the allowed range [",),
        )


@fault("C05", "resolution 0, negative, nan, inf; a map of negative size", "2, the range; no division by zero, no hang")
def resolution_out_of_range(bench: Bench) -> None:
    for value in ("0", "-0.1", "nan", "inf"):
        bench.ask(
            f"mapper.resolution_m={value}",
            says=("mapper.resolution_m=", "is outside the allowed range [0.01, 2] m"),
        )
    for value in ("0", "-0.1", ".nan", ".inf"):
        bench.file("m.yaml", MAP.format(resolution=value))
        bench.file("m.pgm", pgm(["...", "...", "..."]))
        bench.ask(*PLAN, "world=m.yaml", "start=[1,1]", "goal=[2,2]", says="resolution")
    bench.file("m.yaml", MAP.format(resolution=1))
    bench.file("m.pgm", pgm(["...", "...", "..."], claims=(3, -20)))
    bench.ask(*PLAN, "world=m.yaml", "start=[1,1]", "goal=[2,2]", says="m.pgm")


@fault("C06", "extent and resolution each legal, too many cells together", "2, the number of cells and the memory they take")
def too_many_cells(bench: Bench) -> None:
    tum(bench.folder / "tum", *seen(drive(2)))
    bench.ask(
        *REPLAY,
        "source.extent_m=1000",
        "mapper.resolution_m=0.01",
        says=("200004 x 200004 cells", "takes 149.0 GB", "expected at most 50000000 cells"),
    )


@fault(
    "C07", "the same bad value from YAML, typed, in a sweep and in a config.yaml that is run again", "2, in the same words"
)
def one_value_four_ways(bench: Bench) -> None:
    says = "planner.fake.samples=-5 is outside the allowed range [1, 1000000]"
    typed = bench.ask(*FAKE, "planner.samples=-5", says=says)
    swept = bench.ask("-m", *FAKE, "planner.samples=5,-5", says=says)
    assert typed.err == swept.err
    written = bench.ask(*experiment(bench, "planner:\n  samples: -5\n"), says=says)
    assert written.err.endswith(f"e.yaml:3: {typed.err.removeprefix('rhs: ')}")
    bench.ask(*FAKE, *LIGHT, "source.views=2", "output=run", code=0)
    config = bench.folder / "run" / "config.yaml"
    config.write_text(config.read_text().replace("samples: 100", "samples: -5"))
    bench.ask("verify", "run", says=says)


@fault("C08", "YAML traps: `no`, `012`, `12:30`, `1e3` for a whole number", "2, or the text that stands there")
def yaml_traps(bench: Bench) -> None:
    for text, says in (
        ("planner:\n  smooth: no\n", "e.yaml:3: planner.smooth=no: expected bool"),
        ("planner:\n  samples: 012\n", "e.yaml:3: planner.samples=012: expected int"),
        ("seed: 12:30\n", "e.yaml:2: seed=12:30: expected int"),
        ("seed: 1e3\n", "e.yaml:2: seed=1000.0: expected int"),
    ):
        bench.ask(*experiment(bench, text), says=says)
    for word in ("no", "012", "12:30"):
        answer = bench.ask(*experiment(bench, f"planner:\n  mode: {word}\n"), "--cfg", code=0)
        assert f"mode: {word}\n" in answer.out.replace("'", "")


@fault(
    "C09",
    "YAML with a key twice, tabs, cut off, empty, aliases; byte order mark, CRLF",
    "2, file and line; byte order mark and CRLF change nothing",
)
def broken_yaml(bench: Bench) -> None:
    aliases = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
        f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 9)
    )
    for text, says in (
        ("seed: 1\nseed: 2\n", "e.yaml:3: the key 'seed' stands twice"),
        ("planner:\n\tsamples: 1\n", "(indent with spaces, not tabs)"),
        ("planner: {samples: 1\n", "e.yaml:"),
        (aliases, "aliases"),
        ("world: &a [*a]\n", "aliases"),
        ("obstacles: " + "[" * 3000 + "]" * 3000 + "\n", "nested more deeply"),
        ("seed: " + "9" * 5000 + "\n", "5000 digits"),
    ):
        bench.ask(*experiment(bench, text), says=says)
    bench.file("w.yaml", "")
    bench.ask(*PLAN, "world=w.yaml", says="w.yaml")
    plain = bench.ask(*experiment(bench, "seed: 7\n"), "--cfg", code=0)
    for text in ("\ufeff# @package _global_\nseed: 7\n", "# @package _global_\r\nseed: 7\r\n"):
        assert bench.ask(*experiment(bench, text.encode()), "--cfg", code=0).out == plain.out


@fault(
    "C10", "a value that is missing, a group that is missing, an interpolation in a circle", "2, the key and what to type"
)
def missing_value(bench: Bench) -> None:
    bench.ask(*FAKE, "world=???", says="world has no value; give it one on the command line: world=VALUE")
    bench.ask(*FAKE, "seed=${seed}", says="seed=${seed}: an interpolation that refers to itself; write the value out")
    bench.ask(*FAKE, "planner.samples=${nowhere}", says="planner.samples=${nowhere}: Interpolation key 'nowhere' not found")
    bench.ask(*FAKE, "planner=null", says="there is no such planner")


@fault("C11", "a world file that is missing, or malformed", "2, the path and what is wrong; in a sweep only that job")
def missing_world(bench: Bench) -> None:
    bench.ask(*FAKE, "world=nowhere", says="world=nowhere is neither a world nor a path")
    bench.file("w.yaml", (WORLDS / "square_small.yaml").read_text().replace("walls:", "walls: 7\nwals:", 1))
    bench.ask(*FAKE, "world=w.yaml", says="w.yaml")
    answer = bench.ask(
        "-m",
        *FAKE,
        *LIGHT,
        "world=square_small,nowhere",
        "source.views=2",
        "output=s",
        code=3,
        says="1 of 2 jobs did not end well",
    )
    assert {name: row["status"] for name, row in answer.rows().items()} == {
        "world=square_small": "ok",
        "world=nowhere": "refused",
    }


@fault("C12", "start or goal in a wall, outside the map, NaN", "2, or 3 and a row with the reason")
def start_in_a_wall(bench: Bench) -> None:
    rows = ["#" * 20, *["#" + "." * 18 + "#"] * 18, "#" * 20]
    bench.file("m.yaml", MAP.format(resolution=0.5))
    bench.file("m.pgm", pgm(rows))
    for number, (start, goal, reason) in enumerate(
        (
            ("[0.2,0.2]", "[5,5]", "start_blocked"),
            ("[5,5]", "[9.8,9.8]", "goal_blocked"),
            ("[50,5]", "[5,5]", "outside_map"),
            ("[5,5]", "[5,-50]", "outside_map"),
        )
    ):
        answer = bench.ask(
            *PLAN,
            "world=m.yaml",
            f"start={start}",
            f"goal={goal}",
            f"output=r{number}",
            code=3,
            says=f"not achieved: {reason}",
        )
        row = answer.row(f"r{number}")
        assert (row["status"], row["success"], row["plan_reason"]) == ("ok", 0.0, reason)
    bench.ask(*PLAN, "world=m.yaml", "start=[nan,1]", "goal=[5,5]", says="expected 2 finite numbers")
    square = (WORLDS / "square_small.yaml").read_text()
    start = next(line for line in square.splitlines() if line.startswith("start:"))
    bench.file("w.yaml", square.replace(start, "start: [1000.0, 0.0, 0.0]"))
    bench.ask(*FAKE, "world=w.yaml", says="w.yaml")
