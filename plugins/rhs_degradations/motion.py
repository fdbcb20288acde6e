"""What a camera that turns while it looks makes of a view: motion blur, rolling shutter.

The shift of the picture is that of its middle under the rotation since the previous view (a thing at infinity); what comes
from driving, which depends on the distance, is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import RhsError, within
from rhs.api.geometry import Camera
from rhs.api.records import Capture

SAMPLES_PER_PX = 8  # of the line that a point is drawn out to


@dataclass
class Blur(PartSettings):
    """Motion blur: the shutter stays open while the camera turns."""

    exposure_share: float = within(0.2, 0.0, 1.0)
    """share of the time between two views that the shutter is open; 0: none"""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    def build(self, context: Context) -> Degradation:
        return Smear(self, context.camera)


class Smear(Degradation):
    """Every point drawn out to a line."""

    def __init__(self, settings: Blur, camera: Camera) -> None:
        self._share, self._camera = settings.exposure_share, camera

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        if self._share == 0.0 or capture.image is None:
            return capture
        line = self._share * turned_px(self._camera, previous_from_body, "blur")
        if not line.any():
            return capture
        import cv2

        image = cv2.filter2D(capture.image, -1, line_kernel(line), borderType=cv2.BORDER_REPLICATE)
        return replace(capture, image=image)


@dataclass
class RollingShutter(PartSettings):
    """A rolling shutter that nobody corrects: rows are read one after another while the camera turns."""

    readout_share: float = within(0.5, 0.0, 1.0)
    """share of the time between two views that reading all rows takes, the middle row at the stamp; 0: none"""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})

    def build(self, context: Context) -> Degradation:
        return Rolling(self, context.camera)


class Rolling(Degradation):
    """Each row of image and depth shifted by what the camera turned until it was read."""

    def __init__(self, settings: RollingShutter, camera: Camera) -> None:
        self._share, self._camera = settings.readout_share, camera

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        if self._share == 0.0 or capture.image is None:
            return capture
        shift = self._share * turned_px(self._camera, previous_from_body, "rolling_shutter")
        if not shift.any():
            return capture
        import cv2

        height, width = capture.image.shape[:2]
        rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
        late = np.linspace(-0.5, 0.5, height, dtype=np.float32)[:, None]
        at = columns - np.float32(shift[0]) * late, rows - np.float32(shift[1]) * late
        image = cv2.remap(capture.image, *at, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        depth = None if capture.depth is None else cv2.remap(
            np.array(capture.depth), *at, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
        return replace(capture, image=image, depth=depth)


def turned_px(camera: Camera, previous_from_body: np.ndarray | None, who: str) -> np.ndarray:
    """(2,) pixels, right and down, by which the middle of the picture moved under the rotation since the previous view.

    Raises RhsError where nobody knows the motion."""
    if previous_from_body is None:
        raise RhsError(f"degrade={who} needs to know how the camera turned: this source knows neither truth nor wheels")
    body_from_camera = camera.body_from_camera[:3, :3]
    now_from_previous = body_from_camera.T @ previous_from_body[:3, :3].T @ body_from_camera
    ahead = now_from_previous @ [0.0, 0.0, 1.0]
    limits = np.array([camera.width, camera.height])  # turned by more: the picture is gone either way
    if ahead[2] <= 0.0:
        return limits * np.sign(ahead[:2])
    return np.clip(np.array([camera.fx, camera.fy]) * ahead[:2] / ahead[2], -limits, limits)


def line_kernel(line: np.ndarray) -> np.ndarray:
    """(K, K) float32 weights, of sum 1, of a line through the middle: (2,) pixels right and down from end to end."""
    reach = int(np.ceil(np.abs(line).max() / 2)) + 1
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1))
    samples = int(np.ceil(SAMPLES_PER_PX * np.hypot(*line))) + 1
    points = (np.arange(samples)[:, None] + 0.5 - samples / 2) / samples * line + reach
    low = np.floor(points).astype(int)
    (fx, fy), (column, row) = (points - low).T, low.T
    for dx, dy, weight in ((0, 0, (1 - fx) * (1 - fy)), (1, 0, fx * (1 - fy)), (0, 1, (1 - fx) * fy), (1, 1, fx * fy)):
        np.add.at(kernel, (row + dy, column + dx), weight)
    return (kernel / kernel.sum()).astype(np.float32)
