"""Both eyes' worth: `fused` beside each of its parts alone, on identical views of worlds that have blank and painted parts.

    python tests/benchmarks/fused.py --seeds 3

One run is a world, a seed and a direction of the route; the seed moves the paintings, the wobble, the sensor's noise and
the errors of the command. Each odometry sees the same observations of an RGB-D camera. Nothing is aligned: the start is
given. Writes one row per run and odometry to OUT/fused_runs.csv; medians, 95 % bootstrap intervals of the median, worst
runs and how many failed (ever more than a metre wrong) to OUT/fused.csv. Times are CPU times of one process.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from shared import odometry, write

from rhs.api.contracts import Context, FeatureSettings
from rhs.api.geometry import planar, wrap
from rhs.api.randomness import generator
from rhs.config.compose import compose_config
from rhs.config.parts import build
from rhs.worlds.world import load_world

WORLDS = {
    "small_blank": ("world=small_blank",),
    "small_blank, depth to 3.5 m": ("world=small_blank", "sensor.max_range_m=3.5"),
    "square_blank": ("world=square_blank",),
    "square_blank, depth to 3.5 m": ("world=square_blank", "sensor.max_range_m=3.5"),
}
PACE = ("sensor=rgbd", "source.step_m=0.125", "source.turn=arc", "source.turn_step_deg=6.5")
SHOWN = ("ate_m", "half_way_error_m", "end_error_m", "largest_error_m", "largest_yaw_error_deg", "not_ok_share", "cpu_ms")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("odometries", nargs="*", default=["fused", "procrustes", "corridor_ekf"],
                        help="name or name:setting=value,setting=value")
    parser.add_argument("--worlds", nargs="+", default=list(WORLDS)[:2], choices=list(WORLDS))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for world in chosen.worlds:
        for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds):
            for direction in ("ccw", "cw"):
                rows += one_run(world, seed, direction, chosen.odometries)
                for row in rows[-len(chosen.odometries):]:
                    print(*(f"{v:.3g}" if isinstance(v, float) else v for v in row.values()), flush=True)
                write(chosen.out / "fused_runs.csv", rows)
    groups = dict.fromkeys((row["world"], row["odometry"]) for row in rows)
    write(chosen.out / "fused.csv", [summary(rows, *group) for group in groups])
    print((chosen.out / "fused.csv").read_text())


def one_run(world: str, seed: int, direction: str, words: list[str]) -> list[dict[str, Any]]:
    """One row per odometry for one survey; the observations are made once."""
    look = (f"seed={seed}", f"source.texture_seed={seed + 1}", f"source.direction={direction}")
    config = compose_config([*PACE, *look, *WORLDS[world]])
    with tempfile.TemporaryDirectory() as name:
        parts = build(config.parts, seed=config.seed, world=load_world(config.world), folder=Path(name),
                      features=config.features)
        source = parts.source
        context = Context(generator(seed, "odometry"), source.camera, source.facts, Path(name), FeatureSettings())
        followed = [Followed(odometry(word, replace(context, rng=generator(seed, "odometry")))) for word in words]
        truth = []
        while (capture := parts.source.lead()) is not None:
            observation = parts.sensor.sense(capture)
            truth.append(parts.source.truth())
            for one in followed:
                one.see(observation, truth[0])
        parts.source.close()
    about = {"world": world, "seed": seed, "direction": direction}
    return [{**about, "odometry": word, **one.row(np.array(truth))} for word, one in zip(words, followed, strict=True)]


class Followed:
    """An odometry, its poses so far, its statuses and the CPU time it took."""

    def __init__(self, part: Any) -> None:
        self.part, self.poses, self.ok, self.cpu_s = part, [], [], []

    def see(self, observation: Any, start: np.ndarray) -> None:
        begin = time.process_time()
        motion = self.part.update(observation)
        self.cpu_s.append(time.process_time() - begin)
        self.poses.append(self.poses[-1] @ motion.previous_from_body if self.poses else start)
        self.ok.append(str(motion.status) == "ok")

    def row(self, truth: np.ndarray) -> dict[str, float]:
        believed, true = (np.array([planar(p) for p in poses]) for poses in (self.poses, truth))
        gap = np.hypot(*(believed - true)[:, :2].T)
        way = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(true[:, :2], axis=0).T))])
        return {
            "way_m": float(way[-1]),
            "ate_m": float(np.sqrt((gap**2).mean())),
            "half_way_error_m": float(gap[np.searchsorted(way, 0.5 * way[-1])]),
            "end_error_m": float(gap[-1]),
            "largest_error_m": float(gap.max()),
            "largest_yaw_error_deg": float(np.degrees(np.abs(wrap(believed[:, 2] - true[:, 2]))).max()),
            "not_ok_share": 1.0 - float(np.mean(self.ok)),
            "cpu_ms": 1e3 * float(np.median(self.cpu_s)),
        }


def summary(rows: list[dict[str, Any]], world: str, word: str) -> dict[str, Any]:
    mine = [row for row in rows if (row["world"], row["odometry"]) == (world, word)]
    ate = np.array([row["ate_m"] for row in mine])
    draws = np.median(np.random.default_rng(0).choice(ate, (2000, len(ate))), axis=1)
    out: dict[str, Any] = {"world": world, "odometry": word, "runs": len(mine),
                           "failed": sum(row["largest_error_m"] > 1.0 for row in mine),
                           "ate_m_low": float(np.percentile(draws, 2.5)), "ate_m_high": float(np.percentile(draws, 97.5))}
    for name in SHOWN:
        values = np.array([row[name] for row in mine])
        out |= {f"{name}_median": float(np.median(values)), f"{name}_max": float(values.max())}
    return out


if __name__ == "__main__":
    main()
