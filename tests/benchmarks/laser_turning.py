"""What it costs that the beams of a laser go round while the robot turns, and what is left of it: bags of drawn rooms, with
and without source.deskew.

    python tests/benchmarks/laser_turning.py --seeds 10 11 12 13 [--rate 10] [--turn 1.0] [--kind said|unsaid|reversed]

A robot drives 42 m through four rooms at 0.5 m/s and turns on the spot at --turn rad/s; its wheels read 1 % too much and
slip. said: `time_increment` is right; unsaid: it is 0; reversed: the beams go to the right, as where a driver turns them
round and leaves its times; instant: all beams at once, as a simulator's, though times are written.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from bags import BagFile
from laser_rooms import box, drive

from rhs.estimation.scans.planar_poses import between, composed

BEAMS, MOST_M, DENSE_HZ, WHEEL_HZ, BEGIN_S = 360, 12.0, 200, 30.0, 1.6e9
WAY_M = [(1.5, 1.5), (4.6, 1.4), (5, 3.6), (7.5, 3.6), (10.5, 2), (10.6, 4), (9.6, 6.5), (7.2, 6.6), (9.6, 6.3), (9.6, 4),
         (7.5, 3.6), (5, 3.6), (2.6, 3.9), (2.6, 6.5), (4.8, 6.8), (2.6, 6.2), (2.6, 3.5), (1.5, 1.5)]
INNER_M = [((6, 0), (6, 3)), ((6, 4.2), (6, 8)), ((6, 5), (9, 5)), ((10.2, 5), (12, 5)), ((0, 4.5), (2, 4.5)),
           ((3.2, 4.5), (6, 4.5))]


def driven(turn_radps: float) -> np.ndarray:
    """(N, 3) poses, DENSE_HZ a second, of a drive that begins and ends its turns gently."""
    poses = drive(WAY_M, step_m=0.5 / DENSE_HZ, step_rad=turn_radps / DENSE_HZ)
    poses[:, 2] = np.unwrap(poses[:, 2])
    wide = DENSE_HZ // 2
    padded = np.pad(poses, ((wide, wide), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, np.ones(wide) / wide, "same")[wide:-wide] for column in padded.T], axis=1)


def rooms(rng: np.random.Generator, way: np.ndarray) -> np.ndarray:
    """(W, 2, 2) walls and boxes that stand beside the way."""
    walls = [box(0.0, 0.0, 12.0, 8.0), np.array(INNER_M, float)]
    for _ in range(14):
        (x, y), side = rng.uniform([0.5, 0.5], [11.0, 7.0]), rng.uniform(0.2, 0.6)
        if np.hypot(*(way[:, :2] - [x + 0.5 * side, y + 0.35 * side]).T).min() > 0.7 * side + 0.3:
            walls.append(box(x, y, x + side, y + 0.7 * side))
    return np.concatenate(walls)


def ranges_at(walls: np.ndarray, poses: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    """(N,) metres of beams that leave at poses (N, 3), inf beyond MOST_M."""
    ray = np.stack([np.cos(poses[:, 2] + bearings), np.sin(poses[:, 2] + bearings)], axis=1)[:, None]
    start, along = walls[None, :, 0] - poses[:, None, :2], (walls[:, 1] - walls[:, 0])[None]
    with np.errstate(divide="ignore", invalid="ignore"):
        cross = ray[..., 0] * along[..., 1] - ray[..., 1] * along[..., 0]
        reach = (start[..., 0] * along[..., 1] - start[..., 1] * along[..., 0]) / cross
        share = (start[..., 0] * ray[..., 1] - start[..., 1] * ray[..., 0]) / cross
    near = np.where((reach > 0) & (share >= 0) & (share <= 1), reach, np.inf).min(axis=1)
    return np.where(near < MOST_M, near, np.inf)


def write(folder: Path, seed: int, rate_hz: float, turn_radps: float, kind: str) -> Path:
    """A bag with /scan, /odom and /truth."""
    rng, way = np.random.default_rng(seed), driven(turn_radps)
    walls, times = rooms(rng, way), np.arange(len(way)) / DENSE_HZ
    bearings = -np.pi + 2.0 * np.pi / BEAMS * np.arange(BEAMS)
    after_s = np.arange(BEAMS)[:: -1 if kind == "reversed" else 1] / (rate_hz * BEAMS) * (kind != "instant")

    def at(moments: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(moments, times, column) for column in way.T], axis=-1)

    events = []
    for begin_s in np.arange(0.0, times[-1] - 1.0 / rate_hz, 1.0 / rate_hz):
        ranges = ranges_at(walls, at(begin_s + after_s), bearings) + 0.01 * rng.normal(size=BEAMS)
        events.append((begin_s + 1.0 / rate_hz, "scan", begin_s, ranges))
    wheel, moments = np.zeros(3), np.arange(0.0, times[-1], 1.0 / WHEEL_HZ)
    true = at(moments)
    for moment, step in zip(moments, np.vstack([np.zeros(3), between(true[:-1], true[1:])]), strict=True):
        wheel = composed(wheel, step * 1.01 + 0.02 * np.abs(step) * rng.normal(size=3))
        events.append((moment, "odom", moment, wheel))
    events += [(moment, "truth", moment, at(moment)) for moment in np.arange(0.0, times[-1], 0.02)]
    with BagFile(folder, "ros2_mcap") as bag:
        for arrived_s, topic, stamp_s, value in sorted(events, key=lambda event: event[0]):
            bag.clock_s, stamp_s = BEGIN_S + arrived_s, BEGIN_S + stamp_s
            if topic == "odom":
                bag.odometry("/odom", stamp_s, *value)
            elif topic == "truth":
                bag.put("/truth", stamp_s, bag.make("geometry_msgs/msg/PoseStamped", header=bag.header(stamp_s, "world"),
                                                    pose=bag.pose(*value)))
            else:
                bag.put("/scan", stamp_s, bag.make(
                    "sensor_msgs/msg/LaserScan", header=bag.header(stamp_s, "laser"), angle_min=-np.pi,
                    angle_max=float(bearings[-1]), angle_increment=2.0 * np.pi / BEAMS, scan_time=1.0 / rate_hz,
                    time_increment=0.0 if kind == "unsaid" else 1.0 / (rate_hz * BEAMS), range_min=0.1, range_max=MOST_M,
                    ranges=value.astype(np.float32), intensities=np.zeros(0, np.float32)))
    return bag.path


def ate_m(bag: Path, *, deskew: bool, output: Path) -> float:
    words = ["source=replay", f"source.path={bag}", "sensor=laser", "source.truth_topic=/truth", f"source.deskew={deskew}",
             f"output={output}", "pictures=off"]
    subprocess.run([sys.executable, "-m", "rhs", *words], check=False, capture_output=True)
    return float(json.loads(next(output.rglob("row.json")).read_text())["ate_rmse_m"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[10, 11])
    parser.add_argument("--rate", type=float, default=10.0)
    parser.add_argument("--turn", type=float, default=1.0)
    parser.add_argument("--kind", choices=("said", "unsaid", "reversed", "instant"), default="said")
    chosen = parser.parse_args()
    print("seed  as seen  put right (ATE, m)")
    for seed in chosen.seeds:
        with tempfile.TemporaryDirectory() as folder:
            bag = write(Path(folder), seed, chosen.rate, chosen.turn, chosen.kind)
            found = [ate_m(bag, deskew=deskew, output=Path(folder) / str(deskew)) for deskew in (False, True)]
            print(f"{seed:4d}  {found[0]:7.4f}  {found[1]:.4f}", flush=True)


if __name__ == "__main__":
    main()
