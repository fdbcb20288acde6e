"""How large an image says it is, from its first bytes: a small file could ask for all the memory there is."""

from __future__ import annotations

import re
from pathlib import Path

from rhs.base.errors import ConfigError

MOST_PIXELS = 64_000_000  # of an image of a camera
HEAD_BYTES = 1 << 16  # the size stands in these
TIFF, MOST_TIFF_BYTES = (b"II*\0", b"MM\0*"), 1 << 28
_PNM = re.compile(rb"P[1-6Ff](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
_JPEG_FRAMES = frozenset({*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC})


def declared_size(data: bytes) -> tuple[int, int] | None:
    """(width, height) in pixels that the head of a PNG, JPEG, BMP, PNM, PFM, GIF, WebP or TIFF claims; None where it is
    none of these."""
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) >= 24:
        return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    if data[:2] == b"BM" and len(data) >= 26:
        width, height = (abs(int.from_bytes(data[k: k + 4], "little", signed=True)) for k in (18, 22))
        return width, height
    if data[:3] == b"\xff\xd8\xff":
        return _jpeg_size(data)
    if data[:4] == b"GIF8" and len(data) >= 10:
        return int.from_bytes(data[6:8], "little"), int.from_bytes(data[8:10], "little")
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP" and len(data) >= 30:
        return _webp_size(data)
    if data[:4] in TIFF:
        return _tiff_size(data)
    numbers = _PNM.match(data)
    return None if numbers is None else (int(numbers[1]), int(numbers[2]))


def check_size(data: bytes, where: str, *, most: int = MOST_PIXELS) -> None:
    """Refuse an image that claims more pixels than `most`, before anything is decoded. Raises ConfigError."""
    size = declared_size(data)
    if size is not None and size[0] * size[1] > most:
        raise ConfigError(f"{where}: an image of {size[0]} x {size[1]} pixels; at most {most} are read")


def head_of(path: Path) -> bytes:
    """The first bytes of a file."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
        return head + file.read(MOST_TIFF_BYTES) if head[:4] in TIFF else head  # its size may stand at the end


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    """Segments follow one another, each with its length; a frame header (SOF) holds height and width (ITU T.81, B.2.2)."""
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        if data[at + 1] in _JPEG_FRAMES:
            return int.from_bytes(data[at + 7: at + 9]), int.from_bytes(data[at + 5: at + 7])
        at += 2 + int.from_bytes(data[at + 2: at + 4])
    return None


def _webp_size(data: bytes) -> tuple[int, int]:
    """By the first chunk: extended, lossless or lossy (Google, WebP Container Specification)."""
    if data[12:16] == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if data[12:16] == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    return int.from_bytes(data[26:28], "little") & 0x3FFF, int.from_bytes(data[28:30], "little") & 0x3FFF


def _tiff_size(data: bytes) -> tuple[int, int] | None:
    """Entries ImageWidth (256) and ImageLength (257) of the first directory (TIFF 6.0, section 2)."""
    def number(at: int, size: int) -> int:
        return int.from_bytes(data[at: at + size], "little" if data[:2] == b"II" else "big")

    at = number(4, 4)
    entries = range(at + 2, at + 2 + 12 * number(at, 2), 12)
    found = {number(k, 2): number(k + 8, 2 if number(k + 2, 2) == 3 else 4) for k in entries}
    return (found[256], found[257]) if {256, 257} <= set(found) else None
