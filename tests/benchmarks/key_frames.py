"""When `keyframe` makes a key frame on a floor: `python tests/benchmarks/key_frames.py --buildings home:31 hall+people:38`.

The survey of each drawn building (FAMILY:SEED) is rendered and sensed once, and shown to an odometry with each rule
(advanced.floor_stretch:advanced.floor_settled) by turns, behind the gate and closed as in a run. Written for each:
key frames made, CPU ms a view of the odometry's thread, ATE in mm as reported, revised and closed, RPE, views lost.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

import numpy as np  # noqa: E402
from shared import write  # noqa: E402

from rhs.api.contracts import Context  # noqa: E402
from rhs.api.geometry import se2  # noqa: E402
from rhs.api.randomness import generator  # noqa: E402
from rhs.api.records import Motion, Observation, Tracking  # noqa: E402
from rhs.api.trajectory import Trajectory  # noqa: E402
from rhs.api.validate import reach_of  # noqa: E402
from rhs.config.compose import compose_config  # noqa: E402
from rhs.config.parts import build, build_part  # noqa: E402
from rhs.estimation import survey as surveying  # noqa: E402
from rhs.estimation.views.features import features  # noqa: E402
from rhs.metrics.accuracy import absolute_errors_m, consecutive, pair, relative_errors, rmse  # noqa: E402
from rhs.patrol.eyes import Eyes, Stopwatch  # noqa: E402
from rhs.patrol.gate import gated  # noqa: E402
from rhs.patrol.loop import Led, steps  # noqa: E402
from rhs.worlds.world import load_world  # noqa: E402


class Timed:
    """An odometry that notes what it said and what it took."""

    def __init__(self, inner: Any) -> None:
        self.inner, self.seconds, self.said = inner, [], []

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    def update(self, view: Observation) -> Motion:
        begin = time.thread_time()
        self.said.append(self.inner.update(view))
        self.seconds.append(time.thread_time() - begin)
        return self.said[-1]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--buildings", nargs="+", default=["home:31", "loop+people:33", "hall+people:38"])
    parser.add_argument("--rules", nargs="+", default=["1:1e-9", "1.5:1e-3", "2:1e-3"])
    parser.add_argument("--out", type=Path, default=Path("results/tables/key_frames.csv"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for building in chosen.buildings:
        family, _, seed = building.partition(":")
        with tempfile.TemporaryDirectory() as folder:
            for row in measured([f"world=random:{family}", f"seed={seed}"], chosen.rules, Path(folder)):
                rows.append({"building": building, **row})
                print(*(f"{v:.4g}" if isinstance(v, float) else v for v in rows[-1].values()), flush=True)
                write(chosen.out, rows)


def measured(words: list[str], rules: list[str], folder: Path):
    """A row for each rule."""
    config = compose_config(["task=survey", *words])
    parts = build(config.parts, seed=config.seed, world=load_world(config.world, seed=config.seed), folder=folder,
                  features=config.features)
    eyes, views, known = Eyes(parts.source, parts.sensor, parts.who), [], {}
    while (looked := eyes(parts.source.lead)) is not None:
        true = looked.judged()
        views.append(replace(looked, judged=lambda true=true: true))
    truth = Trajectory(np.array([v.capture.stamp_s for v in views]), np.array([v.judged().truth for v in views]))

    def key_points(view: Observation, settings):
        if view.index not in known:
            known[view.index] = features(view, settings)
        return known[view.index]

    def errors(poses) -> tuple[float, float]:
        both = pair(Trajectory(truth.stamps_s, np.array(poses)), truth, 1e-6)
        return 1e3 * rmse(absolute_errors_m(both, "se3")), 1e3 * rmse(relative_errors(both, consecutive(len(poses)))[0])

    def part(kind: str):
        return build_part(kind, config.parts[kind], context(kind))

    def context(kind: str) -> Context:
        return Context(generator(config.seed, kind), parts.source.camera, parts.source.facts, folder, config.features)

    for rule in rules:
        settings = compose_config(["task=survey", *words, "odometry=keyframe"]).parts["odometry"].settings
        settings.advanced.floor_stretch, settings.advanced.floor_settled = map(float, rule.split(":"))
        timed = Timed(settings.build(context("odometry")))
        odometry = gated(timed, settings.needs, config.task.settings.gate, "odometry")
        places = config.task.settings.places
        collector = surveying.ViewCollector(places.every, config.features, key_points, places.most_mb)
        led = Led(se2(*parts.source.facts.start), part("mapper"))
        for _ in collector.watch(steps(parts.source, parts.sensor, odometry, led, who=parts.who, eyes=Shown(views))):
            pass
        reach_m = reach_of(parts.source.facts)
        revised, _ = surveying.revise(collector.views, odometry, reach_m=reach_m)
        _, closure = surveying.close(revised, part("loop_closer"), reach_m=reach_m)
        ate_mm, rpe_mm = errors([view.map_from_body for view in collector.views])
        yield {"rule": rule, "views": len(views), "key_frames": int(timed.said[-1].details["keyframes"]),
               "cpu_ms": 1e3 * float(np.mean(timed.seconds[1:])), "ate_mm": ate_mm,
               "revised_mm": errors([view.map_from_body for view in revised])[0], "closed_mm": errors(closure.poses)[0],
               "rpe_mm": rpe_mm, "lost": sum(motion.status is Tracking.LOST for motion in timed.said)}
    parts.source.close()


class Shown:
    """Eyes that are shown views taken before."""

    def __init__(self, views: list) -> None:
        self._left = iter(views)

    def __call__(self, move):
        view = next(self._left, None)
        return None if view is None else replace(view, clock=Stopwatch())

    def close(self) -> None:
        """Nothing is under way."""


if __name__ == "__main__":
    main()
