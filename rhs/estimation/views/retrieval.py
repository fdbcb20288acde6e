"""Which stored views look like this one? Three ways to rank them, from the thesis's to the one that scales.

All take RootSIFT descriptors (N, 128) float32 of unit length. `starts` (P + 1,) says which rows of the descriptors of
the memory (M, 128) belong to which of P views. Scores are for ranking only and mean something else in each class.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

WORDS_SAMPLE = 20_000  # descriptors that a vocabulary is learnt from: more do not change it noticeably
COMPRESS_ABOVE = 1_000  # views beyond which VLAD vectors are compressed ...
COMPRESSED = 256  # ... to so many numbers by principal components


class Retrieval(Protocol):
    """Ranks the stored views. `rank` returns (indices (T,), scores (T,)), best first, T <= top."""

    def rank(self, descriptors: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray]: ...


class Descriptors(Protocol):
    """(M, 128) float32 rows, all at once or made where they are looked at: an array, or
    rhs.estimation.views.place_memory.Rootsift."""

    def __len__(self) -> int: ...

    def __getitem__(self, which: Any) -> np.ndarray: ...


def make_retrieval(kind: str, descriptors: Descriptors, starts: np.ndarray, rng: np.random.Generator) -> Retrieval:
    """The ranking called `kind` over the descriptors of a memory; `vlad` looks at one view's at a time."""
    if kind == "votes":
        return Votes(descriptors[:], starts)
    if kind == "kd_tree":
        return KdTree(descriptors[:], starts, rng)
    return Vlad(descriptors, starts, rng)


class Votes:
    """Thesis section 5.2: match the view with every stored one; the number of matches is the score.

    A key-point votes for a view when its nearest descriptor there is `ratio` times nearer than the second nearest there.
    Exact, and linear in the size of the memory.
    """

    def __init__(self, descriptors: np.ndarray, starts: np.ndarray, ratio: float = 0.8) -> None:
        self._descriptors, self._starts, self._ratio = descriptors, starts, ratio

    def rank(self, descriptors: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray]:
        return _best(self.counts(descriptors), top)

    def counts(self, descriptors: np.ndarray, block: int = 64) -> np.ndarray:
        """(P,) number of key-points that match each stored view."""
        from .keypoint_kernels import count_matches

        counts = np.zeros(len(self._starts) - 1)
        for first in range(0, len(counts), block):
            bounds = self._starts[first : first + block + 1]
            likeness = descriptors @ self._descriptors[bounds[0] : bounds[-1]].T
            counts[first : first + block] = count_matches(likeness, bounds - bounds[0], self._ratio**2)
        return counts


class KdTree:
    """Votes through four randomised kd-trees (Muja and Lowe 2009, FLANN): every key-point looks up its few nearest
    descriptors in the whole memory and votes once for each view among them, by how near they are."""

    def __init__(self, descriptors: np.ndarray, starts: np.ndarray, rng: np.random.Generator) -> None:
        import cv2

        cv2.setNumThreads(1)
        cv2.setRNGSeed(int(rng.integers(1, 2**31)))  # the trees are random: the same generator, the same trees
        self._descriptors = np.ascontiguousarray(descriptors)
        self._tree = cv2.flann.Index(self._descriptors, {"algorithm": 1, "trees": 4})
        self._owner = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
        self._views = len(starts) - 1

    def rank(self, descriptors: np.ndarray, top: int, neighbours: int = 4) -> tuple[np.ndarray, np.ndarray]:
        neighbours = min(neighbours, len(self._owner))
        rows, squared = self._tree.knnSearch(np.ascontiguousarray(descriptors), neighbours, params={"checks": 48})
        if rows is None:
            return _best(np.zeros(self._views), top)
        weight = np.exp(-squared / 0.1)  # two RootSIFT descriptors of one point differ by about 0.1 squared
        scores = np.zeros(self._views)
        owners = self._owner[rows]
        for k in range(neighbours):
            fresh = np.all(owners[:, :k] != owners[:, k : k + 1], axis=1)
            np.add.at(scores, owners[fresh, k], weight[fresh, k])
        return _best(scores, top)


class Vlad:
    """One vector per view: residuals to the words of a small vocabulary, summed per word (Jegou et al. 2010), each word
    brought to unit length (Arandjelovic and Zisserman 2013). The score is the cosine.

    vectors (P, D): one per stored view, of unit length."""

    def __init__(
        self, descriptors: Descriptors, starts: np.ndarray, rng: np.random.Generator, words: int = 64
    ) -> None:
        self._words = _vocabulary(descriptors, min(words, max(len(descriptors) // 8, 1)), rng)
        self._half_squared = 0.5 * (self._words**2).sum(axis=1)
        vectors = np.empty((len(starts) - 1, self._words.size), np.float32)
        for k, (a, b) in enumerate(zip(starts[:-1], starts[1:], strict=True)):
            vectors[k] = self.vector(descriptors[a:b])
        self._basis = _principal(vectors) if len(vectors) > COMPRESS_ABOVE else None
        self.vectors = vectors if self._basis is None else _unit(vectors @ self._basis)

    def rank(self, descriptors: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray]:
        return _best(self.likeness(descriptors), top)

    def likeness(self, descriptors: np.ndarray) -> np.ndarray:
        """(P,) cosine between the view and each stored one."""
        vector = self.vector(descriptors)
        cosines: np.ndarray = self.vectors @ (vector if self._basis is None else _unit(vector @ self._basis))
        return cosines

    def vector(self, descriptors: np.ndarray) -> np.ndarray:
        """(words * 128,) float32 of unit length, zero for a view without key-points."""
        from .keypoint_kernels import residuals

        return residuals(descriptors, descriptors @ self._words.T - self._half_squared, self._words)


def _best(scores: np.ndarray, top: int) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(-scores, kind="stable")[:top]
    return order, scores[order]


def _unit(rows: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(rows, axis=-1, keepdims=True)
    return rows / np.where(length > 1e-12, length, 1.0)


def _vocabulary(descriptors: Descriptors, words: int, rng: np.random.Generator, rounds: int = 12) -> np.ndarray:
    """(words, 128) centres by Lloyd's k-means over a sample of the descriptors."""
    from scipy.sparse import csr_matrix

    size = min(len(descriptors), WORDS_SAMPLE)
    sample = descriptors[np.sort(rng.choice(len(descriptors), size, replace=False))]
    centres = sample[rng.choice(size, words, replace=False)].copy()
    for _ in range(rounds):
        word = (sample @ centres.T - 0.5 * (centres**2).sum(axis=1)).argmax(axis=1)
        members = csr_matrix((np.ones(size, np.float32), (word, np.arange(size))), (words, size))
        sums, count = members @ sample, np.bincount(word, minlength=words)
        used = count > 0
        centres[used] = sums[used] / count[used, None]
    return centres


def _principal(vectors: np.ndarray) -> np.ndarray:
    """(D, COMPRESSED) principal directions of at most COMPRESS_ABOVE evenly spaced rows, by their Gram matrix."""
    rows = vectors[np.linspace(0, len(vectors) - 1, COMPRESS_ABOVE).astype(int)]
    values, weights = np.linalg.eigh(rows @ rows.T)
    values, weights = values[-COMPRESSED:], weights[:, -COMPRESSED:]
    basis: np.ndarray = (rows.T @ (weights / np.sqrt(np.maximum(values, 1e-9)))).astype(np.float32)
    return basis
