"""A flight through a made room in the form of EuRoC: what two eyes and one make of it.

    python tests/benchmarks/flight.py --seeds 0 1 2 --out results/tables/flight.csv

The cameras of EuRoC's VI-sensor by the numbers of its files: 752x480, 20 views a second, lenses that bend straight lines, 11
cm apart and not parallel. Rooms of `hand_held_made.py` (plain walls too), round which it flies looking inwards at 0.5 to 1.3
m/s, the light going up and down by a tenth; true states as EuRoC's, no IMU. No sequence of EuRoC itself: no blur.
`ate_m`: aligned (one camera: with scale).
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from hand_held_made import room
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation
from shared import write
from street import FIGURES, run

from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, inverse, se3
from rhs_sources.lens import Lens
from rhs_sources.raster.renderer import Mesh, Renderer

LENSES = (((458.654, 457.296, 367.215, 248.375), (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)),
          ((457.587, 456.134, 379.999, 255.238), (-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05)))
BODY_FROM_CAMERA = (
    np.array([[0.0148655429818, -0.999880929698, 0.00414029679422, -0.0216401454975],
              [0.999557249008, 0.0149672133247, 0.025715529948, -0.064676986768],
              [-0.0257744366974, 0.00375618835797, 0.999660727178, 0.00981073058949], [0.0, 0.0, 0.0, 1.0]]),
    np.array([[0.0125552670891, -0.999755099723, 0.0182237714554, -0.0198435579556],
              [0.999598781151, 0.0130119051815, 0.0251588363115, 0.0453689425024],
              [-0.0253898008918, 0.0179005838253, 0.999517347078, 0.00786212447038], [0.0, 0.0, 0.0, 1.0]]))
BEGUN_NS, STEP_NS = 1403715273262142976, 50_000_000
GREY_LEVELS = 2.5


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--views", type=int, default=160)
    parser.add_argument("--sensors", nargs="+", default=["stereo", "mono"])
    parser.add_argument("--out", type=Path, default=Path("results/tables/flight.csv"))
    parser.add_argument("words", nargs="*", help="key=value words of the runs")
    chosen = parser.parse_intermixed_args()
    rows: list[dict[str, Any]] = []
    for seed in chosen.seeds:
        with tempfile.TemporaryDirectory() as name:
            written(Path(name), seed, chosen.views)
            for sensor in chosen.sensors:
                row = run(Path(name), sensor, Path(name) / sensor, chosen.words)
                rows.append({"seed": seed, "sensor": sensor} | {word: row.get(key) for word, key in FIGURES.items()})
                write(chosen.out, rows)
    print(chosen.out.read_text())


def flown(mesh: Mesh, views: int, rng: np.random.Generator) -> list[np.ndarray]:
    """world_from_camera (4x4) of the left camera: round the room, nodding and rolling by up to some 10 degrees."""
    low, high = mesh.vertices_m.min(axis=0), mesh.vertices_m.max(axis=0)
    way = 2.0 * np.pi * np.arange(views) / 20.0 * rng.uniform(1.0, 2.5) / 14.0 + rng.uniform(0.0, 2.0 * np.pi)
    stands = np.stack([0.28 * np.cos(way), 0.28 * np.sin(way), 0.02 * np.sin(0.7 * way)], axis=1) * (high - low)
    stands += 0.5 * (low + high) + gaussian_filter1d(0.15 * rng.standard_normal((views, 3)), 8.0, axis=0)
    nods, rolls = gaussian_filter1d(0.25 * rng.standard_normal((2, views)), 6.0, axis=1)
    turns = Rotation.from_euler("ZYX", np.stack([way + np.pi + 0.3 * np.sin(2.0 * way), nods, rolls], axis=1)).as_matrix()
    return [se3(turn @ BODY_FROM_OPTICAL, at) for turn, at in zip(turns, stands, strict=True)]


def written(folder: Path, seed: int, views: int) -> None:
    """mav0 of a flight."""
    rng, (mesh, *_) = np.random.default_rng(seed), room(seed)
    stamps = [BEGUN_NS + STEP_NS * i for i in range(views)]
    bodies = [pose @ inverse(BODY_FROM_CAMERA[0]) for pose in flown(mesh, views, rng)]
    for k, ((numbers, bends), mount) in enumerate(zip(LENSES, BODY_FROM_CAMERA, strict=True)):
        cam = folder / "mav0" / f"cam{k}"
        (cam / "data").mkdir(parents=True)
        lens = Lens(Camera(752, 480, *numbers, distortion=(*bends, 0.0)), "flight")
        eye = Renderer(lens.ideal)
        for i, (stamp, body) in enumerate(zip(stamps, bodies, strict=True)):
            seen, _ = lens.bend(*eye.render(mesh, body @ mount @ inverse(lens.ideal.body_from_camera)))
            light = 0.7 + 0.07 * np.sin(i / 15)
            grey = light * cv2.cvtColor(seen, cv2.COLOR_RGB2GRAY) + rng.normal(0.0, GREY_LEVELS, seen.shape[:2])
            cv2.imwrite(str(cam / "data" / f"{stamp}.png"), np.clip(grey, 0, 255).astype(np.uint8))
        (cam / "data.csv").write_text("#timestamp [ns],filename\r\n" + "".join(f"{s},{s}.png\r\n" for s in stamps))
        (cam / "sensor.yaml").write_text(sensor_yaml(mount, numbers, bends))
    truth = folder / "mav0" / "state_groundtruth_estimate0"
    truth.mkdir()
    (truth / "sensor.yaml").write_text("sensor_type: visual-inertial\n" + mount_yaml(np.eye(4)))
    quaternions = [np.roll(Rotation.from_matrix(body[:3, :3]).as_quat(), 1) for body in bodies]
    lines = [",".join(map(str, (stamp, *body[:3, 3], *turn, *[0.0] * 9)))
             for stamp, body, turn in zip(stamps, bodies, quaternions, strict=True)]
    (truth / "data.csv").write_text("#timestamp, p, q_wxyz, v, b_w, b_a\n" + "\n".join(lines) + "\n")


def mount_yaml(mount: np.ndarray) -> str:
    return f"T_BS:\n  cols: 4\n  rows: 4\n  data: {[float(v) for v in mount.ravel()]}\n"


def sensor_yaml(mount: np.ndarray, numbers: tuple[float, ...], bends: tuple[float, ...]) -> str:
    return ("sensor_type: camera\n" + mount_yaml(mount) + "rate_hz: 20\nresolution: [752, 480]\ncamera_model: pinhole\n"
            f"intrinsics: {list(numbers)}\ndistortion_model: radial-tangential\ndistortion_coefficients: {list(bends)}\n")


if __name__ == "__main__":
    main()
