"""Thresholds that several odometries share; each nests them in its own `advanced` settings. Light to import."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_ranges


@dataclass(frozen=True)
class PatchSearch:
    """A point found again by its warped patch (keyframe/patches.py). Pixels of the image as it is, whatever its width: the
    sizes were chosen on pictures of 320 and of 640 pixels alike, and larger patches cost time with the square."""

    half_px: int = 7
    """half the side of a patch, without its middle pixel"""
    iterations: int = 12
    """Gauss-Newton steps per pyramid level at most"""
    longest_step_px: float = 3.0
    """of one step"""
    least_likeness: float = 0.75
    """normalised correlation of a found patch; motion blur lowers it"""

    def __post_init__(self) -> None:
        check_ranges("", self, half_px=(1, 50), iterations=(1, 1000), longest_step_px=(0.01, 100.0),
                     least_likeness=(0.0, 1.0))


@dataclass(frozen=True)
class SurfaceSettings:
    """The plane fitted to the inverse depths round a point (keyframe/surface.py)."""

    half_px: int = 3
    """half the side of the window, without its middle pixel; pixels of the depth image as it is: more would average over
    edges, fewer over less noise"""
    least_known: float = 0.6
    """share of the window that must be known"""
    rough_per_m: float = 0.015
    """inverse depths off the plane by more than this (RMS) hang over an edge, 1/m: which surface is seen?"""

    def __post_init__(self) -> None:
        check_ranges("", self, half_px=(1, 50), least_known=(0.0, 1.0), rough_per_m=(1e-6, 10.0))


@dataclass(frozen=True)
class GuessNoise:
    """How wrong a motion may be that is taken from wheels, the command or the last motion because vision has nothing to say.
    Wide on purpose: a guess that is trusted too much bends the map, one that is trusted too little only leaves the loop
    closer more work."""

    wheel_share: float = 0.10
    """wheels: share of the distance and of the turn (1 sigma)"""
    wheel_m: float = 0.01
    """wheels: least error of the distance, metres (1 sigma)"""
    wheel_rad: float = 0.01
    """wheels: least error of the turn, radians (1 sigma)"""
    command_share: float = 0.30
    """command: share of the distance and of the turn (1 sigma)"""
    command_m: float = 0.05
    """command: least error of the distance, metres (1 sigma)"""
    command_rad: float = 0.05
    """command: least error of the turn, radians (1 sigma)"""
    again_share: float = 1.00
    """the last motion again: share of the distance and of the turn (1 sigma)"""
    again_m: float = 0.10
    """the last motion again: least error of the distance, metres (1 sigma)"""
    again_rad: float = 0.20
    """the last motion again: least error of the turn, radians (1 sigma)"""

    def __post_init__(self) -> None:
        for name in ("wheel", "command", "again"):
            ranges = {f"{name}_share": (0.0, 100.0), f"{name}_m": (1e-6, 100.0), f"{name}_rad": (1e-6, 10.0)}
            check_ranges("", self, **ranges)

    def of(self, name: str) -> tuple[float, float, float]:
        """Share, metres and radians of the guess called `wheel`, `command` or `same again`."""
        return {"wheel": (self.wheel_share, self.wheel_m, self.wheel_rad),
                "command": (self.command_share, self.command_m, self.command_rad),
                "same again": (self.again_share, self.again_m, self.again_rad)}[name]


@dataclass(frozen=True)
class SwaySettings:
    """When a robot on a floor counts as swaying (features/floor.py): its motions are then not held to the plane."""

    views: int = 30
    """the last so many motions decide: a robot that turns on the spot may not tilt for half of them"""
    share: float = 0.1
    """it sways when more than this share of them tilt it; fewer are wrong motions"""
    gate_probability: float = 0.999
    """chance that the noise of a motion explains its roll and pitch where there are none"""
    least_deg: float = 0.05
    """of roll and pitch that are always explained, degrees (1 sigma): joints of the floor, the camera's mounting"""

    def __post_init__(self) -> None:
        check_ranges("", self, views=(1, 1000), share=(0.0, 1.0), gate_probability=(0.5, 1.0 - 1e-12), least_deg=(0.0, 90.0))
