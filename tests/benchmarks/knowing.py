"""Kidnaps and loops on recorded laps: does a localiser find itself again, and what does closing a loop cure?

    python tests/benchmarks/knowing.py --worlds square square_twin --kidnaps 40

Per world one survey (seed 0) and one lap 0.2 m rms off the route (seed 1) are led in the simulator, both the same way
round. A kidnap: the localiser tracks 8 views of the lap from a known start, then the views go on from another, drawn
place of the lap, 5 m of way are led, and it is judged. recovered: it called itself tracking, rightly (0.25 m, 5 degrees),
before 5 m. wrong_sure_end: after 5 m it calls itself tracking and is wrong. ece: expected calibration error of the
belief's probability over ten bins, all views. Writes results/tables/kidnaps.csv and results/tables/loops.csv.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rhs.belief import RIGHT_M, RIGHT_RAD
from rhs.compose import compose_config
from rhs.geometry import inverse, planar
from rhs.loops import poses_of
from rhs.parts import generator
from rhs.places_task import STILL, lap
from rhs.records import Belief, FeatureSettings, Knowing
from rhs.survey import draw
from rhs.testing_room import context

TABLES = Path(__file__).resolve().parents[2] / "results" / "tables"
WAY_M = 5.0


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", nargs="+", default=["square", "square_twin"])
    parser.add_argument("--localisers", nargs="+", default=["sift_db", "particle_filter"])
    parser.add_argument("--kidnaps", type=int, default=40)
    options = parser.parse_args()
    kidnaps, loops = [], []
    with tempfile.TemporaryDirectory() as scratch:
        for world in options.worlds:
            survey, bank, parts = laps(world, Path(scratch))
            loops += [f"{world}," + line for line in loop_lines(survey, Path(scratch))]
            views = [replace(v, features=v.features if k % 3 == 0 else None) for k, (v, _) in enumerate(survey)]
            grid = draw(tuple(views), parts.mapper)
            for name in options.localisers:
                line = kidnap_line(world, name, views, grid, bank, options.kidnaps, Path(scratch))
                kidnaps.append(line)
                sys.stdout.write(line + "\n")
                sys.stdout.flush()
    head = "world,localiser,kidnaps,recovered,median_m,p90_m,wrong_sure_end,honest_lost_end,ece,update_ms\n"
    (TABLES / "kidnaps.csv").write_text(head + "\n".join(kidnaps) + "\n")
    head = "world,survey,closer,ate_before_m,ate_after_m,end_before_m,end_after_m,closures,false_closures,closing_cpu_ms\n"
    (TABLES / "loops.csv").write_text(head + "\n".join(loops) + "\n")
    return 0


def laps(world: str, folder: Path):
    words = [f"world={world}", "localiser=sift_db"]
    survey, parts = lap(compose_config(words), folder, seed=0)
    config = compose_config([*words, "places.off_route_m=0.2", "places.off_route_deg=5"])
    bank, _ = lap(config, folder, seed=1, off_route=True)
    return survey, bank, parts


def loop_lines(survey, folder: Path) -> list[str]:
    """Each closer on the survey as the odometry believed it."""
    truth = np.stack([view.map_from_body for view, _ in survey])
    last = len(survey) - 1
    views = [
        replace(v, map_from_body=s.belief.map_from_body, features=v.features if k % 3 == 0 or k == last else None)
        for k, (v, s) in enumerate(survey)
    ]
    before, out = poses_of(views), []
    for name in ("error_distribution", "pose_graph"):
        closer = compose_config([f"loop_closer={name}"]).loop_closer.settings.build(_context(folder, survey, name))
        begin = time.process_time()
        closure = closer.close(views)
        spent_ms = 1e3 * (time.process_time() - begin)
        false = sum(edge.accepted and _gap_m(truth, edge) > 0.3 for edge in closure.edges)
        numbers = [_ate(before, truth), _ate(closure.poses, truth), _end(before, truth), _end(closure.poses, truth)]
        out.append(f"seed 0,{name}," + ",".join(f"{x:.4f}" for x in numbers)
                   + f",{int(closure.details['closures'])},{false},{spent_ms:.0f}")
    return out


def kidnap_line(world, name, views, grid, bank, count, folder) -> str:
    """One row of the table."""
    part = compose_config([f"localiser={name}"]).localiser.settings.build(_context(folder, bank, name))
    part.learn(views, grid)
    rng = np.random.default_rng(7)
    found, ends, calibration, spent = [], [], [], []
    for _ in range(count):
        a, c = rng.integers(0, len(bank) - 60, 2)
        part.start(Belief(bank[a][0].map_from_body, 1e-3 * np.eye(6)))
        for k in range(8):
            part.update(bank[a + k][1].observation, bank[a + k][1].motion if k else STILL)
        way_m, k, when = 0.0, int(c), np.inf
        while way_m < WAY_M and k < len(bank):
            view, step = bank[k]
            motion = step.motion if k > c else STILL
            way_m += float(np.hypot(*planar(motion.previous_from_body)[:2]))
            begin = time.process_time()
            belief = part.update(step.observation, motion)
            spent.append(time.process_time() - begin)
            sure, right = belief.status is Knowing.TRACKING, _right(belief, view.map_from_body)
            calibration.append((belief.probability, right))
            when = min(when, way_m) if sure and right else when
            k += 1
        found.append(when)
        ends.append((sure, right))
    back = np.array([x for x in found if np.isfinite(x)])
    wrong = np.mean([sure and not right for sure, right in ends])
    lost = np.mean([not sure for sure, _ in ends])
    return (f"{world},{name},{count},{len(back) / count:.3f},{np.median(back):.2f},{np.percentile(back, 90):.2f},"
            f"{wrong:.3f},{lost:.3f},{_ece(calibration):.3f},{1e3 * np.mean(spent):.1f}")


def _context(folder: Path, taken, name: str):
    made = context(folder)
    return replace(made, rng=generator(0, name), camera=taken[0][0].camera, features=FeatureSettings())


def _right(belief: Belief, truth: np.ndarray) -> bool:
    x_m, y_m, yaw_rad = planar(inverse(truth) @ belief.map_from_body)
    return bool(np.hypot(x_m, y_m) < RIGHT_M and abs(yaw_rad) < RIGHT_RAD)


def _ece(pairs) -> float:
    chance, right = np.array(pairs, float).T
    bins = np.minimum((10 * chance).astype(int), 9)
    return float(sum(abs(chance[bins == b].mean() - right[bins == b].mean()) * (bins == b).mean() for b in set(bins)))


def _ate(poses, truth) -> float:
    return float(np.sqrt(((poses[:, :2, 3] - truth[:, :2, 3]) ** 2).sum(axis=1).mean()))


def _end(poses, truth) -> float:
    return float(np.linalg.norm((poses[-1] - truth[-1])[:2, 3]))


def _gap_m(truth, edge) -> float:
    true = inverse(truth[edge.earlier]) @ truth[edge.later]
    return float(np.linalg.norm((inverse(true) @ edge.earlier_from_later)[:2, 3]))


if __name__ == "__main__":
    sys.exit(main())
