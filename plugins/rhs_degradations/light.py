"""Too little light, light from one side, exposure that jumps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from rhs.api.contracts import Context, Degradation, PartSettings
from rhs.api.errors import within
from rhs.api.records import Capture

IMAGE = frozenset({"image"})


@dataclass
class LowLight(PartSettings):
    """Less light, with the shot noise of few photons and the noise of reading them out (EMVA 1288)."""

    dark_share: float = within(0.8, 0.0, 1.0)
    """share of the light that is missing; 0: none"""
    gain: float = within(1.0, 0.1, 1000.0)
    """how much the camera brightens the picture, noise and all"""
    full_well_e: float = within(5000.0, 10.0, 1e7)
    """electrons of a white pixel; fewer, more shot noise"""
    read_noise_e: float = within(10.0, 0.0, 1e5)
    """noise of reading a pixel out, electrons (one sigma)"""

    needs: ClassVar[frozenset[str]] = IMAGE

    def build(self, context: Context) -> Degradation:
        return Dark(self, context.rng)


class Dark(Degradation):
    """Grey levels to electrons, their noise (Poisson, by its normal limit), and back."""

    def __init__(self, settings: LowLight, rng: np.random.Generator) -> None:
        self._settings, self._rng = settings, rng

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        settings = self._settings
        if settings.dark_share == 0.0 or capture.image is None:
            return capture
        electrons = capture.image * np.float32((1.0 - settings.dark_share) * settings.full_well_e / 255.0)
        noise = np.sqrt(electrons + np.float32(settings.read_noise_e**2))
        electrons += noise * self._rng.standard_normal(electrons.shape, dtype=np.float32)
        return with_grey(capture, electrons * np.float32(settings.gain * 255.0 / settings.full_well_e))


@dataclass
class SideLight(PartSettings):
    """Light from the left: the picture darkens towards its right edge."""

    side_share: float = within(0.6, 0.0, 1.0)
    """share of the light that is missing at the right edge; 0: none"""

    needs: ClassVar[frozenset[str]] = IMAGE

    def build(self, context: Context) -> Degradation:
        return FromTheSide(self)


class FromTheSide(Degradation):
    """Each column a little darker than the one before."""

    def __init__(self, settings: SideLight) -> None:
        self._share = settings.side_share

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        if self._share == 0.0 or capture.image is None:
            return capture
        light = np.linspace(1.0, 1.0 - self._share, capture.image.shape[1], dtype=np.float32)
        return with_grey(capture, capture.image * light[:, None])


@dataclass
class ExposureSteps(PartSettings):
    """An exposure that jumps now and then, as an automatic one does before a window."""

    exposure_stops: float = within(1.0, 0.0, 8.0)
    """how far, at most, in powers of two, brighter or darker than it was lit; 0: never"""
    exposure_chance: float = within(0.05, 0.0, 1.0)
    """chance of a jump at a view"""

    needs: ClassVar[frozenset[str]] = IMAGE

    def build(self, context: Context) -> Degradation:
        return Jumps(self, context.rng)


class Jumps(Degradation):
    """The gain of now, drawn anew at each jump."""

    def __init__(self, settings: ExposureSteps, rng: np.random.Generator) -> None:
        self._settings, self._rng, self._stops = settings, rng, 0.0

    def degrade(self, capture: Capture, previous_from_body: np.ndarray | None) -> Capture:
        jump, level = self._rng.random(), self._rng.uniform(-1.0, 1.0)
        if jump < self._settings.exposure_chance:
            self._stops = level * self._settings.exposure_stops
        if self._stops == 0.0 or capture.image is None:
            return capture
        return with_grey(capture, capture.image * np.float32(2.0**self._stops))


def with_grey(capture: Capture, grey: np.ndarray) -> Capture:
    """The capture with these grey levels (H, W, 3) as its image, rounded and clipped."""
    return replace(capture, image=np.clip(np.rint(grey), 0, 255).astype(np.uint8))
