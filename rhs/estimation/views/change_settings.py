"""Thresholds of what counts as a change, light to import (rhs.estimation.views.changes)."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_ranges


@dataclass(frozen=True)
class ChangeSettings:
    """What is marked as changed. Pixels are those of pictures 160 wide."""

    depth_m: float = 0.10
    """a surface this much nearer or further than before is another one, metres; room for the error of the registration"""
    depth_sigmas: float = 4.0
    """plus so many sigmas of the noise of two depths there"""
    slack_px: int = 2
    """a pixel is compared with everything within so many pixels: room for the error of the registration"""
    brightness_log: float = 0.25
    """a surface is another one when its brightness left the range round it by more than this factor (natural logarithm)"""
    chroma: float = 0.05
    """or one of its shares of red, green and blue by more than this"""
    least_m: float = 0.12
    """what is smaller, across its longer side, is not marked, metres"""
    narrow_px: int = 5
    """nor what is narrower than this, as the rim of a thing seen from a little further aside is"""
    least_px: int = 25
    """nor what covers fewer pixels"""
    references: int = 4
    """pictures of the survey at most that one of the patrol is compared with"""

    def __post_init__(self) -> None:
        check_ranges("", self, depth_m=(0.0, 10.0), depth_sigmas=(0.0, 100.0), slack_px=(0, 20), brightness_log=(0.01, 5.0),
                     chroma=(0.005, 1.0), least_m=(0.0, 10.0), narrow_px=(1, 50), least_px=(1, 10_000), references=(1, 100))
