"""Key-points of stored views in a quarter of the memory, descriptors to the bit: kept as the bytes that SIFT gave."""

from __future__ import annotations

import numpy as np

from rhs.api.records import Features, Thumbnail


class PackedFeatures(Features):
    """Features whose descriptors are made anew whenever they are asked for."""

    def __init__(self, pixels: np.ndarray, descriptors: np.ndarray | None, points: np.ndarray,
                 thumbnail: Thumbnail | None = None, sift: np.ndarray | None = None) -> None:
        """As Features, which dataclasses.replace counts on; the descriptors are not kept."""
        for name, value in (("pixels", pixels), ("points", points), ("thumbnail", thumbnail), ("sift", sift)):
            object.__setattr__(self, name, value)

    @property
    def descriptors(self) -> np.ndarray:
        """(N, 128) float32 RootSIFT."""
        assert self.sift is not None
        return rooted(self.sift)


def packed(features: Features) -> Features:
    """The same key-points, packed where that is possible."""
    if features.sift is None:
        return features
    return PackedFeatures(features.pixels, None, features.points, features.thumbnail, features.sift)


def held_bytes(features: Features | None) -> int:
    """Of the arrays that are kept of a view's features."""
    if features is None:
        return 0
    kept = vars(features).values()
    arrays = [array for value in kept for array in (vars(value).values() if isinstance(value, Thumbnail) else [value])]
    return sum(array.nbytes for array in arrays if array is not None)


def rooted(sift: np.ndarray) -> np.ndarray:
    """(N, 128) float32 RootSIFT (Arandjelovic, Zisserman 2012) of (N, 128) uint8 SIFT; not to be written to."""
    rows = sift.astype(np.float32)
    rows /= np.maximum(rows.sum(axis=1, keepdims=True), np.float32(1e-9))
    roots: np.ndarray = np.sqrt(rows, out=rows)
    roots.setflags(write=False)
    return roots
