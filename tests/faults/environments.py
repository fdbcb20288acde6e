"""E01 to E05: no display, a renderer that draws nothing, missing libraries, little of everything, older files."""

from __future__ import annotations

import json
import resource

from faults.bench import LIGHT, Bench, parts
from faults.catalogue import fault

from rhs.runfolder.row import canonical_hash

FAKE = [*parts(), "source.views=4", *LIGHT, "output=run"]


@fault("E01", "no display, no EGL, no GPU", "0; the software renderer, and the row says so")
def no_display(bench: Bench) -> None:
    words = [
        "task=survey",
        "world=" + json.dumps(str(bench.golden / "room.yaml")),
        "source.image_width=80",
        "source.step_m=0.8",
        *LIGHT,
        "odometry=procrustes",
        "loop_closer=none",
        "output=run",
    ]
    answer = bench.ask(
        *words, code=(0, 3), says=None, DISPLAY="", WAYLAND_DISPLAY="", CUDA_VISIBLE_DEVICES="", EGL_PLATFORM="none"
    )
    assert answer.row()["renderer"] == "raster" and answer.row()["status"] == "ok"


@fault(
    "E02",
    "the renderer draws one flat colour",
    "1, before the first view; which world, which renderer to try",
    not_tried="a renderer that is broken: the simulator is shown a wall without paintings and joints instead",
)
def flat_picture(bench: Bench) -> None:
    bench.file("w.yaml", FLAT)
    answer = bench.ask(
        "task=survey",
        "world=w.yaml",
        *LIGHT,
        "source.image_width=80",
        "source.hfov_deg=20",
        "source.texture_px_per_m=10",
        "output=run",
        code=1,
        says="draws one flat colour",
    )
    assert answer.row()["status"] == "failed"


FLAT = """start: [3.55, 3.0, 0.0]
robot_radius_m: 0.3
camera_height_m: 1.2
route_m: [[3.55, 3], [3.4, 3]]
places: {near: [3.2, 3.0]}
paintings: {density: 0}
walls:
  - name: outer
    points_m: [[0, 0], [4, 0], [4, 6], [0, 6], [0, 0]]
    surface: {roughness: 0, colour: [0, 0, 0]}
    blanks: [{segment: 1, from_m: 0, to_m: 6}]
seed: 1
"""


@fault("E03", "an optional library is absent", "2 if chosen, with the command that installs it; listed, all others run")
def absent_library(bench: Bench) -> None:
    bench.ask(
        *parts(planner="wanting"), says="needs a package that is not installed; type: pip install some-planning-library"
    )
    assert "NOT USABLE" in bench.ask("planner=wanting", "--help", code=0).out
    bench.ask(*FAKE, code=0)


@fault("E04", "little memory, few open files, another locale, time zone and home", "0 and the same row, or 1 in one line")
def little_of_everything(bench: Bench) -> None:
    plain = bench.ask(*FAKE, code=0).row()
    for number, (limits, more) in enumerate(
        (
            ({"RLIMIT_NOFILE": 64}, {}),
            ({}, {"LC_ALL": "de_DE.UTF-8", "TZ": "Pacific/Kiritimati"}),
            ({}, {"HOME": "/proc/no home", "LANG": "tr_TR.UTF-8"}),
        )
    ):
        answer = bench.ask(*FAKE, "overwrite=true", code=0, limits=limits, **more)
        assert canonical_hash(answer.row()) == canonical_hash(plain), number

    def little_memory() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    answer = bench.process(*FAKE, "overwrite=true", code=(0, 1), says=None, limit=little_memory)
    assert answer.code == 1 or canonical_hash(answer.row()) == canonical_hash(plain)


@fault("E05", "rows and recordings of older versions", "0 what can be read; 1, 2 or 3 and what is missing")
def older_files(bench: Bench) -> None:
    bench.file("s/old/row.json", '{"status": "ok", "world": "w", "planner": "prm", "seed": 1}')
    bench.file(
        "s/new/row.json", '{"status": "ok", "world": "w", "planner": "prm", "seed": 2, "ate_rmse_m": 0.5, "future_m": 3.0}'
    )
    assert "prm" in bench.ask("table", "s", "--rows", code=0).out
    bench.file("s/sweep.json", '{"jobs": []}')
    bench.ask("--resume", "s", says="sweep.json cannot be read as a sweep")
    bench.file("run/config.yaml", "world: square\nodometry: sift\n")
    bench.file("run/row.json", '{"status": "ok"}')
    bench.ask("verify", "run", code=(2, 3), says="")
