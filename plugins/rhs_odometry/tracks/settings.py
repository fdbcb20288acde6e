"""Thresholds of following points with one camera and of doubting the structure, nested in the `advanced` settings of the
monocular odometries. Light to import. Sizes in pixels are those of an image 320 pixels wide and grow with the width."""

from __future__ import annotations

from dataclasses import dataclass, field

from rhs.api.errors import check_ranges


@dataclass(frozen=True)
class PatchRules:
    """A point found again by the patch it had when it was last looked at afresh."""

    half_px: float = 6.0
    """half the side of a patch, without its middle pixel; rounded to whole pixels of the image"""
    soft_px: float = 4.0
    """weights fall off with this distance from the middle (1 sigma): what matters is the point itself"""
    iterations: int = 4
    """steps of the search at most"""
    least_px: float = 0.02
    """steps shorter than this end the search; not scaled: it is a share of a pixel that interpolation can tell"""
    views: int = 12
    """a look is taken afresh after so many views"""
    stretch: float = 1.5
    """or when its size has changed by this factor"""
    misfit: float = 0.5
    """a found patch differs from the first look by no more than this share of its contrast"""
    noise: float = 2.0
    """grey levels that are forgiven beside"""
    leap_px: float = 2.0
    """a found patch lies no further from where the point was followed to"""
    largest_stretch: float = 2.5
    """nor has its size changed by more than this factor"""

    def __post_init__(self) -> None:
        check_ranges("", self, half_px=(1.0, 50.0), soft_px=(0.1, 100.0), iterations=(1, 1000), least_px=(1e-6, 10.0),
                     views=(1, 10_000), stretch=(1.0, 100.0), misfit=(0.0, 100.0), noise=(0.0, 255.0),
                     leap_px=(0.01, 100.0), largest_stretch=(1.0, 100.0))


@dataclass(frozen=True)
class KltSettings:
    """Points followed by pyramidal Lucas-Kanade."""

    floor_points: int = 40
    """of the points followed, kept for the lower third of the image: floors are plain beside walls"""
    quality: float = 0.008
    """weakest corner relative to the best one, upper two thirds"""
    floor_quality: float = 0.02
    """weakest corner in the lower third, where weak corners are rendering noise"""
    distance_px: float = 7.0
    """least distance between two points"""
    window_px: float = 13.0
    """side of the window that is followed; rounded to whole pixels of the image"""
    levels: int = 3
    """pyramid levels above the image itself"""
    check_px: float = 0.6
    """largest disagreement between following forward and back"""
    patches: bool = True
    """false: points are followed from view to view only, there and back"""
    patch: PatchRules = field(default_factory=PatchRules)

    def __post_init__(self) -> None:
        check_ranges("", self, floor_points=(0, 10_000), quality=(1e-6, 1.0), floor_quality=(1e-6, 1.0),
                     distance_px=(1.0, 1000.0), window_px=(3.0, 200.0), levels=(0, 10), check_px=(0.01, 100.0))


@dataclass(frozen=True)
class FollowOnly(KltSettings):
    """Points followed by pyramidal Lucas-Kanade, from view to view only."""

    patches: bool = False
    """false: points are followed from view to view only, there and back; errors that begin anew in each view serve a filter
    better that takes the earlier of two views for exact"""


@dataclass(frozen=True)
class AlarmSettings:
    """When the structure ends: many points with a depth of their own that lie on no known wall."""

    threshold: float = 0.3
    """share of such points above which a view counts; chosen on bundled worlds: plain corridor at most 0.26, lobby 0.30 to
    0.46, corner 0.42 to 0.85"""
    views: int = 10
    """views over which the share is taken"""
    least: int = 10
    """fewer points with depth in these say nothing"""
    patience: int = 5
    """views above the threshold before the alarm"""

    def __post_init__(self) -> None:
        check_ranges("", self, threshold=(0.0, 1.0), views=(1, 10_000), least=(1, 100_000), patience=(1, 10_000))
