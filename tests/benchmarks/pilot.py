"""The pilot alone: patrols in random buildings whose robot is told nearly where it is, for a tenth of the time.

    python tests/benchmarks/pilot.py --families office+obstacles+people --seeds 600-603 --out runs/pilot

Odometry and localiser are the truth with the error of the default chain put on (2 mm and 0.06 degrees a view; 1.2 cm and 0.3
degrees that come and go within ten views), pictures are 160 px wide. All else is an ordinary run: what goes wrong in it is
the pilot's doing. --boxes 8: so many boxes that the survey did not see in the place of one to three, for touches in plenty.
`reachable` as in buildings.py. Writes pilot.csv; a building whose run has a row is not run again.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from buildings import rows, table
from shared import write

import rhs.patrol.run
import rhs.worlds.random.building
from rhs.api.frozen import freeze
from rhs.api.geometry import inverse, planar, se2
from rhs.api.randomness import generator
from rhs.api.records import Belief, Motion, Tracking
from rhs.base.provenance import commit
from rhs.config.compose import compose_config
from rhs.worlds.random.names import FAMILIES
from rhs.worlds.random.obstacles import with_box

SURE, KNOWN = 1e-6 * np.eye(6), 1e-4 * np.eye(6)
STEP = np.array([0.002, 0.002, 0.001])  # of a motion, metres and radians
OFF, KEPT = np.array([0.012, 0.012, 0.005]), 0.9  # of the belief, and the share of it that is left a view later
WORDS = ("sensor=rgbd", "source.image_width=160", "odometry=procrustes", "gate.act=off", "places.every=100000",
         "recording=off", "pictures=off", "ahead=off")


class Told:
    """Odometry and localiser of one run; the survey's motions are the truth."""

    keeps_moving, short_steps, scale_from = None, None, ""

    def __init__(self, source: Any, rng: np.random.Generator) -> None:
        self.source, self.rng, self.off = source, rng, np.zeros(3)
        self.last: np.ndarray | None = None
        self.patrols = False

    def update(self, observation: Any, motion: Motion | None = None) -> Any:
        truth = self.source.truth()
        if motion is not None:
            self.off = KEPT * self.off + np.sqrt(1.0 - KEPT**2) * self.rng.normal(size=3) * OFF
            return Belief(freeze(se2(*(planar(truth) + self.off))), KNOWN)
        step = np.eye(4) if self.last is None else inverse(self.last) @ truth
        self.last = truth
        return Motion(step @ se2(*(self.rng.normal(size=3) * STEP)) if self.patrols else step, SURE, Tracking.OK)

    def revise(self) -> None: ...

    def learn(self, views: Any, grid: Any) -> None:
        self.patrols = True

    def start(self, belief: Any) -> None: ...


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", default=[f"{family}+obstacles+people" for family in FAMILIES])
    parser.add_argument("--seeds", default="600", help="first-last, both included")
    parser.add_argument("--out", type=Path, default=Path("runs/pilot"))
    parser.add_argument("--boxes", type=int, default=0, help="that the survey did not see, where the family has any")
    parser.add_argument("words", nargs="*", help="key=value words of a run")
    options = parser.parse_intermixed_args()
    first, _, last = options.seeds.partition("-")
    built = rhs.patrol.run.build

    def build(*args: Any, **more: Any) -> Any:
        parts = built(*args, **more)
        told = Told(parts.source, generator(more["seed"], "told"))
        return replace(parts, odometry=told, localiser=told)

    def boxed(world: Any, rng: np.random.Generator) -> Any:
        for _ in range(options.boxes):
            world = with_box(world, rng)
        return world

    rhs.patrol.run.build = build
    if options.boxes:
        rhs.worlds.random.building.with_drawn_obstacles = boxed
    for seed in range(int(first), int(last or first) + 1):
        for family in options.families:
            folder = options.out / f"{family},seed={seed}"
            if not (folder / "row.json").exists():
                folder.mkdir(parents=True, exist_ok=True)
                words = [f"world=random:{family}", f"seed={seed}", *WORDS, *options.words]
                rhs.patrol.run.run_config(compose_config(words), folder)
                sys.stderr.write(f"{folder.name}\n")
    found = rows(options.out)
    write(options.out / "pilot.csv", found)
    sys.stdout.write("\n".join([*table(found), f"command: {' '.join(sys.argv)}", f"commit: {commit()}", ""]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
