"""Point clouds in files: PCD (ascii, binary, binary_compressed), .bin (bins.py) and PLY.

PCD: https://pointclouds.org/documentation/tutorials/pcd_file_format.html. binary_compressed holds its fields one after the
other, packed with LZF (Lehmann's liblzf).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..replay_images import UnreadableImage
from ..replay_stamps import TIME_FIELDS
from .bins import KITTI, points_in

FURTHEST_M = 500.0  # lasers that look round see less
SUFFIXES = (".pcd", ".bin", ".ply")
MOST_POINTS = 20_000_000  # of one view
MOST_HEAD = 10_000  # bytes
_KINDS = {("F", 4): "<f4", ("F", 8): "<f8", ("I", 1): "i1", ("I", 2): "<i2", ("I", 4): "<i4", ("I", 8): "<i8",
          ("U", 1): "u1", ("U", 2): "<u2", ("U", 4): "<u4", ("U", 8): "<u8"}
_PLY = {"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
        "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
        "double": "f8", "float64": "f8"}


class UnreadableCloud(UnreadableImage):
    """A file that holds no cloud; what else the recording holds may be whole."""


def read_cloud(path: Path, layout: str = KITTI) -> tuple[np.ndarray, np.ndarray | None]:
    """(N, 3) float32 finite points of a file, in its own frame, and the time of each as it stands there (N,), or None where
    it has none. layout: of a .bin (bins.py). Raises UnreadableCloud."""
    if not path.is_file():
        raise UnreadableCloud(f"{path}: found no such file; expected a point cloud")
    kind = path.suffix.lower()
    try:
        points = _bin(path, layout) if kind == ".bin" else {".pcd": _pcd, ".ply": _ply}[kind](path)
    except (ValueError, IndexError, KeyError, OverflowError, StopIteration) as error:
        short = " ".join(str(error).split())[:120]
        raise UnreadableCloud(f"{path}: found {path.stat().st_size} bytes that are no {path.suffix[1:].lower()} cloud "
                              f"({short}); expected points with x, y, z") from None
    finite = points[np.isfinite(points[:, :3]).all(axis=1) & points[:, :3].any(axis=1)]  # at the scanner: met nothing
    some = finite[::16, :3].astype(float)
    if len(some) and (away := float(np.median(np.linalg.norm(some, axis=1)))) > FURTHEST_M:
        raise UnreadableCloud(f"{path}: its points are typically {away:.3g} away; expected metres from the scanner "
                              "(millimetres divided by 1000, no coordinates of a country)")
    return np.ascontiguousarray(finite[:, :3], np.float32), finite[:, 3] if finite.shape[1] > 3 else None


def _bin(path: Path, layout: str) -> np.ndarray:
    _check_count(path.stat().st_size // 8)
    return points_in(path.read_bytes(), layout)


def viewpoint_of(path: Path) -> np.ndarray | None:
    """(3,) where the scanner was by the head of a .pcd; None where it says nothing."""
    if path.suffix.lower() != ".pcd":
        return None
    try:
        with path.open("rb") as file:
            head, _ = _head(file.read(MOST_HEAD))
        at = np.array(head["VIEWPOINT"][:3], float)
    except (ValueError, KeyError, OSError):
        return None
    return at if at.shape == (3,) and np.isfinite(at).all() else None


def _head(data: bytes) -> tuple[dict[str, list[str]], int]:
    """The words of a .pcd's head by their keys, and where it ends. Raises ValueError."""
    head: dict[str, list[str]] = {}
    at = 0
    while "DATA" not in head:
        end = data.index(b"\n", at, MOST_HEAD + at)
        words = data[at:end].decode("ascii", "replace").split("#", 1)[0].split()
        at = end + 1
        if words:
            head[words[0].upper()] = words[1:]
        if at > MOST_HEAD:
            raise ValueError(f"no DATA in its first {MOST_HEAD} bytes")
    return head, at


def _pcd(path: Path) -> np.ndarray:
    data = path.read_bytes()
    head, at = _head(data)
    names = head["FIELDS"]
    counts = [int(v) for v in head.get("COUNT", ["1"] * len(names))]
    kinds = [_KINDS[(kind, int(size))] for kind, size in zip(head["TYPE"], head["SIZE"], strict=True)]
    total = int(head["POINTS"][0]) if "POINTS" in head else int(head["WIDTH"][0]) * int(head["HEIGHT"][0])
    _check_count(total)
    fields = [(name, kind, count) for name, kind, count in zip(names, kinds, counts, strict=True)]
    if head["DATA"][0] == "ascii":
        return _columns(data[at:].decode("ascii", "replace"), fields, total)
    if head["DATA"][0] == "binary":
        table = np.frombuffer(data, _table(fields), total, at)
        return _picked(table)
    if head["DATA"][0] != "binary_compressed":
        raise ValueError(f"DATA is {head['DATA'][0]}")
    packed, size = (int(v) for v in np.frombuffer(data, "<u4", 2, at))
    if size != total * _table(fields).itemsize or at + 8 + packed > len(data):
        raise ValueError(f"{size} bytes for {total} points, {packed} of them packed")
    return _by_field(unpacked_lzf(data[at + 8 : at + 8 + packed], size), fields, total)


def _table(fields) -> np.dtype:
    """The layout of one point; fields called `_` are padding, and may come more than once."""
    return np.dtype([(f"{name}{i}" if name == "_" else name, kind, (count,) if count > 1 else ())
                     for i, (name, kind, count) in enumerate(fields)])


def _wanted(names) -> list[str]:
    """x, y, z, and the first field that is a time."""
    return [*"xyz", *[name for name in TIME_FIELDS if name in names][:1]]


def _picked(table: np.ndarray) -> np.ndarray:
    return np.stack([table[name].astype(float) for name in _wanted(table.dtype.names)], axis=1)


def _columns(text: str, fields, total: int) -> np.ndarray:
    """What is wanted of numbers in lines."""
    width = sum(count for _, _, count in fields)
    starts = np.cumsum([0, *(count for _, _, count in fields)])
    numbers = np.array(text.split()[: total * width], float).reshape(total, width)
    names = [name for name, _, _ in fields]
    return numbers[:, [starts[names.index(name)] for name in _wanted(names)]]


def _by_field(data: bytes, fields, total: int) -> np.ndarray:
    """What is wanted where all values of one field come before those of the next."""
    found, at = {}, 0
    wanted = _wanted([name for name, _, _ in fields])
    for name, kind, count in fields:
        if name in wanted:
            found[name] = np.frombuffer(data, kind, total * count, at)[::count].astype(float)
        at += total * count * np.dtype(kind).itemsize
    return np.stack([found[name] for name in wanted], axis=1)


def unpacked_lzf(data: bytes, size: int) -> bytes:
    """LZF (liblzf): a byte below 32 begins so many literals and one more; any other a copy of 3 bits' length (7: and a byte)
    from 13 bits' distance behind. Raises ValueError for data that do not come to `size` bytes."""
    out, at = bytearray(), 0
    while at < len(data):
        control = data[at]
        at += 1
        if control < 32:
            out += data[at : at + control + 1]
            at += control + 1
            continue
        length = control >> 5
        if length == 7:
            length += data[at]
            at += 1
        begin = len(out) - ((control & 31) << 8) - data[at] - 1
        at += 1
        if begin < 0 or len(out) > size:
            raise ValueError("its packed data point outside themselves")
        piece = out[begin : begin + length + 2]
        while len(piece) < length + 2:  # a copy that overlaps itself repeats
            piece += piece[: length + 2 - len(piece)]
        out += piece
    if len(out) != size:
        raise ValueError(f"unpacked to {len(out)} bytes, {size} said")
    return bytes(out)


def _ply(path: Path) -> np.ndarray:
    data = path.read_bytes()
    end = data.index(b"end_header", 0, MOST_HEAD)
    at = data.index(b"\n", end) + 1
    form, total, inside = "", 0, False
    fields: list[tuple[str, str, int]] = []
    for line in data[:end].decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["format"]:
            form = words[1]
        elif words[:1] == ["element"]:
            inside = words[1] == "vertex"
            if not inside and not fields:
                raise ValueError("its first element is not vertex")
            total = int(words[2]) if inside else total
        elif words[:1] == ["property"] and inside:
            fields.append((words[-1], _PLY[words[1]], 1))
    _check_count(total)
    if form == "ascii":
        return _columns(data[at:].decode("ascii", "replace"), fields, total)
    order = {"binary_little_endian": "<", "binary_big_endian": ">"}[form]
    return _picked(np.frombuffer(data, _table([(name, order + kind, 1) for name, kind, _ in fields]), total, at))


def _check_count(total: int) -> None:
    if not 0 < total <= MOST_POINTS:
        raise ValueError(f"{total} points; 1 to {MOST_POINTS} are read")
