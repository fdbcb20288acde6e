"""The pictures of key frames: the latest used as image pyramids, the others packed without loss (PNG)."""

from __future__ import annotations

from collections import OrderedDict

import cv2
import numpy as np

from rhs_odometry.tracks import tracks

PACKING = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
           cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_PAETH]


class Pictures:
    """Gray image pyramids by number. budget_mb: of those that lie ready; what was used longest ago is packed, to 0.13 MB at
    640x480, and unpacked (3 ms there) when it is wanted again."""

    def __init__(self, budget_mb: float) -> None:
        self._budget = budget_mb * 1e6
        self._ready: OrderedDict[int, list[np.ndarray]] = OrderedDict()
        self._packed: dict[int, np.ndarray] = {}

    def __len__(self) -> int:
        return len(self._packed.keys() | self._ready.keys())

    @property
    def held_mb(self) -> float:
        """What all of them take, megabytes."""
        ready = sum(level.nbytes for pyramid in self._ready.values() for level in pyramid)
        return 1e-6 * (ready + sum(packed.nbytes for packed in self._packed.values()))

    def add(self, number: int, pyramid: list[np.ndarray]) -> None:
        self._ready[number] = pyramid
        while len(self._ready) > max(self._most(pyramid), 1):
            oldest, given = self._ready.popitem(last=False)
            if oldest not in self._packed:
                self._packed[oldest] = cv2.imencode(".png", given[0], PACKING)[1]

    def get(self, number: int) -> list[np.ndarray]:
        if number in self._ready:
            self._ready.move_to_end(number)
        else:
            self.add(number, tracks.pyramid(np.asarray(cv2.imdecode(self._packed[number], cv2.IMREAD_GRAYSCALE))))
        return self._ready[number]

    def drop(self, number: int) -> None:
        self._ready.pop(number, None)
        self._packed.pop(number, None)

    def _most(self, pyramid: list[np.ndarray]) -> int:
        return int(self._budget / max(sum(level.nbytes for level in pyramid), 1))
