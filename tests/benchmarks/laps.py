"""Led laps of the simulator, kept as plain arrays, so that places, loops and kidnaps are judged again without rendering.

    python tests/benchmarks/laps.py --keep results/laps square square_alike --seeds 0 1

`taken(lap, folder)` leads a lap the first time and reads its file afterwards. A file holds what the estimators may see
(key-points, thumbnails, scans, encoder readings, the motions of three odometries) and the true poses for the judge.
Descriptors are kept as half floats (relative error 0.0005), images are not kept. Files without thumbnails are of
before 2026-11-21 18:00: places are then judged by key-points alone.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

import rhs
from rhs.api.geometry import Camera, camera_from_fov
from rhs.api.randomness import generator
from rhs.api.records import Features, FeatureSettings, Motion, Observation, Scan, Thumbnail, Tracking, View
from rhs.config.compose import compose_config
from rhs.estimation.views.features import features, share
from rhs.testing.room import context

ODOMETRIES = ("procrustes", "procrustes:refine=none", "wheel")
SETTINGS = FeatureSettings()


@dataclass(frozen=True)
class Lap:
    """What is led: a world, its words (paintings_unique=4, ...), a seed of all noise, a direction, how far off the route
    (metres rms sideways, degrees rms of heading; 0 is as straight as a hand leads)."""

    world: str
    seed: int = 0
    direction: str = "ccw"
    words: tuple[str, ...] = ()
    off_m: float = 0.0
    off_deg: float = 0.0

    @property
    def name(self) -> str:
        parts = [Path(self.world).stem, f"seed{self.seed}", self.direction, *self.words]
        parts += [f"off{self.off_m:g}m{self.off_deg:g}deg"] if self.off_m else []
        return "_".join(parts).replace("source.", "").replace("=", "").replace("/", "")


@dataclass(frozen=True, eq=False)
class Taken:
    """A lap as led. truth (N, 4, 4); observations without images whose key-points are known by now; motions: name
    of an odometry -> one Motion per view; features: one per view."""

    truth: np.ndarray
    observations: list[Observation]
    features: list[Features]
    motions: dict[str, list[Motion]]
    camera: Camera

    def __len__(self) -> int:
        return len(self.truth)

    @cached_property
    def way_m(self) -> np.ndarray:
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.truth[:, :2, 3], axis=0), axis=1))])

    def views(self, odometry: str, *, every: int = 3, true_poses: bool = False) -> list[View]:
        """The survey as a loop closer gets it: poses as believed (or as they were), features of every third view and of
        the last."""
        pose, out, last = self.truth[0], [], len(self) - 1
        parts = zip(self.observations, self.motions[odometry], self.features, strict=True)
        for k, (seen, motion, found) in enumerate(parts):
            pose = pose @ motion.previous_from_body if k else pose
            kept = found if k % every == 0 or k == last else None
            at = self.truth[k] if true_poses else pose
            out.append(View(k, seen.stamp_s, self.camera, motion, at, 1e-6 * np.eye(6), seen.scan, kept))
        return out


def taken(lap: Lap, keep: Path) -> Taken:
    """The lap, led now or read from `keep`."""
    path = keep / f"{lap.name}.npz"
    if not path.exists():
        keep.mkdir(parents=True, exist_ok=True)
        partial = path.with_suffix(".tmp.npz")
        np.savez(partial, **_lead(lap))
        partial.replace(path)
    with np.load(path, allow_pickle=False) as file:
        return _read({name: file[name] for name in file.files})


def _lead(lap: Lap) -> dict[str, np.ndarray]:
    words = [f"world={lap.world}", f"source.direction={lap.direction}", "task=survey", "odometry=procrustes",
             f"seed={lap.seed}", *lap.words]
    if lap.off_m:
        words += [f"source.wobble_m={lap.off_m}", f"source.wobble_deg={lap.off_deg}"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        steps = [step for step in rhs.steps(words) if step.phase == "survey"]
        out: dict[str, Any] = {"truth": np.stack([step.truth for step in steps])}
        for odometry in ODOMETRIES:
            motions = [step.motion for step in steps]
            if odometry != "procrustes":
                made = replace(context(folder), rng=generator(lap.seed, "odometry"), camera=steps[0].observation.camera)
                kind, _, setting = odometry.partition(":")
                part = compose_config([f"odometry={kind}", *([f"odometry.{setting}"] if setting else [])])
                follower = part.odometry.settings.build(made)
                motions = [follower.update(step.observation) for step in steps]
            out[f"{odometry}/pose"] = np.stack([m.previous_from_body for m in motions])
            out[f"{odometry}/covariance"] = np.stack([m.covariance for m in motions])
            out[f"{odometry}/status"] = np.array([str(m.status) for m in motions])
    found = [features(step.observation, SETTINGS) for step in steps]
    scans = [step.scan for step in steps]
    thumbnails = [f.thumbnail for f in found if f.thumbnail is not None]
    out |= {
        "greys": np.stack([g.grey for g in thumbnails]),
        "glance_depths": np.stack([g.depth for g in thumbnails]).astype(np.float16),
        "starts": np.concatenate([[0], np.cumsum([len(f.pixels) for f in found])]),
        "pixels": np.concatenate([f.pixels for f in found]), "points": np.concatenate([f.points for f in found]),
        "descriptors": np.concatenate([f.descriptors for f in found]).astype(np.float16),
        "bearings_rad": np.stack([s.bearings_rad for s in scans]), "ranges_m": np.stack([s.ranges_m for s in scans]),
        "max_range_m": np.array([s.max_range_m for s in scans]), "origin_xy_m": np.array([s.origin_xy_m for s in scans]),
        "stamp_s": np.array([step.stamp_s for step in steps]),
        "wheel": np.array([np.full(3, np.nan) if s.observation.wheel is None else s.observation.wheel for s in steps]),
    }  # fmt: skip
    camera = steps[0].observation.camera
    out["camera"] = np.array([camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy])
    out["body_from_camera"] = camera.body_from_camera
    return out


def _read(data: dict[str, np.ndarray]) -> Taken:
    w, h, fx, fy, cx, cy = data["camera"].tolist()
    camera = replace(camera_from_fov(int(w), int(h), 57.0, height_m=1.0), fx=fx, fy=fy, cx=cx, cy=cy,
                     body_from_camera=data["body_from_camera"])
    observations, found = [], []
    for k in range(len(data["truth"])):
        rows = slice(data["starts"][k], data["starts"][k + 1])
        rootsift = data["descriptors"][rows].astype(np.float32)
        rootsift /= np.maximum(np.linalg.norm(rootsift, axis=1, keepdims=True), 1e-9)
        scan = Scan(data["bearings_rad"][k], data["ranges_m"][k], float(data["max_range_m"][k]),
                    tuple(data["origin_xy_m"][k].tolist()))
        seen = Observation(k, float(data["stamp_s"][k]), camera, scan=scan, wheel=data["wheel"][k])
        found.append(Features(data["pixels"][rows], rootsift, data["points"][rows], _thumbnail(data, k)))
        share(seen, SETTINGS, found[-1])
        observations.append(seen)
    motions = {}
    for name in ODOMETRIES:
        parts = zip(data[f"{name}/pose"], data[f"{name}/covariance"], data[f"{name}/status"], strict=True)
        motions[name] = [Motion(pose, covariance, Tracking(str(status))) for pose, covariance, status in parts]
    return Taken(data["truth"], observations, found, motions, camera)


def _thumbnail(data: dict[str, Any], k: int) -> Thumbnail | None:
    return Thumbnail(data["greys"][k], data["glance_depths"][k].astype(np.float32)) if "greys" in data else None


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("worlds", nargs="+")
    parser.add_argument("--keep", type=Path, default=Path("results/laps"))
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--directions", nargs="+", default=["ccw"], choices=["ccw", "cw"])
    parser.add_argument("--words", nargs="*", default=[])
    parser.add_argument("--own-textures", action="store_true", help="draw other paintings for every seed")
    parser.add_argument("--off", type=float, nargs=2, default=[0.0, 0.0], metavar=("METRES", "DEGREES"))
    chosen = parser.parse_args()
    for world in chosen.worlds:
        for seed in chosen.seeds:
            for direction in chosen.directions:
                words = (*chosen.words, *([f"source.texture_seed={seed}"] if chosen.own_textures else []))
                lap = Lap(world, seed, direction, words, *chosen.off)
                sys.stdout.write(f"{lap.name}: {len(taken(lap, chosen.keep))} views\n")
                sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
