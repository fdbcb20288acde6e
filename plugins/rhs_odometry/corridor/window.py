"""Which view of the window saw which point: the memory of tracks between their first view and their one use."""

from __future__ import annotations

import numpy as np

from rhs.api.geometry import Camera

from ..tracks.track_frames import TrackFrame


class TrackWindow:
    """Rays (slots, views, 2) of the tracks of the last views, NaN where not seen; the last column is the newest view.

    Every sight of a point is handed out once: when its track ends, or when it fills the window; then the track starts
    again empty. First lives are cut at different lengths, so that not all tracks fall due at the same view."""

    def __init__(self, camera: Camera, views: int, *, least_views: int = 4, slots: int = 512) -> None:
        """least_views: a track seen less often says too little to be worth its row."""
        self._camera, self._views, self._least = camera, views, least_views
        self._rays = np.full((slots, views, 2), np.nan)
        self._slot_of: dict[int, int] = {}
        self._free = list(range(slots - 1, -1, -1))
        self._due = np.full(slots, views)

    def push(self, frame: TrackFrame) -> tuple[np.ndarray, np.ndarray]:
        """Take in a view; returns rays (T, views, 2) and seen (T, views) of the tracks that fall due with it."""
        self._rays[:, :-1] = self._rays[:, 1:]
        self._rays[:, -1] = np.nan
        rays = self._camera.rays(frame.pixels)[:, :2]
        for i, name in enumerate(frame.ids.tolist()):
            slot = self._slot_of.get(name)
            if slot is None:
                if not self._free:
                    continue
                slot = self._slot_of[name] = self._free.pop()
                self._due[slot] = self._least + name % (self._views - self._least + 1)
            self._rays[slot, -1] = rays[i]
        return self._take(set(frame.ids.tolist()))

    def _take(self, alive: set[int]) -> tuple[np.ndarray, np.ndarray]:
        ended = [name for name in self._slot_of if name not in alive]
        counts = np.isfinite(self._rays[:, :, 0]).sum(1)
        due = np.flatnonzero(counts >= self._due)
        gone = np.array([self._slot_of.pop(name) for name in ended], int)
        ripe = np.concatenate([due, gone[counts[gone] >= self._least]]).astype(int)
        rays = self._rays[ripe].copy()
        self._rays[ripe], self._rays[gone] = np.nan, np.nan
        self._due[due] = self._views
        self._free.extend(gone.tolist())
        return np.nan_to_num(rays), np.isfinite(rays[:, :, 0])
