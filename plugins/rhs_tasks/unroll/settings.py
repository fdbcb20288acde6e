"""Settings of the unrolling task."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.errors import Bounded, ConfigError, check_range, one_of, within
from rhs.api.task import Job, TaskContext
from rhs.worlds.tubes import check_pieces


@dataclass
class Unrolling(Bounded):
    """How the wall of a tube or corridor becomes one flat picture."""

    path: str = ""
    """folder of pictures in the order of their names (png, jpg); empty: the views of the source"""
    intrinsics: list[float] = field(default_factory=list)
    """of the camera that took them: [fx,fy,cx,cy] in pixels"""
    distortion: list[float] = field(default_factory=list)
    """and of its lens: k1, k2, p1, p2, k3 as OpenCV has them; empty: none"""
    shape: str = one_of("round", "rectangular")
    """the section: round or rectangular"""
    size_m: float = within(0.25, 1e-3, 100.0)
    """its radius, or half its width, metres"""
    aspect: float = within(1.0, 0.1, 10.0)
    """height over width of a rectangular section"""
    pieces: list[float] = field(default_factory=list)
    """how it bends from the first view on: metres of a piece and its bend in degrees (left positive), one after the
    other"""
    bend: str = one_of("given", "found")
    """the bend: given (by `pieces`; straight if they are empty), or found from the views, which are looked at twice for
    it"""
    start_left_m: float = 0.0
    """where the camera is at the first view, left of the middle of the section, metres; it looks along the tube"""
    start_up_m: float = 0.0
    """and above the middle of the section, metres"""
    near_sizes: float = within(1.2, 0.2, 20.0)
    """a strip begins so many sizes ahead of the camera ..."""
    far_sizes: float = 3.5
    """... and ends so many ahead; further away a pixel covers too much wall"""
    pixel_share: float = within(0.02, 0.004, 0.2)
    """side of a pixel of the mosaic, share of size_m"""
    pose: str = one_of("fitted", "centred")
    """where each strip is seen from: fitted (to the mosaic so far), or centred on the axis as in the thesis"""
    stitch: str = one_of("homography", "none")
    """a strip is put on the mosaic by: homography (thesis), or where its pose says (none)"""

    def __post_init__(self) -> None:
        if self.bend == "found" and self.pieces:
            raise ConfigError("unroll.bend=found leaves nothing to give; type unroll.pieces=[] or unroll.bend=given")
        super().__post_init__()
        check_range("unroll", "far_sizes", self.far_sizes, low=self.near_sizes + 0.3, high=40.0)
        for name in ("start_left_m", "start_up_m"):
            check_range("unroll", name, getattr(self, name), low=-0.8 * self.size_m * max(self.aspect, 1.0),
                        high=0.8 * self.size_m * max(self.aspect, 1.0), unit="m")
        check_pieces(self.pieces, self.size_m, least_m=1e-3)
        for name, counts in (("intrinsics", (0, 4)), ("distortion", (0, 4, 5))):
            if len(getattr(self, name)) not in counts:
                raise ConfigError(f"unroll.{name}={list(getattr(self, name))} has {len(getattr(self, name))} numbers; "
                                  f"expected {' or '.join(map(str, counts[1:]))}")
        for value in self.intrinsics:
            check_range("unroll", "intrinsics", value, low=-1e5, high=1e5, unit="px")
        for value in self.distortion:
            check_range("unroll", "distortion", value, low=-10.0, high=10.0)
        if self.path and not self.intrinsics:
            raise ConfigError("unroll.path needs the camera that took the pictures; type unroll.intrinsics=[fx,fy,cx,cy]")


@dataclass
class Unroll(PartSettings):
    """The wall of a tube or corridor as one flat picture (thesis section 4.3)."""

    unroll: Unrolling = field(default_factory=Unrolling)

    kinds: ClassVar[tuple[str, ...]] = ("source", "sensor")

    def build(self, context: TaskContext) -> Job:
        from .task import UnrollJob

        return UnrollJob(self.unroll, context)
