"""Sensors that pass on what the camera saw with a little noise, right and wrong."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np

from rhs.api.records import Observation, Scan

from . import settings


class Honest:
    """Depth to 8 m with noise, a scan of its middle row, the wheel with noise."""

    def __init__(self, context):
        self.camera, self.rng = context.camera, context.rng

    def sense(self, capture):
        image = self.image(capture)
        depth, wheel = self.depth(capture), self.wheel(capture)
        for array in (image, depth, wheel):
            if array is not None:
                array.setflags(write=False)
        scan = self.scan(depth)
        return Observation(capture.index, capture.stamp_s, self.camera, image, depth, scan, capture.command, wheel)

    def image(self, capture):
        noise = self.rng.normal(0.0, 2.0, capture.image.shape)
        return np.clip(capture.image + noise, 0, 255).astype(np.uint8)

    def depth(self, capture):
        depth = capture.depth * (1.0 + 0.005 * self.noise(capture.depth.shape))
        return np.where(depth < 8.0, depth, np.nan).astype(np.float32)

    def noise(self, shape):
        return self.rng.standard_normal(shape)

    def scan(self, depth):
        columns = np.arange(self.camera.width)
        rays = self.camera.rays(np.stack([columns, np.full(len(columns), self.camera.cy)], axis=1).astype(float))
        row = depth[round(self.camera.cy)]
        return Scan(-np.arctan(rays[:, 0]), row * np.hypot(rays[:, 0], 1.0), 8.0)

    def wheel(self, capture):
        return capture.travel * (1.0 + 0.02 * self.noise(3))


class MirroredBearings(Honest):
    """Bearings count to the right."""
    says = "bearings are left positive"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, bearings_rad=-scan.bearings_rad)


class Millimetres(Honest):
    """Depth and ranges in millimetres."""
    says = "scan.ranges_m"

    def depth(self, capture):
        return super().depth(capture) * np.float32(1000.0)


class RangesInMillimetres(Honest):
    """Ranges in millimetres, depth in metres."""
    says = "scan.ranges_m"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, ranges_m=1000.0 * scan.ranges_m)


class RangesInCentimetres(Honest):
    """Ranges in centimetres, depth in metres."""
    says = "of the beams end at a wall"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, ranges_m=100.0 * scan.ranges_m)


class DepthAsRange(Honest):
    """The scan is the row of depth, not the length of the rays, with bearings in degrees."""
    says = "expected radians"

    def scan(self, depth):
        scan = super().scan(depth)
        return Scan(np.degrees(scan.bearings_rad), depth[round(self.camera.cy)], 8.0)


class RangeAsDepth(Honest):
    """Depth is the length of the ray to a pixel, and the camera looks wide."""
    says = "of the depths are right"

    def depth(self, capture):
        v, u = np.mgrid[0 : self.camera.height, 0 : self.camera.width]
        rays = self.camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
        return (super().depth(capture) * np.linalg.norm(rays, axis=1).reshape(u.shape)).astype(np.float32)


class Disparity(Honest):
    """One over the depth."""
    says = "of the depths are right"

    def depth(self, capture):
        return 1.0 / super().depth(capture)


class MirroredDepth(Honest):
    """The depth image is turned left to right."""
    says = "of the depths are right"

    def depth(self, capture):
        return np.ascontiguousarray(super().depth(capture)[:, ::-1])


class ForeignNoise(Honest):
    """Noise from numpy's global generator."""
    says = "numpy's global generator"

    def noise(self, shape):
        return np.random.standard_normal(shape)  # noqa: NPY002


class ForeignScanNoise(Honest):
    """A scan with noise that no seed repeats."""
    says = "in the scan"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, ranges_m=scan.ranges_m + 0.001 * np.random.default_rng().standard_normal(len(scan.ranges_m)))


class Dice(Honest):
    """Noise from Python's global generator."""
    says = "Python's global generator"

    def wheel(self, capture):
        return capture.travel * random.gauss(1.0, 0.02)


class OneNoise(Honest):
    """All sensors draw from one generator."""
    says = "two builds with one seed differ"
    rng_of_all = np.random.default_rng(0)

    def noise(self, shape):
        return OneNoise.rng_of_all.standard_normal(shape)


class ZeroIsUnknown(Honest):
    """Unknown depth is 0."""
    says = "unknown depth must be NaN"

    def depth(self, capture):
        return np.nan_to_num(super().depth(capture), nan=0.0)

    def scan(self, depth):
        return None


class ZeroRanges(Honest):
    """Unknown ranges are 0."""
    says = "scan.ranges_m"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, ranges_m=np.nan_to_num(scan.ranges_m, nan=0.0))


class Bgr(Honest):
    """Blue, green, red."""
    says = "BGR"

    def image(self, capture):
        return np.ascontiguousarray(super().image(capture)[:, :, ::-1])


class MirroredImage(Honest):
    """As in a mirror."""
    says = "mirrored"

    def image(self, capture):
        return np.ascontiguousarray(super().image(capture)[:, ::-1])


class Late(Honest):
    """The image of the view before."""
    says = "the view before"
    last = None

    def image(self, capture):
        now, self.last = self.last, super().image(capture)
        return self.last if now is None else now


class Grey(Honest):
    """One channel."""
    says = "(H, W, 3) uint8"

    def image(self, capture):
        return super().image(capture)[:, :, 0]


class Floats(Honest):
    """Images of floats."""
    says = "(H, W, 3) uint8"

    def image(self, capture):
        return super().image(capture).astype(np.float32)


class Bright(Honest):
    """Almost white."""
    says = "grey levels off"

    def image(self, capture):
        return (200 + super().image(capture) // 6).astype(np.uint8)


class Renumbered(Honest):
    """Counts views itself."""
    says = "those of the capture"

    def sense(self, capture):
        return replace(super().sense(capture), index=capture.index + 1)


class Restamped(Honest):
    """Stamps of its own."""
    says = "those of the capture"

    def sense(self, capture):
        return replace(super().sense(capture), stamp_s=0.0)


class WheelBackwards(Honest):
    """Wheels count the other way."""
    says = "wheels count"

    def wheel(self, capture):
        return -super().wheel(capture)


class WheelTicks(Honest):
    """Wheels in ticks."""
    says = "wheels count"

    def wheel(self, capture):
        return 512 * super().wheel(capture)


class WheelMirrored(Honest):
    """Turns count to the right."""
    says = "wheels count"

    def wheel(self, capture):
        return super().wheel(capture) * [1, 1, -1]


class OneBuffer(Honest):
    """Writes every view's depth into one array, which it has handed out before."""
    says = "read-only"
    buffer = None

    def sense(self, capture):
        seen = super().sense(capture)
        if OneBuffer.buffer is None or capture.index == 0:
            OneBuffer.buffer = seen.depth.copy()
        OneBuffer.buffer[:] = seen.depth
        return replace(seen, depth=OneBuffer.buffer)


class Vandal(Honest):
    """Writes its noise into the capture."""
    says = "it wrote to an array it was given"

    def depth(self, capture):
        capture.depth.setflags(write=True)
        capture.depth[:] *= 1.01
        return capture.depth.copy()


class Promises(Honest):
    """Promises a wheel and has none."""
    says = "provides wheel"

    def wheel(self, capture):
        return None


class Uneven(Honest):
    """More bearings than ranges."""
    says = "bearings and"

    def scan(self, depth):
        scan = super().scan(depth)
        return replace(scan, ranges_m=scan.ranges_m[:-1])


class Missing(Honest):
    """Forgets to return."""
    says = "expected an Observation"

    def sense(self, capture):
        super().sense(capture)


class Brittle(Honest):
    """Does not bear a view without depth."""
    says = "ValueError"

    def depth(self, capture):
        if np.isnan(capture.depth).all():
            raise ValueError("no depth")
        return super().depth(capture)


PROVIDES = "image depth scan wheel command"
HONEST = {"Honest": settings(Honest, "image depth", PROVIDES)}
PLANTED = {part.__name__: (settings(part, "image depth", PROVIDES), part.says) for part in Honest.__subclasses__()}
