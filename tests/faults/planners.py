"""L01 to L07: goals out of reach, patrols without places, ways that are blocked, robots that are stuck, broken maps."""

from __future__ import annotations

import json

import numpy as np
from faults.bench import HOSTILE, LIGHT, Bench, hostile, parts
from faults.catalogue import fault
from faults.files import MAP, pgm, png
from faults.words import WORLDS

PLAN = ["task=planning", "world=m.yaml", *LIGHT]
SEALED = ["#" * 20, *["#" + "." * 9 + "#" + "." * 8 + "#"] * 18, "#" * 20]
OPEN = ["#" * 20, *["#" + "." * 18 + "#"] * 18, "#" * 20]


def plan_map(bench: Bench, rows: list[str], resolution: float = 0.5) -> None:
    bench.file("m.yaml", MAP.format(resolution=resolution))
    bench.file("m.pgm", pgm(rows))


def missions(bench: Bench, run: str) -> list[tuple[str, str]]:
    told = json.loads((bench.folder / run / "missions.json").read_text())
    return [(one["status"], one["reason"]) for one in told]


@fault("L01", "the goal cannot be reached: a sealed room", "3, `disconnected`; a patrol goes on to the next place")
def sealed_room(bench: Bench) -> None:
    plan_map(bench, SEALED)
    for planner in ("astar", "prm"):
        answer = bench.ask(
            *PLAN,
            f"planner={planner}",
            "start=[2,5]",
            "goal=[8,5]",
            "overwrite=true",
            "output=run",
            code=3,
            says="not achieved: disconnected",
        )
        assert answer.row()["plan_reason"] == "disconnected" and answer.row()["success"] == 0.0
    bench.ask(*hostile("planner", "sealed"), "output=patrol", code=3, says="not achieved: 1 of 2 places")
    assert missions(bench, "patrol") == [("gave_up", "no path: disconnected"), ("arrived", "")]


@fault(
    "L02", "start is goal; no place, one place, one place twice", "0, a path without length; every place visited, or none"
)
def start_is_goal(bench: Bench) -> None:
    plan_map(bench, OPEN)
    row = bench.ask(*PLAN, "planner=astar", "start=[5,5]", "goal=[5,5]", "output=run", code=0).row()
    assert row["plan_success"] == 1.0 and row["plan_length_m"] == 0.0
    text = (WORLDS / "square_small.yaml").read_text()
    places = text[text.index("places:") : text.index("walls:")]
    for name, written, code in (
        ("none", "places: {}\n", (0, 2)),
        ("one", "places:\n  home: [2, 1]\n", (0,)),
        ("twice", "places:\n  home: [2, 1]\n  again: [2, 1]\n", (0,)),
    ):
        bench.file(f"{name}.yaml", text.replace(places, written))
        bench.ask(*parts(), f"world={name}.yaml", *LIGHT, "source.views=4", f"output={name}_run", code=code, says=None)


@fault(
    "L03",
    "the start lies slightly inside a grown obstacle",
    "0, left by the nearest free cell, and told; 3 where none is near",
)
def start_in_the_shadow(bench: Bench) -> None:
    plan_map(bench, ["#" * 60, *["#" + "." * 58 + "#"] * 58, "#" * 60], 0.1)
    words = [*PLAN, "planner=astar", "planning.robot_radius_m=0.3", "goal=[4,4]"]
    row = bench.ask(*words, "start=[0.25,3]", "output=near", code=0).row("near")
    assert row["plan_valid"] == 1.0 and 0.0 < row["plan_start_moved_m"] <= 0.3
    bench.ask(*words, "start=[0.15,3]", "output=far", code=3, says="not achieved: start_blocked")


@fault("L04", "an unknown obstacle blocks the only way for ever", "3, the place is given up with a reason, in bounded time")
def blocked_for_ever(bench: Bench) -> None:
    answer = bench.ask(
        *HOSTILE,
        *parts(source="hostile", sensor="hostile", planner="astar"),
        "source.how=wall",
        "sensor.how=sealed_view",
        "source.views=4",
        *LIGHT,
        "output=run",
        code=3,
        says="not achieved: 0 of 2 places",
    )
    assert {status for status, _ in missions(bench, "run")} <= {"gave_up", "aborted"}
    assert all(reason for _, reason in missions(bench, "run")) and answer.row()["patrol_steps"] < 400


@fault("L05", "the place after one that was left out", "3; planned anew from where the robot is, free of collisions")
def place_after_a_place_left_out(bench: Bench) -> None:
    answer = bench.ask(*hostile("planner", "sealed"), "output=run", code=3, says="not achieved: 1 of 2 places")
    plans = json.loads((bench.folder / "run" / "plans.json").read_text())
    assert plans[0]["points_m"] == [] and plans[1]["reason"] == "ok"
    at = [float(answer.steps(name)[4]) for name in ("x_m", "y_m")]  # where the survey of four views left it
    assert np.linalg.norm(np.subtract(plans[1]["points_m"][0], at)) < 0.05 and answer.row()["collisions"] == 0


@fault("L06", "the robot is stuck: commands do not move it", "3, given up as `no progress`, or as touched and no way left")
def robot_is_stuck(bench: Bench) -> None:
    answer = bench.ask(*hostile("source", "stuck"), "output=run", code=3, says="not achieved: 0 of 2 places")
    words = ("no progress", "contact", "no path")
    told = missions(bench, "run")  # a place may be put off once, and is given up when it is tried again
    assert sorted(status for status, _ in told) in (["gave_up"] * 2, ["gave_up"] * 2 + ["skipped"])
    assert all(reason.startswith(words) for _, reason in told)
    assert answer.row()["patrol_steps"] < 100


@fault(
    "L07",
    "a map whose size is a lie, cut off, all unknown, or of 49 million cells",
    "2, found and expected; 3 where all is unknown",
)
def broken_map(bench: Bench) -> None:
    ends = ["planner=astar", "start=[2,5]", "goal=[8,5]"]
    plan_map(bench, OPEN)
    for content, says in ((pgm(OPEN, claims=(20, 40)), "m.pgm"), (pgm(OPEN)[:200], "m.pgm"), (b"", "m.pgm")):
        bench.file("m.pgm", content)
        bench.ask(*PLAN, *ends, says=says)
    bench.file("m.pgm", pgm(["?" * 20] * 20))
    bench.ask(*PLAN, *ends, "output=run", code=(2, 3), says="")
    bench.file("m.yaml", MAP.format(resolution=0.05).replace("m.pgm", "m.png"))
    bench.file("m.png", png(7000, 7000))
    bench.ask(*PLAN, *ends, says="7000 x 7000 cells")
    bench.file("m.map", f"type octile\nheight {'9' * 5000}\nwidth 5\nmap\n.....\n")
    bench.ask("task=planning", "world=m.map", *ends, says="height is '999")
