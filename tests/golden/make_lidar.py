"""Writes clouds/: the clouds of a lidar that drives along a furnished room, as a folder of BIN files (x, y, z, intensity),
and poses.txt, where it was.

    python tests/golden/make_lidar.py
"""

from pathlib import Path

import numpy as np

SIZE_M, RINGS, BEAMS, NOISE_M, HEIGHT_M = (8.0, 5.0, 2.5), 8, 90, 0.01, 0.6
BOX_M = np.array([[5.0, 3.0, 0.0], [6.0, 4.2, 1.2]])


def main() -> None:
    rng = np.random.default_rng(17)
    folder = Path(__file__).with_name("clouds")
    folder.mkdir(exist_ok=True)
    up, round_rad = np.radians(np.linspace(-15.0, 15.0, RINGS)), 2.0 * np.pi * np.arange(BEAMS) / BEAMS
    ray = np.stack([np.outer(np.cos(up), np.cos(round_rad)), np.outer(np.cos(up), np.sin(round_rad)),
                    np.repeat(np.sin(up)[:, None], BEAMS, axis=1)], axis=-1).reshape(-1, 3)
    for k in range(8):
        reach_m = distance(np.array([2.0 + 0.15 * k, 2.0, HEIGHT_M]), ray) + NOISE_M * rng.standard_normal(len(ray))
        points = np.hstack([ray * reach_m[:, None], np.ones((len(ray), 1))])
        (folder / f"{k:06d}.bin").write_bytes(points.astype("<f4").tobytes())
    poses = [f"1 0 0 {0.15 * k:.2f} 0 1 0 0 0 0 1 0\n" for k in range(8)]
    (folder / "poses.txt").write_text("".join(poses))


def distance(at: np.ndarray, ray: np.ndarray) -> np.ndarray:
    """To the walls, floor and ceiling of the room or to the box in it, along each ray."""
    with np.errstate(divide="ignore", invalid="ignore"):
        walls = np.where(ray > 0, np.array(SIZE_M) - at, -at) / ray
        ends = (BOX_M[:, None] - at) / ray
    near, far = np.fmin(*ends).max(axis=1), np.fmax(*ends).min(axis=1)
    room = np.nanmin(np.where(np.isfinite(walls), walls, np.nan), axis=1)
    return np.where((near < far) & (near > 0.0) & (near < room), near, room)


if __name__ == "__main__":
    main()
