"""Settings of `source=tube`: the inside of a painted tube or corridor, drawn without PyBullet."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import PartSettings, Source, SourceContext
from rhs.api.errors import ConfigError, check_range, one_of, within
from rhs.worlds.tubes import check_pieces


@dataclass
class Tube(PartSettings):
    """A camera led through one painted tube, round or rectangular, straight or bent, with a known texture."""

    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "wheel", "command", "texture"})

    shape: str = one_of("round", "rectangular")
    """round or rectangular"""
    size_m: float = within(0.25, 0.01, 50.0)
    """radius, or half the width of the rectangle"""
    aspect: float = within(1.0, 0.1, 10.0)
    """height over width of the rectangle"""
    pieces: list[float] = field(default_factory=list)
    """The centre line: metres of a piece and its bend in degrees (left positive), one after the other; empty:
    straight."""
    length_m: float = within(4.0, 0.01, 1000.0)
    """the camera is led so far"""
    step_m: float = within(0.05, 0.001, 10.0)
    """metres between two views"""
    speed_mps: float = within(0.25, 0.001, 10.0)
    """metres per second; sets the stamps and the commands"""
    wobble_share: float = within(0.03, 0.0, 0.3)
    """the camera strays from the centre line by this share of size_m (rms)"""
    wobble_deg: float = within(1.0, 0.0, 10.0)
    """the camera's angles stray by so much (rms), degrees"""
    image_width: int = within(320, 32, 4096)
    """pixels; the height is three quarters of it"""
    hfov_deg: float = within(90.0, 10.0, 150.0)
    """horizontal field of view; wide, or the wall beside the camera is never seen"""
    skew_px: float = within(0.0, -100.0, 100.0)
    """skew of the camera's axes, pixels"""
    distortion: list[float] = field(default_factory=list)
    """distortion of the lens: k1, k2, p1, p2, k3 as OpenCV has them; empty: none"""
    camera_share: float = within(0.5, 0.05, 0.95)
    """height of the camera in the section: 0 at the bottom, 1 at the top"""
    finest_share: float = within(0.06, 0.01, 1.0)
    """size of the texture's finest grains, share of size_m"""
    command_bias_percent: float = within(1.0, 0.0, 30.0)
    """lasting error of the distance against the command, per cent (1 sigma)"""
    command_noise_percent: float = within(3.0, 0.0, 30.0)
    """fresh error of each command, per cent (1 sigma)"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.distortion) not in (0, 4, 5):
            raise ConfigError(f"distortion={list(self.distortion)} has {len(self.distortion)} numbers; "
                              "expected k1, k2, p1, p2 and perhaps k3, or none")
        for value in self.distortion:
            check_range("", "distortion", value, low=-2.0, high=2.0)
        check_pieces(self.pieces, self.size_m, least_m=0.01)

    def build(self, context: SourceContext) -> Source:
        """context: rhs.api.contracts.SourceContext; the world is not looked at."""
        from .tube import TubeSource

        return TubeSource(self, context)
