"""A drive through a made street in the form of KITTI: what stereo, one camera and a lidar make of it.

    python tests/benchmarks/street.py --seeds 0 1 --sensors stereo mono lidar --out results/tables/street.csv

KITTI's grey cameras (1241x376, focal length 719 pixels, 0.54 m apart, 1.65 m high, 10 views a second) and a scanner of 64
rings with 2 cm of noise, taken at one instant; a car at up to 11 m/s that brakes for the corners and sways a little. No
sequence of KITTI itself: no sun, no traffic, houses of boxes. `ate_m`: aligned (one camera: with scale); `drift_pct`: of the
way, at its end. `--sensors turning`: the scanner turns once from view to view (36 steps, a time for each point), and beside
it the same clouds with `odometry.deskew=false`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from shared import write
from street_scene import driven, street

from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, exp_se3, inverse, log_se3, se3
from rhs_sources.raster.renderer import Mesh, Renderer

FOCAL, MIDDLE, SIZE = 718.856, (607.1928, 185.2157), (1241, 376)
BASELINE_M, HIGH_M = 0.5372, 1.65
CAMERA0_FROM_SCANNER = se3(BODY_FROM_OPTICAL.T, np.array([0.0, -0.08, -0.27]))
STEPS = 36  # of a turn
RINGS_RAD, NOISE_M, GREY_LEVELS = np.radians(np.linspace(2.0, -24.8, 64)), 0.02, 1.5
FIGURES = {"way_m": "distance_m", "ate_m": "ate_rmse_m", "drift_pct": "drift_pct", "tracked_share": "tracked_share",
           "odometry_ms": "odometry_ms", "sense_ms": "sense_ms"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--sensors", nargs="+", default=["stereo", "mono", "lidar"])
    parser.add_argument("--out", type=Path, default=Path("results/tables/street.csv"))
    parser.add_argument("words", nargs="*", help="key=value words of the runs")
    chosen = parser.parse_intermixed_args()
    rows: list[dict[str, Any]] = []
    for seed in chosen.seeds:
        with tempfile.TemporaryDirectory() as name:
            sequence = written(Path(name), seed, chosen.views, chosen.sensors)
            for sensor in chosen.sensors:
                for called, path, words in asked(sequence, sensor):
                    row = run(path, [*words, *chosen.words], Path(name) / called)
                    rows.append({"seed": seed, "sensor": called} | {word: row.get(key) for word, key in FIGURES.items()})
                    write(chosen.out, rows)
    print(chosen.out.read_text())


def asked(sequence: Path, sensor: str) -> list[tuple[str, Path, list[str]]]:
    """(name, recording, words) of the runs."""
    if sensor != "turning":
        return [(sensor, sequence, [f"sensor={sensor}"])]
    clouds = sequence / "turning"
    return [("turning", clouds, ["sensor=lidar"]), ("turning_as_seen", clouds, ["sensor=lidar", "odometry.deskew=false"])]


def run(recording: Path, words: list[str], out: Path) -> dict[str, Any]:
    command = [sys.executable, "-m", "rhs", "source=replay", f"source.path={recording}", f"output={out}",
               "recording=off", "pictures=off", *words]
    subprocess.run(command, check=True)
    return json.loads((out / "row.json").read_text())


def written(folder: Path, seed: int, views: int, sensors: list[str]) -> Path:
    """The folder sequences/07 of a drive, as KITTI's are, and in it `turning` with the clouds of a scanner that turns."""
    rng = np.random.default_rng(seed)
    mesh, sequence = street(rng), folder / "sequences" / "07"
    for name in ("image_0", "image_1", "velodyne"):
        (sequence / name).mkdir(parents=True)
    (sequence / "calib.txt").write_text(calibration())
    np.savetxt(sequence / "times.txt", 0.1036 * np.arange(views))
    body_from_camera = se3(BODY_FROM_OPTICAL, np.array([0.0, 0.0, HIGH_M]))
    mounts = body_from_camera, body_from_camera @ se3(np.eye(3), np.array([BASELINE_M, 0.0, 0.0]))
    eyes = [Renderer(Camera(*SIZE, FOCAL, FOCAL, *MIDDLE, body_from_camera=mount)) for mount in mounts]
    scanner, sway = Scanner(4), 2.0 * gaussian_filter1d(rng.standard_normal((views, 3)) * [1e-3, 2e-3, 2e-3], 3.0, axis=0)
    poses = []
    for i, (x, y, yaw) in enumerate(driven(views, rng)):
        turn = Rotation.from_euler("ZYX", np.array([yaw, 0.0, 0.0]) + sway[i]).as_matrix()
        body = se3(turn, np.array([x, y, 0.01 * np.sin(i / 5)]))
        for name, eye in zip(("image_0", "image_1"), eyes, strict=True):
            grey = cv2.cvtColor(eye.render(mesh, body)[0], cv2.COLOR_RGB2GRAY) + rng.normal(0.0, GREY_LEVELS, SIZE[::-1])
            cv2.imwrite(str(sequence / name / f"{i:06d}.png"), np.clip(grey, 0, 255).astype(np.uint8))
        poses.append(body @ body_from_camera)
        scanner.cloud(mesh, poses[-1] @ CAMERA0_FROM_SCANNER, rng).tofile(sequence / "velodyne" / f"{i:06d}.bin")
    if "turning" in sensors:
        write_turning(sequence / "turning", mesh, [pose @ CAMERA0_FROM_SCANNER for pose in poses], rng)
    (folder / "poses").mkdir()
    np.savetxt(folder / "poses" / "07.txt", [(inverse(poses[0]) @ pose)[:3].ravel() for pose in poses])
    return sequence


def calibration() -> str:
    """calib.txt: P0 to P3 and Tr."""
    rows = {f"P{k}": np.array([[FOCAL, 0, MIDDLE[0], shift], [0, FOCAL, MIDDLE[1], 0], [0, 0, 1, 0]])
            for k, shift in enumerate((0.0, -FOCAL * BASELINE_M) * 2)}
    rows["Tr"] = CAMERA0_FROM_SCANNER[:3]
    return "".join(f"{name}: {' '.join(f'{v:.12e}' for v in matrix.ravel())}\n" for name, matrix in rows.items())


def write_turning(folder: Path, mesh: Mesh, poses: list[np.ndarray], rng: np.random.Generator) -> None:
    """Clouds as .pcd with the time of each point, and poses.txt of the scanner at the beginning of each turn."""
    folder.mkdir()
    scanner, period_s = Scanner(STEPS), 0.1036
    for i, (pose, after) in enumerate(zip(poses[:-1], poses[1:], strict=True)):
        twist, points, times = log_se3(inverse(pose) @ after), [], []
        for k in range(STEPS):
            share = k / STEPS
            points.append(scanner.part(k, mesh, pose @ exp_se3(share * twist), rng))
            times.append(np.full(len(points[-1]), share * period_s))
        table = np.column_stack([np.concatenate(points), np.concatenate(times)]).astype("<f4")
        head = (f"VERSION 0.7\nFIELDS x y z time\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH {len(table)}\nHEIGHT 1\n"
                f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(table)}\nDATA binary\n")
        (folder / f"{i * period_s:.6f}.pcd").write_bytes(head.encode() + table.tobytes())
    np.savetxt(folder / "poses.txt", [pose[:3].ravel() for pose in poses[:-1]])


class Scanner:
    """A lidar of 64 rings of 1800 beams, cut from the depths of cameras that look round, each `1 / parts` of it."""

    def __init__(self, parts: int) -> None:
        half = 180.0 / parts
        bearing, rise = np.meshgrid(np.radians(np.arange(-half, half, 0.2)), RINGS_RAD)
        self.rays = np.stack([-np.tan(bearing), -np.tan(rise) / np.cos(bearing), np.ones_like(rise)], axis=-1).reshape(-1, 3)
        turns = [Rotation.from_euler("z", 2 * half * k, degrees=True).as_matrix() @ BODY_FROM_OPTICAL for k in range(parts)]
        width = 2 * round(450.0 * np.tan(np.radians(half)))
        flat = Camera(width, 600, 450.0, 450.0, 0.5 * (width - 1), 299.5)
        self.eyes = [Renderer(replace(flat, body_from_camera=se3(turn, np.zeros(3))), probes=0) for turn in turns]

    def cloud(self, mesh: Mesh, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(N, 4) float32 x, y, z, intensity of what is 2 to 100 m away."""
        points = np.concatenate([self.part(k, mesh, pose, rng) for k in range(len(self.eyes))])
        return np.column_stack([points, np.full(len(points), 0.3)]).astype(np.float32)

    def part(self, k: int, mesh: Mesh, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """(N, 3) points that the k-th camera sees from there."""
        camera = self.eyes[k].camera
        depth = self.eyes[k].render(mesh, pose)[1]
        u, v = np.rint(camera.project(self.rays)).astype(int).T
        points = self.rays * depth[np.clip(v, 0, camera.height - 1), np.clip(u, 0, camera.width - 1)][:, None]
        points = points @ camera.body_from_camera[:3, :3].T
        far = np.linalg.norm(points, axis=1)
        seen = (far > 2.0) & (far < 100.0)  # false for NaN
        return points[seen] * (1.0 + rng.normal(0.0, NOISE_M, seen.sum()) / far[seen])[:, None]


if __name__ == "__main__":
    main()
