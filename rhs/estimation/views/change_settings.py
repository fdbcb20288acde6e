"""Thresholds of what counts as a change, light to import (rhs.estimation.views.changes)."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import Bounded, within


@dataclass(frozen=True)
class ChangeSettings(Bounded):
    """What is marked as changed. Pixels are those of pictures 160 wide."""

    depth_m: float = within(0.10, 0.0, 10.0)
    """a surface this much nearer or further than before is another one, metres; room for the error of the registration"""
    depth_sigmas: float = within(4.0, 0.0, 100.0)
    """plus so many sigmas of the noise of two depths there"""
    slack_px: int = within(2, 0, 20)
    """a pixel is compared with everything within so many pixels: room for the error of the registration"""
    brightness_log: float = within(0.25, 0.01, 5.0)
    """a surface is another one when its brightness left the range round it by more than this factor (natural logarithm)"""
    chroma: float = within(0.05, 0.005, 1.0)
    """or one of its shares of red, green and blue by more than this"""
    least_m: float = within(0.12, 0.0, 10.0)
    """what is smaller, across its longer side, is not marked, metres"""
    narrow_px: int = within(5, 1, 50)
    """nor what is narrower than this, as the rim of a thing seen from a little further aside is"""
    least_px: int = within(25, 1, 10_000)
    """nor what covers fewer pixels"""
    references: int = within(4, 1, 100)
    """pictures of the survey at most that one of the patrol is compared with"""
