"""A small vocabulary of ORB words in DBoW2's text form, for where ORB-SLAM3's own (139 MB) cannot be fetched.

A tree of BRANCHES words at each of LEVELS levels, k-majority over the descriptors of a recording (Galvez-Lopez and Tardos,
TRO 2012; the majority of bits is the mean of binary words). Smaller than ORB-SLAM3's, and of these frames alone.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

BRANCHES, LEVELS, ROUNDS, MOST_FRAMES = 8, 4, 5, 150


def trained(folder: Path) -> Path:
    """The file made of the colour images of a folder."""
    files = sorted((folder / "rgb").glob("*.png"))
    detector, words, image_of = cv2.ORB_create(1000), [], []
    for number, file in enumerate(files[:: max(len(files) // MOST_FRAMES, 1)]):
        found = detector.detectAndCompute(cv2.imread(str(file), cv2.IMREAD_GRAYSCALE), None)[1]
        if found is not None:
            words.append(found)
            image_of += [number] * len(found)
    lines: list[str] = []
    _split(np.concatenate(words), np.array(image_of), parent=0, level=1, lines=lines)
    path = folder / "vocabulary.txt"
    path.write_text("\n".join([f"{BRANCHES} {LEVELS} 0 0", *lines]))
    return path


def _split(words: np.ndarray, image_of: np.ndarray, *, parent: int, level: int, lines: list[str]) -> None:
    """Add the children of a node (its number; the root is 0) and theirs, in the order of their numbers."""
    bits = np.unpackbits(words, axis=1).astype(np.float32)
    middles = bits[np.linspace(0, len(bits) - 1, min(BRANCHES, len(bits))).astype(int)]
    for _ in range(ROUNDS):
        nearest = (middles.sum(axis=1) - 2.0 * bits @ middles.T).argmin(axis=1)
        middles = np.array([bits[nearest == k].mean(axis=0) > 0.5 if (nearest == k).any() else middles[k]
                            for k in range(len(middles))], np.float32)
    for k, middle in enumerate(middles):
        own = nearest == k
        if not own.any():
            continue
        leaf = level == LEVELS or own.sum() <= BRANCHES
        images = len(np.unique(image_of[own]))
        weight = np.log(max(int(image_of.max()) + 1, 2) / images) if leaf else 0.0
        code = " ".join(map(str, np.packbits(middle.astype(np.uint8))))
        lines.append(f"{parent} {int(leaf)} {code} {weight:.6f}")
        if not leaf:
            _split(words[own], image_of[own], parent=len(lines), level=level + 1, lines=lines)
