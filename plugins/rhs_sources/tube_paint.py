"""The texture of a tube: grains of many sizes, without a seam, blurred where a pixel covers much of the wall."""

from __future__ import annotations

import numpy as np

from rhs.worlds.tubes import RectangularSection, RoundSection

from .tube_config import Tube

GRAINS = (1.0, 2.5, 6.0, 14.0)  # sizes of the grains, in finest ones; each as strong as the others
BEHIND = 2.0  # the wall is painted from so many sizes behind the first view ...
AHEAD = 42.0  # ... to so many past the last
BLURS = (0.0, 1.0, 2.0, 4.0, 8.0, 16.0)  # along the tube, in finest grains
CONTRAST = 42.0  # grey levels (1 sigma)
PX_PER_GRAIN = 4.0


class Paint:
    """Grey levels over (along_m, around_m)."""

    def __init__(self, settings: Tube, section: RoundSection | RectangularSection, rng: np.random.Generator) -> None:
        from scipy.ndimage import gaussian_filter, gaussian_filter1d

        grain = settings.finest_share * settings.size_m
        self._perimeter_m = section.perimeter_m
        self._from_m = -BEHIND * settings.size_m
        length_m = settings.length_m + (BEHIND + AHEAD) * settings.size_m
        rows = int(round(self._perimeter_m / grain * PX_PER_GRAIN))
        self._px_per_m = rows / self._perimeter_m
        columns = int(length_m * self._px_per_m)
        texture = np.zeros((rows, columns))
        for size in GRAINS:
            noise = rng.standard_normal((rows, columns))
            layer = gaussian_filter(noise, 0.5 * size * PX_PER_GRAIN, mode=("wrap", "reflect"))
            texture += layer / layer.std()
        texture = np.clip(128.0 + CONTRAST * texture / texture.std(), 5.0, 250.0)
        self._blur_m = np.array(BLURS) * grain
        self._levels = [texture.astype(np.float32) if b == 0 else
                        gaussian_filter1d(texture, b * PX_PER_GRAIN, axis=1).astype(np.float32) for b in BLURS]

    def at(self, along_m: np.ndarray, around_m: np.ndarray, *, footprint_m: np.ndarray | None = None) -> np.ndarray:
        """(N,) grey levels; footprint_m: how much of the wall along the tube each value averages (the finest if None)."""
        column = (np.asarray(along_m) - self._from_m) * self._px_per_m
        row = np.asarray(around_m) * self._px_per_m
        if footprint_m is None:
            return self._look(0, row, column)
        level = np.searchsorted(self._blur_m, 0.4 * np.asarray(footprint_m), side="right") - 1
        out = np.zeros(len(column))
        for k in np.unique(level):
            mine = level == k
            out[mine] = self._look(int(k), row[mine], column[mine])
        return out

    def _look(self, level: int, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Between four pixels, round the seam."""
        texture = self._levels[level]
        rows, columns = texture.shape
        column = np.clip(column, 0.0, columns - 1.001)
        r, c = np.floor(row).astype(int), np.floor(column).astype(int)
        a, b = row - r, column - c
        up, down = r % rows, (r + 1) % rows
        return ((1 - a) * ((1 - b) * texture[up, c] + b * texture[up, c + 1])
                + a * ((1 - b) * texture[down, c] + b * texture[down, c + 1]))
