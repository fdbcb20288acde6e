"""Random numbers: one generator for each part, spawned by name."""

from __future__ import annotations

import hashlib

import numpy as np


def generator(seed: int, part: str) -> np.random.Generator:
    """A random generator of its own for each part, by name: no part's draws move another's."""
    key = int.from_bytes(hashlib.sha256(part.encode()).digest()[:4], "big")
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=(key,)))
