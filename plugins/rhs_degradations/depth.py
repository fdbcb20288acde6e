"""A depth camera that is worse than its data sheet says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.records import Capture
from rhs.estimation.views.rigid import KINECT


@dataclass
class DepthNoise(PartSettings):
    """Depth is noisier than the sensor says: noise of its own at each pixel, beside that of the sensor."""

    noise_times: float = within(4.0, 0.0, 1000.0)
    """deviation of the noise put on top, times that of a Kinect (Nguyen, Izadi and Lovell 2012); 0: none"""

    needs: ClassVar[frozenset[str]] = frozenset({"depth"})

    def build(self, context: Context) -> Degradation:
        return Noisier(self, context.rng)


class Noisier(Degradation):
    """Gaussian noise along the optical axis; what it moves behind the camera is unknown."""

    def __init__(self, settings: DepthNoise, rng: np.random.Generator) -> None:
        self._times, self._rng = settings.noise_times, rng

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        if self._times == 0.0 or capture.depth is None:
            return capture
        sigma = np.float32(self._times) * KINECT.depth(capture.depth)
        depth = capture.depth + sigma * self._rng.standard_normal(capture.depth.shape, dtype=np.float32)
        return replace(capture, depth=np.where(depth > 0.0, depth, np.nan).astype(np.float32))
