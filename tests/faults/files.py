"""Files that faults are made of: pictures, TUM folders, maps, recordings."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from painted_room import observe, paintings

from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, camera_from_fov, se2

CAMERA = camera_from_fov(160, 120, 70.0, height_m=1.0)
REPLAY = [
    "task=survey",
    "source=replay",
    "source.path=tum",
    "recording=off",
    "pictures=off",
    "output=run",
    f"source.camera=[{CAMERA.fx},{CAMERA.fy},{CAMERA.cx},{CAMERA.cy}]",
]


def png(width: int, height: int, *, bits: int = 8, colour: int = 0) -> bytes:
    """A PNG of one colour: 20000 x 20000 in 400 kB."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    packer, row, packed = zlib.compressobj(9), bytes(1 + width * bits // 8), b""
    for _ in range(height):
        packed += packer.compress(row)
    head = struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed + packer.flush()) + chunk(b"IEND", b"")


def tum(
    folder: Path,
    images: Sequence[np.ndarray],
    depths: Sequence[np.ndarray],
    *,
    stamps: Sequence[float] = (),
    poses: Sequence[np.ndarray] = (),
) -> Path:
    """A TUM folder. images: (H, W) or (H, W, 3) uint8; depths: (H, W) metres, or integers as they are to be stored; poses:
    true world_from_body."""
    import cv2

    stamps = stamps or [0.2 * n for n in range(len(images))]
    for name, pictures in (("rgb", images), ("depth", [_stored(depth) for depth in depths])):
        (folder / name).mkdir(parents=True)
        lines = []
        for number, (stamp, picture) in enumerate(zip(stamps, pictures, strict=True)):
            assert cv2.imwrite(str(folder / name / f"{number}.png"), picture)
            lines.append(f"{stamp:.6f} {name}/{number}.png\n")
        (folder / f"{name}.txt").write_text("".join(lines))
    if len(poses):
        (folder / "groundtruth.txt").write_text(
            "".join(_line(stamp, pose) for stamp, pose in zip(stamps, poses, strict=True))
        )
    return folder


def _stored(depth: np.ndarray) -> np.ndarray:
    if np.issubdtype(depth.dtype, np.integer):
        return depth
    return np.where(np.isfinite(depth) & (depth < 13.0), np.rint(5000.0 * np.nan_to_num(depth)), 0).astype(np.uint16)


def _line(stamp: float, body: np.ndarray) -> str:
    from scipy.spatial.transform import Rotation

    rotation = body[:3, :3] @ BODY_FROM_OPTICAL[:3, :3]
    numbers = [*body[:3, 3], *Rotation.from_matrix(rotation).as_quat()]
    return " ".join([f"{stamp:.6f}", *(f"{number:.9f}" for number in numbers)]) + "\n"


def seen(poses: Sequence[np.ndarray], camera: Camera = CAMERA) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Images (H, W) and depths (H, W) metres of the painted room from these poses (world_from_body)."""
    views = [observe(camera, pose, paintings()) for pose in poses]
    return [np.asarray(view.image[:, :, 0]) for view in views], [np.asarray(view.depth, float) for view in views]


def drive(count: int = 8, forward_m: float = 0.1, turn_rad: float = 0.05) -> list[np.ndarray]:
    """Poses of a drive through the painted room."""
    poses = [se2(-1.5, -0.5, 0.2)]
    for _ in range(count - 1):
        poses.append(poses[-1] @ se2(forward_m, 0.0, turn_rad))
    return poses


def corridor(poses: Sequence[np.ndarray], half_m: float = 1.0, height_m: float = 2.5) -> list[np.ndarray]:
    """Depths (H, W) metres of an endless corridor along x with plain walls; only the way across it can be seen."""
    v, u = np.mgrid[0 : CAMERA.height, 0 : CAMERA.width]
    rays = CAMERA.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    out = []
    for pose in poses:
        world = pose @ CAMERA.body_from_camera
        ways = rays @ world[:3, :3].T
        with np.errstate(divide="ignore"):
            sides = np.where(ways[:, 1] > 0, half_m - world[1, 3], -half_m - world[1, 3]) / ways[:, 1]
            floors = np.where(ways[:, 2] > 0, height_m - world[2, 3], -world[2, 3]) / ways[:, 2]
        reach = np.minimum(np.abs(sides), np.abs(floors))
        depth = reach * rays[:, 2]
        out.append(np.where(depth < 8.0, depth, np.nan).reshape(CAMERA.height, CAMERA.width))
    return out


def chunk_bomb(records: bytes, count: int) -> bytes:
    """An MCAP file whose chunks all hold these records, packed well."""
    import zstandard

    packed = zstandard.ZstdCompressor(level=3).compress(records)
    head = struct.pack("<QQQI", 0, 0, len(records), 0) + struct.pack("<I", 4) + b"zstd"
    body = head + struct.pack("<Q", len(packed)) + packed
    header = struct.pack("<BQ", 1, 8) + struct.pack("<II", 0, 0)
    return b"\x89MCAP0\r\n" + header + (struct.pack("<BQ", 6, len(body)) + body) * count


MAP = "image: m.pgm\nresolution: {resolution}\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"


def pgm(rows: Sequence[str], *, claims: tuple[int, int] | None = None) -> bytes:
    """A grey map, '#' occupied, '?' unknown; claims: (width, height) that the head lies about."""
    grey = {"#": 0, ".": 254, "?": 205}
    width, height = claims or (len(rows[0]), len(rows))
    return f"P5\n{width} {height}\n255\n".encode() + bytes(grey[c] for row in rows for c in row)
