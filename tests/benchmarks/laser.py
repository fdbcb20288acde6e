"""Laser SLAM on real logs, with the wheels as they are and made worse in twenty ways.

    python tests/benchmarks/laser.py ../shared/data/laser/aces.clf.bz2 ../shared/data/laser/mit-csail.clf.bz2 \
        --out results/tables/laser_slam.csv

Each log is led once through `odometry=scan_to_map` and `loop_closer=scan_graph` as it is, and once for each kind of worse
wheels and seed: `worse` (metres and turns up to 15 % too long or short, a drift of up to 0.1 rad/m, 30 % noise on every
reading), `hanging` (1 % of the readings begin a hang of 2 to 8 scans, after which they catch up at once), `leaping` (1 % of
the readings leap by 0.5 m and 0.7 rad, 1 sigma, and never take it back), and `all` of it. Judged by the published relations
where FILE.relations lies beside the log, by what the map says of itself, and by how far the way lies from that with the
wheels as they are. A run has failed when its relations err by more than 0.06 m, or, without relations, when its way is
further than 0.5 m (rms after alignment) from the one with wheels as they are. CPU seconds of one core; reading the log
is not counted.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from shared import write

from rhs.api.contracts import Context, FeatureSettings, SourceContext
from rhs.api.geometry import inverse
from rhs.api.randomness import generator
from rhs.api.records import Observation, View
from rhs.api.trajectory import Trajectory, aligned
from rhs.config.compose import compose_config
from rhs.estimation.scans.inconsistency import map_inconsistency
from rhs.estimation.scans.planar_poses import between, composed
from rhs.metrics.relations import Relations, read_relations, relation_values

KINDS = ("worse", "hanging", "leaping", "all")
FAILED_M, FAILED_WAY_M = 0.06, 0.5


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, default=5, help="of each kind of worse wheels")
    parser.add_argument("--settings", nargs="*", default=[], help="words of the command line, odometry.key_m=0.5 and so on")
    parser.add_argument("--out", type=Path, default=Path("laser_slam.csv"))
    options = parser.parse_args()
    rows = []
    for log in options.logs:
        parts, seen = opened(log, options.settings)
        beside = log.parent / f"{log.name.split('.')[0]}.relations"
        relations = read_relations(beside) if beside.exists() else None
        best = None
        for what, wheels in [("as they are", wheels_of(seen)), *variants(wheels_of(seen), options.seeds)]:
            row, way = judged(parts, seen, wheels, relations, best)
            best = way if best is None else best
            rows.append({"log": log.name.split(".")[0], "wheels": what} | row)
            sys.stdout.write(" ".join(f"{v:.4g}" if isinstance(v, float) else str(v) for v in rows[-1].values()) + "\n")
            sys.stdout.flush()
            write(options.out, rows)
    failed = sum(row["failed"] for row in rows)
    sys.stdout.write(f"{failed} of {len(rows)} failed\n")
    return int(failed > 0)


def opened(log: Path, words: list[str]):
    """Builders of the two parts, and the observations of the whole log."""
    config = compose_config(["source=replay", f"source.path={log}", "sensor=laser", "odometry=scan_to_map",
                             "loop_closer=scan_graph", *words])
    with tempfile.TemporaryDirectory() as name:
        source = config.source.settings.build(SourceContext(generator(0, "source"), None, Path(name)))
        context = Context(generator(0, "laser"), source.camera, source.facts, Path(name), FeatureSettings())
        sensor, seen = config.sensor.settings.build(context), []
        while (capture := source.lead()) is not None:
            seen.append(sensor.sense(capture))
        source.close()
    return (lambda: config.odometry.settings.build(context), lambda: config.loop_closer.settings.build(context)), seen


def wheels_of(seen: list[Observation]) -> np.ndarray:
    """(N, 3) readings of the wheels from scan to scan; the first is nothing."""
    return np.array([np.zeros(3) if one.wheel is None else one.wheel for one in seen])


def variants(wheels: np.ndarray, seeds: int) -> list[tuple[str, np.ndarray]]:
    """Worse wheels by name: each kind with each seed."""
    return [(f"{kind} {seed}", worsened(wheels, kind, np.random.default_rng(1000 * KINDS.index(kind) + seed)))
            for kind in KINDS for seed in range(seeds)]


def worsened(wheels: np.ndarray, kind: str, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) readings made worse."""
    out = wheels.copy()
    if kind in ("worse", "all"):
        scale, drift = 1.0 + rng.uniform(-0.15, 0.15, 2), rng.uniform(-0.1, 0.1)
        noise = 1.0 + 0.3 * rng.standard_normal((len(out), 2))
        out[:, 2] = out[:, 2] * scale[1] * noise[:, 1] + drift * np.hypot(out[:, 0], out[:, 1])
        out[:, :2] *= scale[0] * noise[:, :1]
        out[~wheels.any(axis=1)] = 0.0
    if kind in ("leaping", "all"):
        leaps = rng.random(len(out)) < 0.01
        out[leaps] = composed(out[leaps], rng.standard_normal((int(leaps.sum()), 3)) * [0.5, 0.5, 0.7])
    if kind in ("hanging", "all"):
        at = np.zeros((len(out) + 1, 3))
        for k in range(len(out)):
            at[k + 1] = composed(at[k], out[k])
        for k in np.nonzero(rng.random(len(out)) < 0.01)[0]:
            end = min(k + int(rng.integers(2, 9)), len(out) - 1)
            at[k + 1 : end + 1] = at[k]
        out = between(at[:-1], at[1:])
        out[(at[:-1] == at[1:]).all(axis=1)] = 0.0
    out[0] = 0.0
    return out


def judged(parts, seen: list[Observation], wheels: np.ndarray, relations: Relations | None,
           best: np.ndarray | None) -> tuple[dict, np.ndarray]:
    """The row of one drive, and its way (N, 4, 4)."""
    odometry, closer = parts[0](), parts[1]()
    began_s = time.process_time()
    views = []
    for one, wheel in zip(seen, wheels, strict=True):
        one = replace(one, wheel=None if one.wheel is None else wheel)
        motion = odometry.update(one)
        views.append(View(one.index, one.stamp_s, one.camera, motion, np.eye(4), 1e-6 * np.eye(6), one.scan, None))
    front_s = time.process_time() - began_s
    poses = odometry.revise().poses
    views = [replace(view, map_from_body=pose) for view, pose in zip(views, poses, strict=True)]
    closure = closer.close(views)
    all_s = time.process_time() - began_s
    stamps = np.array([one.stamp_s for one in seen])
    values = relation_values(Trajectory(stamps, closure.poses), relations)
    before = relation_values(Trajectory(stamps, poses), relations)
    way_m = float("nan") if best is None else apart_m(closure.poses, best, stamps)
    scans = [one.scan for one in seen]
    failed = values["relations_trans_m"] > FAILED_M if relations is not None else way_m > FAILED_WAY_M
    return {"front_m": before["relations_trans_m"], "trans_m": values["relations_trans_m"],
            "trans_sd_m": values["relations_trans_sd_m"], "rot_deg": values["relations_rot_deg"],
            "rot_sd_deg": values["relations_rot_sd_deg"], "revisits_m": values["revisits_trans_m"], "way_apart_m": way_m,
            "inconsistency_before": map_inconsistency(scans, _flat(poses)),
            "inconsistency": map_inconsistency(scans, _flat(closure.poses)),
            "way_sigma_m": closure.details["way_sigma_m"],
            "loops": sum(edge.accepted for edge in closure.edges),
            "searches": 1 + int(closure.details.get("wider_searches", 0)),
            "lost_share": float(np.mean([view.motion.status == "lost" for view in views])), "failed": int(failed),
            "front_scans_per_s": len(seen) / front_s, "scans_per_s": len(seen) / all_s}, closure.poses


def _flat(poses: np.ndarray) -> np.ndarray:
    return np.column_stack([poses[:, 0, 3], poses[:, 1, 3], np.arctan2(poses[:, 1, 0], poses[:, 0, 0])])


def apart_m(poses: np.ndarray, best: np.ndarray, stamps: np.ndarray) -> float:
    """Root mean square distance of two ways laid onto one another."""
    onto = aligned(Trajectory(stamps, inverse(poses[0]) @ poses), Trajectory(stamps, best), "se3")
    return float(np.sqrt(np.mean(np.sum((onto.positions_m - best[:, :3, 3]) ** 2, axis=1))))


if __name__ == "__main__":
    sys.exit(main())
