"""What whole patrols report of things that were moved or taken away: told, missed, and told where nothing changed.

    python -m rhs -m world=random:home+moved 'seed=range(5)' mission.look_m=0.5 pictures=on recording=off output=runs/moved
    python tests/benchmarks/moved_things.py runs/moved

A thing's old stand (gone) and its new one (new) are to be told. By a patrol's report (changes.json) one is told where a mark
lies within 0.4 m of its outline; a mark further than that from every such outline is false. A stand that the robot never had
in view cannot be told: `seen` counts those that lay, whole and past all else in the world, in some true view of the patrol.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from shared import write

from rhs.api.floorplan import Box, World, after, distance_m
from rhs.api.geometry import camera_from_fov, inverse, se2, transform
from rhs.base.provenance import commit
from rhs.reports.intervals import share_text
from rhs.runfolder.row import read_row
from rhs.worlds.world import load_world

NEAR_M = 0.4  # of an outline, a mark on it
SIGHT_M = 0.04  # round the line of sight, free
FAR_M = 3.5  # beyond it nothing is compared


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of a sweep")
    folder = parser.parse_args().folder
    rows = [row for path in sorted(folder.glob("*/changes.json")) for row in judged(path.parent)]
    if not rows:
        sys.stderr.write(f"no patrol with moved things and a changes.json in {folder}; type pictures=on\n")
        return 1
    write(folder / "moved_things.csv", rows)
    for what in ("gone", "new"):
        mine = [row for row in rows if row["what"] == what]
        seen = [row for row in mine if row["seen"]]
        sys.stdout.write(f"{what}: told {sum(row['told'] for row in mine)} of {len(mine)}; of those seen "
                         f"{sum(row['told'] for row in seen)} of {len(seen)} "
                         f"{share_text([row['told'] for row in seen]) if seen else ''}\n")
    patrols = {(row["building"], row["seed"]): row["false"] for row in rows}
    sys.stdout.write(f"told where nothing changed: {sum(patrols.values())} marks in {sum(map(bool, patrols.values()))} of "
                     f"{len(patrols)} patrols\ncommit: {commit()}\n")
    return 0


def judged(folder: Path) -> Iterator[dict[str, Any]]:
    """A row for each stand of a thing that changed."""
    row = read_row(folder / "row.json")
    world = load_world(str(row["world"]), seed=int(row["seed"]))
    stands = list(changed(world))
    marks = [change["at_m"][:2] for picture in json.loads((folder / "changes.json").read_text())
             for change in picture["changes"]]
    gaps = np.array([[gap_m(box, np.array(mark)) for mark in marks] for _, box, _ in stands])
    gaps = gaps.reshape(len(stands), len(marks))
    with (folder / "steps.csv").open(newline="") as file:
        views = [se2(*(float(step[f"true_{name}"]) for name in ("x_m", "y_m", "yaw_rad"))) for step in csv.DictReader(file)
                 if step["phase"] == "patrol"]
    for (what, box, then), away in zip(stands, gaps, strict=True):
        yield {"building": row["world"], "seed": row["seed"], "thing": box.name, "what": what,
               "seen": int(any(in_view(then, box, view) for view in views)), "told": int((away < NEAR_M).any()),
               "false": int((gaps.min(axis=0) >= NEAR_M).sum())}


def changed(world: World) -> Iterator[tuple[str, Box, World]]:
    """(gone or new, the box, the world in which it stands there) of what was moved or taken away."""
    later = after(world)
    old, new = ({box.name: box for box in one.boxes} for one in (world, later))
    for name, *_ in world.changes.moved:
        yield "gone", old[name], world
        yield "new", new[name], later
    for name in world.changes.removed:
        yield "gone", old[name], world


def gap_m(box: Box, point_m: np.ndarray) -> float:
    """From a point to the box's outline; 0 inside."""
    c, s = np.cos(box.yaw_rad), np.sin(box.yaw_rad)
    x, y = point_m - box.centre_m
    local = np.array([c * x + s * y, c * y - s * x])
    return float(np.hypot(*np.maximum(np.abs(local) - 0.5 * np.array(box.size_m[:2]), 0.0)))


def in_view(world: World, box: Box, map_from_body: np.ndarray) -> bool:
    """All corners in a picture of 57 degrees, and the middle seen past all else in the world."""
    if np.hypot(*(box.centre_m - map_from_body[:2, 3])) > FAR_M:
        return False
    camera = camera_from_fov(320, 240, 57.0, height_m=world.camera_height_m, pitch_deg=world.camera_pitch_deg)
    corners = np.array([[x, y, z] for x, y in box.corners_m for z in (0.0, box.size_m[2])])
    seen = transform(inverse(map_from_body @ camera.body_from_camera), corners)
    pixels = camera.project(seen)
    if not (seen[:, 2] > 0.0).all() or not ((pixels >= 0) & (pixels <= (319, 239))).all():
        return False
    others = replace(world, boxes=tuple(one for one in world.boxes if one.name != box.name))
    sight = map_from_body[:2, 3] + np.linspace(0.0, 1.0, 100)[:, None] * (box.centre_m - map_from_body[:2, 3])
    return all(distance_m(others, point)[0] > SIGHT_M for point in sight)


if __name__ == "__main__":
    sys.exit(main())
