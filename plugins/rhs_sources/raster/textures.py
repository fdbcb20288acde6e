"""Textures as the rasteriser reads them: all levels of all images in one array of texels."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

LEVELS = 8  # of a pyramid (Williams, "Pyramidal parametrics", SIGGRAPH 1983): the last is 1/128 of the first


def pyramids(images: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Texels (N,) uint32 of images (H, W, 3) uint8 RGB, and (T, LEVELS, 3) int64: offset of the first texel, width, height.

    Each level has a border of one texel, its edge repeated, so that no neighbour has to be looked for. Odd sides are
    padded before they are halved: place u of level 0 is exactly u / 2^l of level l."""
    sizes = np.zeros((len(images), LEVELS, 3), np.int64)
    total = 0
    for texture, image in enumerate(images):
        height, width = image.shape[:2]
        for level in range(LEVELS):
            sizes[texture, level] = total + width + 3, width, height
            total += (width + 2) * (height + 2)
            width, height = (width + 1) // 2, (height + 1) // 2
    texels = np.zeros(total, np.uint32)
    for image, levels in zip(images, sizes, strict=True):
        for begin, width, height in levels:
            bordered = cv2.copyMakeBorder(image, 1, 1, 1, 1, cv2.BORDER_REPLICATE)
            end = begin - width - 3 + (width + 2) * (height + 2)
            rgb0 = texels[begin - width - 3:end].view(np.uint8).reshape(height + 2, width + 2, 4)
            cv2.mixChannels([bordered], [rgb0], [0, 0, 1, 1, 2, 2])
            padded = cv2.copyMakeBorder(image, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE)
            image = cv2.resize(padded, ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
    return texels, sizes
