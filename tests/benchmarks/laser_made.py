"""Laser SLAM on made logs: buildings, scanners and wheels drawn by a seed, written as CARMEN logs with their truth.

    python tests/benchmarks/laser_made.py --seeds 10000-10015 --out results/tables/laser_made.csv

Which kind of building a seed makes is seed % 4 (`laser_buildings.py`). Scanner: 180 to 541 beams
over 180 or 270 degrees, noise of 1 to 3 cm, centimetres, sometimes 0.2 m ahead of the wheels, some beams 0;
outdoors half of them end nowhere (81.91), some
halls are seen by one that ends at 8.19 m; 5 to 37 scans a second, or one every 0.3 m. People walk about. Wheels: metres 3 to
8 % off, a drift of 1 to 4 degrees per metre for one seed in two, noise, a slip now and then. Judged by the true poses:

relations_m: mean error of the position of a scan seen from another one, as published relations are made: three in four pairs
1 to 3 m of way apart (near_m), one in four within 1 m on another passage (revisits_m); ate_m: root mean
square, aligned. A run is right up to 0.06 m (relations_m), `said_wrong` when the map says that it is not (inconsistency over
0.04 or way_sigma_m over 0.5), `silent` when it is wrong and that is not said. wrong_loops: accepted though over 0.5 m or
5 degrees off.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numba as nb
import numpy as np
from laser import opened, wheels_of
from laser_buildings import KINDS, Way, building
from laser_like import BEAMS, LIKE, Changes, like
from shared import write

from rhs.api.records import View
from rhs.estimation.scans.inconsistency import map_inconsistency
from rhs.estimation.scans.planar_poses import between, composed, flat
from rhs.metrics.success import CONTRADICTED, UNSURE_M

RIGHT_M = 0.06


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", default="0-3", help="FIRST-LAST")
    parser.add_argument("--kinds", nargs="*", default=KINDS, help="also lab and wing, one of each for every seed")
    parser.add_argument("--way-m", type=float, nargs=2, default=(400.0, 1600.0), help="least and most way")
    parser.add_argument("--settings", nargs="*", default=[], help="words of the command line")
    parser.add_argument("--logs", type=Path, help="keep the logs in this folder")
    parser.add_argument("--out", type=Path, default=Path("laser_made.csv"))
    options = parser.parse_args()
    first, last = (int(word) for word in options.seeds.split("-"))
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.logs or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        drawn = [(KINDS[seed % 4], seed) for seed in range(first, last + 1) if KINDS[seed % 4] in options.kinds]
        drawn += [(kind, seed) for seed in range(first, last + 1) for kind in LIKE if kind in options.kinds]
        for kind, seed in drawn:
            path = folder / f"{kind}_{seed}.log"
            facts, truth = made(path, (kind, seed), options.way_m)
            rows.append({"kind": kind, "seed": seed, **facts, **judged(path, truth, facts, options.settings)})
            words = (f"{k}={v:.3g}" if isinstance(v, float) else f"{k}={v}" for k, v in rows[-1].items())
            sys.stdout.write(" ".join(words) + "\n")
            sys.stdout.flush()
            write(options.out, rows)
            if not options.logs:
                path.unlink()
    right, silent = sum(row["right"] for row in rows), sum(row["silent"] for row in rows)
    sys.stdout.write(f"{right} of {len(rows)} right, {silent} wrong and silent\n")
    return int(silent > 0)


def made(path: Path, drawn: tuple[str, int], ways_m: tuple[float, float]) -> tuple[dict, np.ndarray]:
    """Writes the log of a kind and a seed; what it is like, and the true poses of its scanner (N, 3)."""
    kind, rng = drawn[0], np.random.default_rng([17, drawn[1]])
    beams, fov_deg = [(180, 180.0), (181, 180.0), (361, 180.0), (541, 270.0)][int(rng.integers(4))]
    beams, fov_deg = BEAMS.get(kind, (beams, fov_deg))
    rate_hz = float(rng.choice([5.0, 5.0, 10.0, 37.0]))
    thin_m = float(rng.choice([0.0, 0.0, 0.3]))
    way_m = rng.uniform(*ways_m) if rate_hz < 10.0 or thin_m else 0.5 * ways_m[0] * (1.0 if rate_hz > 10.0 else 2.0)
    most_m = 81.91 if kind != "halls" or rng.random() < 0.6 else 8.19
    mount_m, noise_m = float(rng.choice([0.0, 0.2])), rng.uniform(0.01, 0.03)
    people = int(rng.integers(0, 5))
    changes: Changes = []
    if kind in LIKE:
        walls, way, changes = like(kind, way_m, rng)
    else:
        walls, way = building(kind, way_m, rng)
    at, corner = driven(way, rng.uniform(0.4, 0.9), rate_hz, rng)
    stamps = np.arange(len(at)) / rate_hz
    wheels = odometry(at, rng)
    if thin_m:
        kept = thinned(at, thin_m)
        at, stamps, wheels, corner = at[kept], stamps[kept], wheels[kept], corner[kept]
    laser = composed(at, np.tile([mount_m, 0.0, 0.0], (len(at), 1)))
    step = np.radians(fov_deg) / (beams - 1 if beams % 2 else beams)
    bearings = (np.arange(beams) - 0.5 * (beams - 1)) * step
    nodes = scattered(laser, people, rng)
    with path.open("w") as file:
        for k in range(len(at)):
            now = [there for since, there in changes if since <= corner[k]][-1:]
            seen = np.concatenate([walls, *now, discs(nodes[k])]) if people or now else walls
            ranges = rays(seen, laser[k], bearings, most_m) + noise_m * rng.standard_normal(beams)
            ranges = np.where(ranges > most_m - 0.1, most_m, np.maximum(ranges, 0.02))
            ranges[rng.random(beams) < 0.003] = 0.0
            words = [f"{r:.2f}" for r in ranges]
            there = composed(wheels[k], np.array([mount_m, 0.0, 0.0]))
            file.write(f"TRUEPOS {_pose(at[k])} {_pose(wheels[k])} {stamps[k]:.6f} made {stamps[k]:.6f}\n")
            file.write(f"FLASER {beams} {' '.join(words)} {_pose(there)} {_pose(wheels[k])} "
                       f"{stamps[k]:.6f} made {stamps[k]:.6f}\n")
    facts = {"beams": beams, "fov_deg": fov_deg, "most_m": most_m, "noise_m": noise_m, "rate_hz": rate_hz,
             "thinned_m": thin_m,
             "mount_m": mount_m, "people": people, "way_m": float(np.hypot(*np.diff(at[:, :2], axis=0).T).sum()),
             "scans": len(at),
             "wheels_m": relations(wheels, at)[0]}
    return facts, laser


def _pose(pose: np.ndarray) -> str:
    return " ".join(f"{v:.6f}" for v in pose)


def driven(way: Way, speed_mps: float, rate_hz: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """(N, 3) poses of a robot that pursues a point on the way ahead of it, turning on the spot where it must, and the
    number (N,) of the last corner that it passed."""
    points, corners = _along(np.array(way))
    marks = 0
    pose = np.array([*points[0], np.arctan2(*(points[5] - points[0])[::-1])])
    out, passed, turn = [], [], 0.0
    sway = rng.uniform(0.0, 0.25)
    while marks < len(points) - 1:
        while marks < len(points) - 1 and np.hypot(*(points[marks] - pose[:2])) < 0.8:
            marks += 1
        aim = points[marks] - pose[:2]
        off = (np.arctan2(aim[1], aim[0]) + sway * np.sin(0.05 * marks) - pose[2] + np.pi) % (2.0 * np.pi) - np.pi
        turn += np.clip(np.clip(1.5 * off, -1.0, 1.0) - turn, -2.0 / rate_hz, 2.0 / rate_hz)
        pose = composed(pose, np.array([speed_mps * max(np.cos(off), 0.0) ** 3 / rate_hz, 0.0, turn / rate_hz]))
        out.append(pose)
        passed.append(corners[marks])
    return np.array(out), np.array(passed)


def _along(corners: np.ndarray, step_m: float = 0.1) -> tuple[np.ndarray, np.ndarray]:
    parts, numbers = [], []
    for number, (a, b) in enumerate(zip(corners[:-1], corners[1:], strict=True)):
        count = max(int(np.hypot(*(b - a)) / step_m), 1)
        parts.append(a + (b - a) * np.arange(count)[:, None] / count)
        numbers += [number] * count
    return np.concatenate([*parts, corners[-1:]]), np.array([*numbers, len(corners) - 1])


def odometry(at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(N, 3) what the wheels say: metres and turns off, drifting, with noise and slips."""
    moved = between(at[:-1], at[1:])
    way_m = np.hypot(moved[:, 0], moved[:, 1])
    scale = 1.0 + rng.choice([-1.0, 1.0], 2) * rng.uniform(0.03, 0.08, 2)
    drift = rng.choice([0.0, 1.0]) * rng.choice([-1.0, 1.0]) * np.radians(rng.uniform(1.0, 4.0))
    moved[:, :2] = scale[0] * moved[:, :2] + 0.02 * np.sqrt(way_m)[:, None] * rng.standard_normal((len(moved), 2))
    moved[:, 2] = scale[1] * moved[:, 2] + drift * way_m + 0.02 * np.sqrt(way_m) * rng.standard_normal(len(moved))
    slips = rng.random(len(moved)) < way_m / 150.0
    moved[slips] = composed(moved[slips], rng.standard_normal((int(slips.sum()), 3)) * [0.15, 0.05, 0.2])
    out = np.zeros_like(at)
    for k in range(len(moved)):
        out[k + 1] = composed(out[k], moved[k])
    return out


def thinned(at: np.ndarray, least_m: float) -> np.ndarray:
    """Places of poses each so far, or 0.3 rad, from the last one kept."""
    kept = [0]
    for k in range(1, len(at)):
        moved = between(at[kept[-1]], at[k])
        if np.hypot(*moved[:2]) >= least_m or abs(moved[2]) >= 0.3:
            kept.append(k)
    return np.array(kept)


def scattered(laser: np.ndarray, people: int, rng: np.random.Generator) -> np.ndarray:
    """(N, people, 2) where they are: each wanders round the robot, 1 to 6 m away."""
    time_s = np.arange(len(laser))[:, None]
    angle = rng.uniform(0.0, 7.0, people) + 0.7 * np.sin(time_s * rng.uniform(0.01, 0.05, people)) * 3.0
    away_m = 3.5 + 2.5 * np.sin(time_s * rng.uniform(0.01, 0.05, people) + rng.uniform(0.0, 7.0, people))
    return laser[:, None, :2] + away_m[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def discs(centres: np.ndarray) -> np.ndarray:
    """(6 P, 2, 2) outlines of people."""
    angles = np.arange(7) * np.pi / 3.0
    ring = 0.22 * np.column_stack([np.cos(angles), np.sin(angles)])
    corners = centres[:, None] + ring
    return np.stack([corners[:, :-1], corners[:, 1:]], axis=2).reshape(-1, 2, 2)


@nb.njit
def rays(walls: np.ndarray, at: np.ndarray, bearings: np.ndarray, most_m: float) -> np.ndarray:
    """(B,) metres from a pose (3,) to the nearest wall (S, 2, 2) along each beam, evenly apart; most_m: none."""
    out, count = np.full(len(bearings), most_m), len(bearings)
    step, first = (bearings[-1] - bearings[0]) / (count - 1), bearings[0] + at[2]
    for s in range(len(walls)):
        ax, ay, bx, by = walls[s, 0, 0] - at[0], walls[s, 0, 1] - at[1], walls[s, 1, 0] - at[0], walls[s, 1, 1] - at[1]
        wx, wy = bx - ax, by - ay
        share = min(max(-(ax * wx + ay * wy) / max(wx * wx + wy * wy, 1e-12), 0.0), 1.0)
        if (ax + share * wx) ** 2 + (ay + share * wy) ** 2 > most_m * most_m:
            continue
        turn = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        low = np.arctan2(ay, ax) if turn >= 0.0 else np.arctan2(by, bx)
        begin = (low - first) - 2.0 * np.pi * np.floor((low - first) / (2.0 * np.pi))
        for lap in (begin, begin - 2.0 * np.pi):
            for k in range(max(int(np.ceil(lap / step)), 0), min(int(np.floor((lap + abs(turn)) / step)), count - 1) + 1):
                c, s_ = np.cos(first + k * step), np.sin(first + k * step)
                across = c * wy - s_ * wx
                if across != 0.0:
                    along = (ax * wy - ay * wx) / across
                    if 0.0 < along < out[k]:
                        out[k] = along
    return out


def judged(path: Path, truth: np.ndarray, facts: dict, words: list[str]) -> dict:
    """The two parts led along the log, against the true poses."""
    parts, seen = opened(path, [f"source.laser_fov_deg={facts['fov_deg']:g}", *words])
    odometry_part, closer = parts[0](), parts[1]()
    assert len(seen) == len(truth) and wheels_of(seen).any()
    began_s = time.process_time()
    views = []
    for one in seen:
        motion = odometry_part.update(one)
        views.append(View(one.index, one.stamp_s, one.camera, motion, np.eye(4), 1e-6 * np.eye(6), one.scan, None))
    front_s = time.process_time() - began_s
    poses = odometry_part.revise().poses
    closure = closer.close([replace(view, map_from_body=pose) for view, pose in zip(views, poses, strict=True)])
    all_s = time.process_time() - began_s
    before, after = flat(poses), flat(closure.poses)
    whole, near, again, ate = relations(after, truth)
    loops = [edge for edge in closure.edges if edge.accepted]
    off = [between(between(truth[edge.earlier], truth[edge.later]), flat(edge.earlier_from_later[None])[0])
           for edge in loops]
    value = map_inconsistency([one.scan for one in seen], after)
    sigma_m = closure.details.get("way_sigma_m", float("nan"))
    right, said = whole <= RIGHT_M, value > CONTRADICTED or sigma_m > UNSURE_M
    return {"front_relations_m": relations(before, truth)[0], "front_ate_m": relations(before, truth)[3],
            "relations_m": whole,
            "near_m": near, "revisits_m": again, "ate_m": ate, "inconsistency": value,
            "way_sigma_m": sigma_m, "loops": len(loops),
            "wrong_loops": sum(bool(np.hypot(*gap[:2]) > 0.5 or abs(gap[2]) > 0.09) for gap in off),
            "searches": 1 + int(closure.details.get("wider_searches", 0)),
            "lost_share": float(np.mean([view.motion.status == "lost" for view in views])), "right": int(right),
            "said_wrong": int(said), "silent": int(not right and not said),
            "front_scans_per_s": len(seen) / front_s, "scans_per_s": len(seen) / all_s}


def relations(poses: np.ndarray, truth: np.ndarray) -> tuple[float, float, float, float]:
    """relations_m, near_m, revisits_m and ate_m (NaN: no place was passed twice) of poses (N, 3)."""
    way_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(truth[:, :2], axis=0).T))])
    first = np.unique(np.searchsorted(way_m, np.arange(0.0, way_m[-1], 0.5)).clip(0, len(truth) - 1))
    second = np.searchsorted(way_m, way_m[first] + 1.0 + 2.0 * (np.arange(len(first)) % 5) / 4.0)
    near = _errors(poses, truth, first[second < len(truth)], second[second < len(truth)])
    pairs = []
    for k in first:
        gap_m = np.hypot(*(truth[first, :2] - truth[k, :2]).T)
        others = first[(gap_m < 1.0) & (way_m[first] - way_m[k] > 10.0)]
        pairs += [(k, j) for j in others[:: max(len(others) // 3, 1)][:3]]
    again = _errors(poses, truth, *np.array(pairs, int).reshape(-1, 2).T)
    ate_m = float(np.sqrt(np.mean(np.sum((_onto(poses[:, :2], truth[:, :2]) - truth[:, :2]) ** 2, axis=1))))
    if not len(again):
        return float(near.mean()), float(near.mean()), float("nan"), ate_m
    return 0.75 * float(near.mean()) + 0.25 * float(again.mean()), float(near.mean()), float(again.mean()), ate_m


def _errors(poses: np.ndarray, truth: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    off = between(between(truth[first], truth[second]), between(poses[first], poses[second]))
    return np.hypot(off[:, 0], off[:, 1])


def _onto(points: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Points (N, 2) turned and moved onto the true ones."""
    a, b = points - points.mean(axis=0), truth - truth.mean(axis=0)
    turn = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = np.cos(turn), np.sin(turn)
    return a @ np.array([[c, s], [-s, c]]) + truth.mean(axis=0)


if __name__ == "__main__":
    sys.exit(main())
