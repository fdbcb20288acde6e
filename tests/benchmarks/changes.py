"""How often a thing of 0.3 m put or taken away near a place is marked, and how often something is where nothing changed.

    python tests/benchmarks/changes.py --buildings 0-19 --family home

In each building the camera is led round the survey, then put beside each place (within 0.1 m, 15 degrees of the survey's
heading there) for one picture per trial. What is compared is what a patrol keeps; the poses are wrong by 3 cm and 1 degree
(1 sigma, each picture by itself), as a belief is. Trials: same, same in other light (0.6 times as bright, a lamp on one
side), a box of 0.3 m put in view, a box of 0.3 m taken away. A box counts as marked when a mark lies within 0.4 m of its
middle.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import Context, SourceContext
from rhs.api.floorplan import Box, Changes, Light, World, distance_m, truth_grid
from rhs.api.geometry import camera_from_fov, inverse, planar, se2, transform
from rhs.api.records import FeatureSettings, Observation, Twist
from rhs.config import registry
from rhs.estimation.views.changes import Change, compare
from rhs.estimation.views.features import features
from rhs.estimation.views.references import Reference, registered, small
from rhs.estimation.views.view_pose import Snapshot
from rhs.worlds.world import load_world

SIZE_M, MARKED_M, OFF_M, APART_M = 0.3, 0.4, 0.1, 0.8
BELIEF_M, BELIEF_RAD = 0.03, np.radians(1.0)
DIM = Light(0.6, 0.7)
MORE = 10  # stands on the survey's way besides the places
EVERY = 3  # views of the survey


class Place:
    """Where a picture is taken, and the thing that is put in its view or taken out of it."""

    def __init__(self, name: str, stand: np.ndarray, thing: Box | None) -> None:
        self.name, self.stand, self.thing = name, stand, thing


def places_of(world: World, route: list[np.ndarray], rng: np.random.Generator) -> list[Place]:
    """Each place of the world: a stand near it, and a box in view of it that stands clear of everything and of the way."""
    out: list[Place] = []
    spots = [*world.places, *((f"way {k}", *route[k][:2]) for k in sorted(rng.choice(len(route), MORE, replace=False)))]
    for name, x, y in spots:
        nearest = min(route, key=lambda pose: float(np.hypot(pose[0] - x, pose[1] - y)))
        stand = nearest + np.append(rng.normal(0, OFF_M, 2), rng.normal(0, np.radians(15)))
        if distance_m(world, stand[:2])[0] < world.robot_radius_m:
            stand = nearest
        thing = _thing(world, route, stand, len(out), rng)
        world = world if thing is None else replace(world, boxes=(*world.boxes, thing))
        out.append(Place(name, stand, thing))
    return out


def _thing(world: World, route: list[np.ndarray], stand: np.ndarray, number: int, rng: np.random.Generator) -> Box | None:
    grid = truth_grid(world)
    for _ in range(200):
        bearing, away = stand[2] + rng.uniform(-0.4, 0.4), rng.uniform(0.8, 3.5)
        middle = stand[:2] + away * np.array([np.cos(bearing), np.sin(bearing)])
        row, column = grid.cells(middle[None])[0]
        if not (0 <= row < grid.shape[0] and 0 <= column < grid.shape[1]) or grid.probability[row, column] != 0.0:
            continue
        off_route = min(float(np.hypot(*(pose[:2] - middle))) for pose in route)
        box = Box(f"thing {number}", (float(middle[0]), float(middle[1])), (SIZE_M,) * 3, float(rng.uniform(0, 1.5)))
        gap_m, nearest = distance_m(world, middle)
        apart = gap_m > 0.22 + (APART_M if "thing" in nearest else 0.0)
        if not (apart and off_route > world.robot_radius_m + 0.22 and _in_picture(world, box, stand)):
            continue
        sight = stand[:2] + np.linspace(0, 1, 100)[:, None] * (middle - stand[:2])
        if all(distance_m(world, point)[0] > 0.04 for point in sight):
            return box
    return None


def _in_picture(world: World, box: Box, stand: np.ndarray) -> bool:
    """All corners of the box fall into the picture."""
    camera = camera_from_fov(320, 240, 57.0, height_m=world.camera_height_m)
    corners = np.array([[x, y, z] for x, y in box.corners_m for z in (0.0, box.size_m[2])])
    pixels = camera.project(transform(inverse(se2(*stand) @ camera.body_from_camera), corners))
    return bool(((pixels >= 0) & (pixels <= (319, 239))).all())


class Eye:
    """Simulator and sensor of one world."""

    def __init__(self, world: World, folder: Path, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        given = SourceContext(self.rng.spawn(1)[0], world, folder)
        self.source = registry.load("source", "simulator")().build(given)
        context = Context(self.rng.spawn(1)[0], self.source.camera, world.facts(), folder, FeatureSettings())
        self.sensor = registry.load("sensor", "rgbd")().build(context)

    def reference(self, seen: Observation) -> Reference:
        """What a patrol keeps of a view, at a pose as wrong as a belief."""
        truth = planar(self.source.truth())
        pose = se2(*(truth + np.append(self.rng.normal(0, BELIEF_M, 2), self.rng.normal(0, BELIEF_RAD))))
        return Reference(small(seen.image, seen.depth, camera=seen.camera, map_from_body=pose),
                         Snapshot(features(seen, FeatureSettings()), seen.camera))

    def survey(self) -> list[Reference]:
        """Every third view."""
        kept, number = [], 0
        while (capture := self.source.lead()) is not None:
            if number % EVERY == 0:
                kept.append(self.reference(self.sensor.sense(capture)))
            number += 1
        return kept

    def look(self, stand: np.ndarray) -> Reference:
        """One picture on patrol."""
        self.source.stand = stand.copy()
        return self.reference(self.sensor.sense(self.source.drive(Twist(0.0, 0.0, 0.05))))


def marks(eye: Eye, before: list[Reference], stand: np.ndarray) -> list[Change] | None:
    """What is marked; None where no picture of the survey shows the same."""
    now = eye.look(stand)
    chosen = registered(now.sight, now.snapshot, before, rng=np.random.default_rng(0))
    return compare(now.sight, chosen) if chosen else None


def building(name: str, folder: Path, seed: int) -> list[dict[str, Any]]:
    """The trials of one building."""
    rng = np.random.default_rng([seed, 14])
    world = load_world(name)
    route = [np.array([w.x_m, w.y_m, w.yaw_rad]) for w in Eye(world, folder, seed).source.views]
    places = places_of(world, route, rng)
    things = tuple(place.thing for place in places if place.thing is not None)
    bare, full = Eye(world, folder, seed), Eye(replace(world, boxes=world.boxes + things), folder, seed + 1)
    before, before_full = bare.survey(), full.survey()
    dim = Eye(replace(world, changes=Changes(light=DIM)), folder, seed + 2)
    dim.source.begin_patrol()
    rows = []
    for place in places:
        trials: list[tuple[str, Eye, list[Reference]]] = [("same", bare, before), ("other light", dim, before)]
        if place.thing is not None:
            trials += [("put", full, before), ("taken", bare, before_full)]
        for kind, eye, survey in trials:
            found = marks(eye, survey, place.stand)
            rows.append({"building": name, "place": place.name, "trial": kind, "compared": found is not None,
                         **judged(found or [], place.thing if kind in ("put", "taken") else None, things)})
    return rows


def judged(found: list[Change], thing: Box | None, things: tuple[Box, ...]) -> dict[str, Any]:
    """Whether the thing is marked, and how many marks lie elsewhere than on it or on the others that changed with it."""
    def at(change: Change, box: Box) -> bool:
        return bool(np.hypot(*(change.at_m[:2] - box.centre_m)) <= MARKED_M)

    boxes = things if thing is not None else ()
    others = [change for change in found if not any(at(change, box) for box in boxes)]
    return {"marked": thing is not None and any(at(change, thing) for change in found), "false": len(others),
            "what": "; ".join(f"{c.verdict} {c.size_m:.2f} m at {np.round(c.at_m, 2).tolist()}" for c in others)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buildings", default="0-4")
    parser.add_argument("--family", default="home")
    chosen = parser.parse_args()
    first, last = map(int, chosen.buildings.split("-"))
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, last + 1):
            rows += building(f"random:{chosen.family}+plain/{seed}", Path(folder), seed)
            for row in rows[-30:]:
                if row["building"].endswith(f"/{seed}"):
                    print(*row.values(), sep=" | ", flush=True)
    for kind in ("same", "other light", "put", "taken"):
        mine = [row for row in rows if row["trial"] == kind and row["compared"]]
        skipped = sum(row["trial"] == kind and not row["compared"] for row in rows)
        marked, wrong = sum(row["marked"] for row in mine), sum(row["false"] > 0 for row in mine)
        print(f"{kind:12} n={len(mine)} marked={marked} with false marks={wrong} not compared={skipped}")


if __name__ == "__main__":
    sys.exit(main())
