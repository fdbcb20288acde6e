"""A folder of pictures taken on a way through a tube, in the order of their names."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera

from .settings import Unroll

KINDS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")


class Folder:
    """Iterates over gray pictures (H, W) uint8; `camera` is the one of the settings. Every picture is read once before
    anything is unrolled. Raises ConfigError in words."""

    def __init__(self, settings: Unroll) -> None:
        folder = Path(settings.path).expanduser()
        if not folder.is_dir():
            found = "a file" if folder.exists() else "nothing"
            raise ConfigError(f"unroll.path={settings.path}: found {found} there; expected a folder of pictures")
        self._files = sorted((p for p in folder.iterdir() if p.suffix.lower() in KINDS), key=natural)
        if len(self._files) < 2:
            names = ", ".join(sorted(p.name for p in folder.iterdir())[:5]) or "nothing"
            raise ConfigError(f"unroll.path={settings.path}: found {len(self._files)} pictures ({names}); expected two or "
                              f"more of {', '.join(k[1:] for k in KINDS)}")
        height, width = self._read(self._files[0]).shape
        fx, fy, cx, cy = settings.intrinsics
        if not (fx > 0 and fy > 0 and 0 < cx < width and 0 < cy < height):
            raise ConfigError(f"unroll.intrinsics={list(settings.intrinsics)} do not fit pictures of {width}x{height}; "
                              f"expected [fx,fy,cx,cy], for example [{width},{width},{width / 2:g},{height / 2:g}]")
        self.camera = Camera(width, height, fx, fy, cx, cy, distortion=tuple(settings.distortion))
        for file in self._files[1:]:
            self._checked(file)

    def __iter__(self) -> Iterator[np.ndarray]:
        for file in self._files:
            yield self._checked(file)

    def _checked(self, file: Path) -> np.ndarray:
        picture = self._read(file)
        if picture.shape != (self.camera.height, self.camera.width):
            raise ConfigError(f"unroll.path: {file.name} is {picture.shape[1]}x{picture.shape[0]}, the first picture "
                              f"{self.camera.width}x{self.camera.height}; expected one size")
        return picture

    def _read(self, file: Path) -> np.ndarray:
        import cv2

        picture = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise ConfigError(f"unroll.path: {file.name} cannot be read as a picture ({file.stat().st_size} bytes)")
        return picture


def natural(file: Path) -> list[tuple[int, int | str]]:
    """Sorts picture 9 before picture 10."""
    return [(0, int(word)) if word.isdigit() else (1, word) for word in re.split(r"(\d+)", file.name) if word]
