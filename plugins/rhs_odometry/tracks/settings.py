"""Thresholds of following points with one camera and of doubting the structure, nested in the `advanced` settings of the
monocular odometries. Light to import. Sizes in pixels are those of an image 320 pixels wide and grow with the width."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import Bounded, within


@dataclass(frozen=True)
class PatchRules(Bounded):
    """A point found again by the patch it had when it was last looked at afresh."""

    half_px: float = within(6.0, 1.0, 50.0)
    """half the side of a patch, without its middle pixel; rounded to whole pixels of the image"""
    soft_px: float = within(4.0, 0.1, 100.0)
    """weights fall off with this distance from the middle (1 sigma): what matters is the point itself"""
    iterations: int = within(4, 1, 1000)
    """steps of the search at most"""
    least_px: float = within(0.02, 1e-6, 10.0)
    """steps shorter than this end the search; not scaled: it is a share of a pixel that interpolation can tell"""
    views: int = within(12, 1, 10_000)
    """a look is taken afresh after so many views"""
    stretch: float = within(1.5, 1.0, 100.0)
    """or when its size has changed by this factor"""
    misfit: float = within(0.5, 0.0, 100.0)
    """a found patch differs from the first look by no more than this share of its contrast"""
    noise: float = within(2.0, 0.0, 255.0)
    """grey levels that are forgiven beside"""
    leap_px: float = within(2.0, 0.01, 100.0)
    """a found patch lies no further from where the point was followed to"""
    largest_stretch: float = within(2.5, 1.0, 100.0)
    """nor has its size changed by more than this factor"""


@dataclass(frozen=True)
class KltSettings(Bounded):
    """Points followed by pyramidal Lucas-Kanade."""

    floor_points: int = within(40, 0, 10_000)
    """of the points followed, kept for the lower third of the image: floors are plain beside walls"""
    quality: float = within(0.008, 1e-6, 1.0)
    """weakest corner relative to the best one, upper two thirds"""
    floor_quality: float = within(0.02, 1e-6, 1.0)
    """weakest corner in the lower third, where weak corners are rendering noise"""
    distance_px: float = within(7.0, 1.0, 1000.0)
    """least distance between two points"""
    window_px: float = within(13.0, 3.0, 200.0)
    """side of the window that is followed; rounded to whole pixels of the image"""
    levels: int = within(3, 0, 10)
    """pyramid levels above the image itself"""
    check_px: float = within(0.6, 0.01, 100.0)
    """largest disagreement between following forward and back"""
    patches: bool = True
    """false: points are followed from view to view only, there and back"""
    patch: PatchRules = field(default_factory=PatchRules)


@dataclass(frozen=True)
class FollowOnly(KltSettings):
    """Points followed by pyramidal Lucas-Kanade, from view to view only."""

    patches: bool = False
    """false: points are followed from view to view only, there and back; errors that begin anew in each view serve a filter
    better that takes the earlier of two views for exact"""


@dataclass(frozen=True)
class AlarmSettings(Bounded):
    """When the structure ends: many points with a depth of their own that lie on no known wall."""

    threshold: float = within(0.3, 0.0, 1.0)
    """share of such points above which a view counts; chosen on bundled worlds: plain corridor at most 0.26, lobby 0.30 to
    0.46, corner 0.42 to 0.85"""
    views: int = within(10, 1, 10_000)
    """views over which the share is taken"""
    least: int = within(10, 1, 100_000)
    """fewer points with depth in these say nothing"""
    patience: int = within(5, 1, 10_000)
    """views above the threshold before the alarm"""
