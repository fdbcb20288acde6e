"""What sensors do to ideal measurements: noise on images and depth, encoders that slip, and the settings of those. Shared by
the sensors; light to import."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.errors import Bounded, ContractError, within
from rhs.api.frozen import freeze
from rhs.api.geometry import Camera
from rhs.api.records import Capture


@dataclass
class Wheeled(Bounded):
    """A sensor on a robot that counts how far its wheels turn."""

    noise: bool = True
    """false: an ideal sensor; recordings keep the noise they have, whatever is said here"""
    wheel_scale_sigma: float = within(0.02, 0.0, 0.5)
    """each run's encoders count distance and turn too long by such a share (1 sigma)"""
    wheel_distance_share: float = within(0.02, 0.0, 1.0)
    """noise of one reading of distance, share of it since the last view (1 sigma)"""
    wheel_turn_share: float = within(0.03, 0.0, 1.0)
    """noise of one reading of turn, share of it since the last view (1 sigma)"""
    wheel_slip_chance: float = within(0.0, 0.0, 1.0)
    """chance per view that the wheels spin: they count wheel_slip_share too much"""
    wheel_slip_share: float = within(0.5, 0.0, 1.0)
    """share counted too much when the wheels spin"""


class Encoders:
    """Wheel travel as encoders count it: a scale error per run, noise per reading, now and then a spin."""

    def __init__(self, settings: Wheeled, rng: np.random.Generator) -> None:
        self._settings = settings
        self._rng = rng
        self._scale = 1.0 + settings.wheel_scale_sigma * rng.standard_normal(2)  # of distance, of turn

    def read(self, travel: np.ndarray | None, *, exact: bool = False) -> np.ndarray | None:
        """(3,) dx, dy, dyaw counted for the true (3,) travel; None stays None. exact: it has been counted already."""
        if travel is None:
            return None
        if exact or not self._settings.noise:
            return freeze(np.array(travel, float))
        settings = self._settings
        noise, chance = self._rng.standard_normal(2), self._rng.random()
        slip = 1.0 + settings.wheel_slip_share * (chance < settings.wheel_slip_chance)
        along = slip * (self._scale[0] + settings.wheel_distance_share * noise[0])
        turn = slip * (self._scale[1] + settings.wheel_turn_share * noise[1])
        return freeze(np.asarray(travel, float) * np.array([along, along, turn]))


def noisy_image(image: np.ndarray, sigma: float, rng: np.random.Generator) -> np.ndarray:
    """The (H, W, 3) uint8 image with Gaussian noise of `sigma` grey levels on every channel, rounded and clipped."""
    if sigma == 0.0:
        return freeze(image.copy())
    from .noise import add_grey, chosen, grey_levels  # numba takes half a second to load, which `--help` need not wait for

    seen = np.empty(image.shape, np.uint8)
    add_grey(np.ascontiguousarray(image).reshape(-1), chosen(rng, image.size), grey_levels(sigma), seen.reshape(-1))
    return freeze(seen)


def image_of(capture: Capture, camera: Camera) -> np.ndarray:
    """The image of a capture; ContractError when there is none, or when it is not of the camera's size."""
    if capture.image is None:
        raise ContractError(f"capture {capture.index} has no image; this sensor needs a source that provides images")
    if capture.image.shape[:2] != (camera.height, camera.width):
        raise ContractError(
            f"capture {capture.index}: image is {size(capture.image)}, the camera {camera.width}x{camera.height}; "
            "give the source the camera that took it"
        )
    return capture.image


def depth_of(capture: Capture, camera: Camera) -> np.ndarray:
    """The depth of a capture; ContractError when there is none, or when it is not of the image's size."""
    image = image_of(capture, camera)
    if capture.depth is None:
        raise ContractError(f"capture {capture.index} has no depth; choose sensor=mono or a source with depth")
    if capture.depth.shape != image.shape[:2]:
        raise ContractError(
            f"capture {capture.index}: depth is {size(capture.depth)}, image is {size(image)}; "
            "register the depth to the image first"
        )
    return capture.depth


def size(image: np.ndarray) -> str:
    """Width x height, as people say it."""
    return "x".join(str(n) for n in image.shape[1::-1])
