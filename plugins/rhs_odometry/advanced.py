"""Thresholds that several odometries share; each nests them in its own `advanced` settings. Light to import."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import Bounded, within


@dataclass(frozen=True)
class PatchSearch(Bounded):
    """A point found again by its warped patch (keyframe/patches.py). Pixels of the image as it is, whatever its width: the
    sizes were chosen on pictures of 320 and of 640 pixels alike, and larger patches cost time with the square."""

    half_px: int = within(7, 1, 50)
    """half the side of a patch, without its middle pixel"""
    iterations: int = within(12, 1, 1000)
    """Gauss-Newton steps per pyramid level at most"""
    longest_step_px: float = within(3.0, 0.01, 100.0)
    """of one step"""
    least_likeness: float = within(0.75, 0.0, 1.0)
    """normalised correlation of a found patch; motion blur lowers it"""


@dataclass(frozen=True)
class SurfaceSettings(Bounded):
    """The plane fitted to the inverse depths round a point (keyframe/surface.py)."""

    half_px: int = within(3, 1, 50)
    """half the side of the window, without its middle pixel; pixels of the depth image as it is: more would average over
    edges, fewer over less noise"""
    least_known: float = within(0.6, 0.0, 1.0)
    """share of the window that must be known"""
    rough_per_m: float = within(0.015, 1e-6, 10.0)
    """inverse depths off the plane by more than this (RMS) hang over an edge, 1/m: which surface is seen?"""


@dataclass(frozen=True)
class DirectSettings(Bounded):
    """Two views laid on each other by all their pixels (keyframe/direct.py), where too few points can be followed."""

    columns: int = within(80, 8, 10_000)
    """blocks of pixels side by side, at the finest"""
    levels: int = within(3, 1, 10)
    """each coarser one halves that: a block of 32 pixels of 640 bridges what a fast turn shifts"""
    iterations: int = within(12, 1, 1000)
    """Gauss-Newton steps per level at most"""
    still: float = within(1e-4, 0.0, 1.0)
    """a level is done when a step is less than this per pixel of a block, metres and radians"""
    student_dof: float = within(5.0, 0.5, 1e6)
    """degrees of freedom of the Student's t that weighs blocks (Kerl et al. 2013)"""
    correlated: float = within(80.0, 1.0, 1e6)
    """neighbouring blocks err together: so many count as one"""
    gain_sigma: float = within(0.3, 1e-6, 1e3)
    """how far brightness may change between the views, as a share (1 sigma): the exposure follows the light,"""
    offset_sigma: float = within(5.0, 1e-6, 1e6)
    """and grey levels beside that; more of them explain anything on a plain wall"""
    grey_sigma: float = within(1.0, 1e-3, 255.0)
    """least deviation of the brightness of a block, grey levels"""
    floor_grey_sigma: float = within(4.0, 1e-3, 255.0)
    """the same on a floor, where plain surfaces are all that is left: across an edge between two of them the brightness of a
    block is no plane"""
    clear_sigmas: float = within(1.5, 0.0, 100.0)
    """brightness that changes by less than so many deviations from block to block is noise and says nothing"""
    inverse_depth_sigma: float = within(0.002, 1e-6, 10.0)
    """least deviation of its inverse depth, 1/m"""
    least_known: float = within(0.6, 0.0, 1.0)
    """share of a block whose depth must be known"""
    rough_per_m: float = within(0.003, 1e-6, 10.0)
    """a block whose inverse depths spread by more than this per pixel of its side hangs over an edge, 1/m"""
    bent_per_m: float = within(0.0, 0.0, 1e6)
    """a block about which inverse depths leave a plane by more than this tells of no motion, 1/m: the slope there is that of
    no surface, and along a plain corridor the corners of its walls would seem to hold the way; 0: all
    blocks count ..."""
    floor_bent_per_m: float = within(0.01, 0.0, 1e6)
    """... on a floor, where wheels know better"""
    least_shared: float = within(0.4, 0.0, 1.0)
    """share of the blocks that both views must see"""
    vague_m: float = within(0.03, 1e-6, 100.0)
    """a position less sure than this (1 sigma) is none: a lone plain wall, along which noise decides"""
    keep_shared: float = within(0.7, 0.0, 1.0)
    """of the view that others are laid on; with less the last view takes its place"""
    keep_sigmas: float = within(2.0, 1.0, 1e6)
    """nor may a view lie on it less surely by more than this than the first one did"""
    probability: float = within(0.999999, 0.5, 1.0 - 1e-12)
    """chance that points and pixels that are both right are no further apart (chi-square test)"""
    depth_off_per_m: float = within(0.01, 1e-6, 10.0)
    """deviation of inverse depths, 1/m, from which on they are of other surfaces"""
    grey_off: float = within(4.0, 0.0, 255.0)
    """deviation of brightness, grey levels, from which on it may be another picture,"""
    grey_off_share: float = within(0.5, 0.0, 10.0)
    """or, where it varies more, this share of its own deviation"""


@dataclass(frozen=True)
class GuessNoise(Bounded):
    """How wrong a motion may be that is taken from wheels, the command or the last motion because vision has nothing to say.
    Wide on purpose: a guess that is trusted too much bends the map, one that is trusted too little only leaves the loop
    closer more work."""

    wheel_share: float = within(0.10, 0.0, 100.0)
    """wheels: share of the distance and of the turn (1 sigma)"""
    wheel_m: float = within(0.01, 1e-6, 100.0)
    """wheels: least error of the distance, metres (1 sigma)"""
    wheel_rad: float = within(0.01, 1e-6, 10.0)
    """wheels: least error of the turn, radians (1 sigma)"""
    command_share: float = within(0.30, 0.0, 100.0)
    """command: share of the distance and of the turn (1 sigma)"""
    command_m: float = within(0.05, 1e-6, 100.0)
    """command: least error of the distance, metres (1 sigma)"""
    command_rad: float = within(0.05, 1e-6, 10.0)
    """command: least error of the turn, radians (1 sigma)"""
    again_share: float = within(1.00, 0.0, 100.0)
    """the last motion again: share of the distance and of the turn (1 sigma)"""
    again_m: float = within(0.10, 1e-6, 100.0)
    """the last motion again: least error of the distance, metres (1 sigma)"""
    again_rad: float = within(0.20, 1e-6, 10.0)
    """the last motion again: least error of the turn, radians (1 sigma)"""
    again_times: float = within(1.5, 0.0, 100.0)
    """and at most, in a hand, so many times what the motions of late differed from the ones before them (RMS)"""
    again_memory: int = within(30, 3, 10_000)
    """views of which that is learnt; with less than a third of them nothing is known of it"""
    again_least_m: float = within(0.002, 0.0, 1.0)
    """plus so much, metres (1 sigma)"""
    again_least_rad: float = within(0.002, 0.0, 1.0)
    """and radians"""

    def of(self, name: str) -> tuple[float, float, float]:
        """Share, metres and radians of the guess called `wheel`, `command` or `same again`."""
        return {"wheel": (self.wheel_share, self.wheel_m, self.wheel_rad),
                "command": (self.command_share, self.command_m, self.command_rad),
                "same again": (self.again_share, self.again_m, self.again_rad)}[name]


@dataclass(frozen=True)
class SwaySettings(Bounded):
    """When a robot on a floor counts as swaying (features/floor.py): its motions are then not held to the plane."""

    views: int = within(30, 1, 1000)
    """the last so many motions decide: a robot that turns on the spot may not tilt for half of them"""
    share: float = within(0.1, 0.0, 1.0)
    """it sways when more than this share of them tilt it; fewer are wrong motions"""
    gate_probability: float = within(0.999, 0.5, 1.0 - 1e-12)
    """chance that the noise of a motion explains its roll and pitch where there are none"""
    least_deg: float = within(0.05, 0.0, 90.0)
    """of roll and pitch that are always explained, degrees (1 sigma): joints of the floor, the camera's mounting"""
