"""RVL: 16-bit depth images packed without loss (Wilson, "Fast lossless depth image compression", ISS 2017).

Numbers stand in nibbles, three bits each and a fourth that says whether there are more, the highest nibble of a 32-bit
word first. A run of unknown pixels, a run of known ones, the differences of these (0, -1, 1, -2, ... as 0, 1, 2, 3, ...),
and so on. As image_transport sends it, width and height come before, each in 32 bits.
"""

from __future__ import annotations

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.pictures import MOST_PIXELS


def unpacked_rvl(data: np.ndarray, topic: str) -> np.ndarray:
    """(H, W) uint16 of (N,) bytes. Raises ConfigError for bytes that do not hold the image they say."""
    width, height = (int(v) for v in np.frombuffer(data[:8].tobytes(), "<u4")) if len(data) >= 8 else (0, 0)
    if not 0 < width * height <= MOST_PIXELS:
        raise ConfigError(f"{topic}: an RVL image says {width}x{height}; expected 1 to {MOST_PIXELS} pixels")
    words = np.frombuffer(data[8 : len(data) // 4 * 4].tobytes(), "<u4")
    nibbles = ((words[:, None] >> np.arange(28, -4, -4, dtype=np.uint32)) & 15).ravel().astype(np.int64)
    values = _numbers(nibbles)
    out = np.zeros(width * height, np.int64)
    at = taken = last = 0
    while at < len(out):
        if taken + 1 >= len(values):
            raise ConfigError(f"{topic}: an RVL image of {width}x{height} ends after {at} pixels")
        at, known = at + int(values[taken]), int(values[taken + 1])
        steps = values[taken + 2 : taken + 2 + known]
        if len(steps) < known or at + known > len(out):
            raise ConfigError(f"{topic}: an RVL image of {width}x{height} is cut or damaged at pixel {at}")
        if known:
            out[at : at + known] = last + np.cumsum((steps >> 1) ^ -(steps & 1))
            last = int(out[at + known - 1])
        at, taken = at + known, taken + 2 + known
    return out.astype(np.uint16).reshape(height, width)


def _numbers(nibbles: np.ndarray) -> np.ndarray:
    """The numbers that nibbles spell, three bits each, the lowest first; a nibble of 8 or more says that another follows."""
    ends = np.flatnonzero(nibbles < 8)
    if not len(ends):
        return np.empty(0, np.int64)
    starts = np.concatenate([[0], ends[:-1] + 1])
    place = np.arange(ends[-1] + 1) - np.repeat(starts, ends - starts + 1)
    return np.add.reduceat((nibbles[: ends[-1] + 1] & 7) << np.minimum(3 * place, 60), starts)
