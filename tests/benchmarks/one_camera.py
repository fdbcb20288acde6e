"""How far `monocular_vo` strays on recordings of one camera: made ones, carried by hand, and a TUM folder without its depth.

python tests/benchmarks/one_camera.py [TUM_FOLDER CAMERA]
"""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np

from rhs.api.geometry import align, camera_from_fov, exp_so3, se3
from rhs.api.records import Observation
from rhs.testing.room import FURNISHED, paintings, see
from rhs_odometry.monocular_vo.config import MonocularVo
from rhs_sources.replay_config import Replay


def by_hand(seed: int, count: int = 80):
    """Camera, and (true pose, view) of a walk that moves on all six axes through the furnished room, noise 2 grey levels."""
    camera, rng = camera_from_fov(320, 240, 60.0, height_m=0.0), np.random.default_rng(seed)
    p, out = rng.uniform(0.0, 6.28, 6), []
    for k in range(count):
        t = k / 15
        turn = exp_so3(np.array([0.1 * np.sin(1.7 * t + p[3]), 0.12 * np.sin(1.1 * t + p[4]),
                                 0.35 * np.sin(0.7 * t + p[5])]))
        at = [-1.5 + 0.5 * np.sin(0.9 * t + p[0]) + 0.1 * t, -0.5 + 0.35 * np.sin(1.3 * t + p[1]),
              1.2 + 0.15 * np.sin(1.1 * t + p[2])]
        pose = se3(turn, np.array(at))
        image = see(camera, pose, paintings(), k, FURNISHED).image
        noisy = np.clip(image + 2.0 * rng.standard_normal(image.shape[:2])[:, :, None], 0, 255).astype(np.uint8)
        out.append((pose, Observation(k, t, camera, image=noisy)))
    return camera, out


def recorded(folder: str, camera: str):
    """The same of a recording, its depth left out."""
    source, out = Replay(path=folder, camera=camera).build(None), []
    while (capture := source.lead()) is not None:
        out.append((source.truth(), Observation(capture.index, capture.stamp_s, source.camera, image=capture.image)))
    source.close()
    return source.camera, out


def judge(name: str, camera, views) -> None:
    odometry = MonocularVo().build(SimpleNamespace(camera=camera, rng=np.random.default_rng(0)))
    states = [str(odometry.update(view).status) for _, view in views]
    known = [k for k, (pose, _) in enumerate(views) if pose is not None]
    there = np.array([views[k][0][:3, 3] for k in known])
    found = odometry.revise().poses[known, :3, 3]
    move, scale = align(found, there, with_scale=True)
    off = np.linalg.norm(scale * found @ move[:3, :3].T + move[:3, 3] - there, axis=1)
    way = np.linalg.norm(np.diff(there, axis=0), axis=1).sum()
    shares = ", ".join(f"{word} {states.count(word) / len(states):.2f}" for word in ("ok", "degenerate", "lost"))
    print(f"{name}: {len(views)} views, way {way:.2f} m, ATE after Sim(3) {np.sqrt(np.mean(off**2)):.4f} m, {shares}")


if __name__ == "__main__":
    if "--help" in sys.argv:
        sys.exit(__doc__)
    for seed in range(3):
        judge(f"by hand, seed {seed}", *by_hand(seed))
    if len(sys.argv) == 3:
        judge(sys.argv[1], *recorded(*sys.argv[1:]))
