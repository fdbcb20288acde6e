"""Writes laser.clf: the scans of a robot that drives an L through a room of 8 m by 5 m, as a CARMEN log.

    python tests/golden/make_laser.py
"""

from pathlib import Path

import numpy as np

SIZE_M, BEAMS, RANGE_NOISE_M = (8.0, 5.0), 90, 0.01


def main() -> None:
    rng = np.random.default_rng(13)
    poses = [(1.0 + 0.2 * k, 1.0, 0.0) for k in range(21)]
    poses += [(5.0, 1.0, 0.1 * k) for k in range(1, 16)]
    poses += [(5.0, 1.0 + 0.2 * k, np.pi / 2) for k in range(11)]
    lines = []
    for k, (x, y, yaw) in enumerate(poses):
        bearings = yaw + np.radians(np.linspace(-90.0, 90.0, BEAMS))
        ranges = distance(x, y, bearings) + RANGE_NOISE_M * rng.standard_normal(BEAMS)
        drift = 0.002 * k
        pose = f"{x + drift:.4f} {y - drift:.4f} {yaw + 0.3 * drift:.5f}"
        beams = " ".join(f"{metres:.3f}" for metres in ranges)
        lines.append(f"FLASER {BEAMS} {beams} {pose} {pose} {0.5 * k:.3f} robot {0.5 * k:.3f}\n")
    Path(__file__).with_name("laser.clf").write_text("".join(lines))


def distance(x: float, y: float, bearings: np.ndarray) -> np.ndarray:
    """To the wall of the room, along each bearing."""
    c, s = np.cos(bearings), np.sin(bearings)
    with np.errstate(divide="ignore"):
        along_x = np.where(c > 0, (SIZE_M[0] - x) / c, -x / c)
        along_y = np.where(s > 0, (SIZE_M[1] - y) / s, -y / s)
    return np.minimum(along_x, along_y)


if __name__ == "__main__":
    main()
