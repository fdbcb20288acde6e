"""Settings of the simulator source."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import Source, SourceContext
from rhs.api.errors import ConfigError, check_choice, check_range
from rhs.api.robot_shape import footprint_of

# setting -> least, most, unit; null is allowed where it is a setting's default
RANGES: dict[str, tuple[float, float, str]] = {
    "image_width": (32, 4096, "px"), "hfov_deg": (10, 120, "degrees"), "robot_radius_m": (0.05, 2.0, "m"),
    "camera_height_m": (0.1, 3.0, "m"), "camera_pitch_deg": (-45, 60, "degrees"), "baseline_m": (0.0, 1.0, "m"),
    "laser_beams": (0, 10_000, ""), "laser_fov_deg": (1.0, 360.0, "degrees"), "laser_height_m": (0.02, 3.0, "m"),
    "laser_range_m": (0.1, 1000.0, "m"), "anisotropy": (1, 16, ""), "texture_px_per_m": (10, 1000, "px/m"),
    "step_m": (0.01, 2.0, "m"), "turn_step_deg": (0.5, 90, "degrees"), "arc_radius_m": (0.05, 10, "m"),
    "speed_mps": (0.01, 5, "m/s"), "turn_rate_dps": (1, 360, "degrees/s"), "wobble_m": (0, 0.3, "m"),
    "wobble_deg": (0, 15, "degrees"), "pitch_roll_deg": (0, 15, "degrees"), "command_bias_percent": (0, 30, "%"),
    "command_noise_percent": (0, 30, "%"), "paintings_unique": (1, 100_000, ""), "paintings_density": (0, 1, ""),
    "wall_roughness": (0, 100, "grey levels"), "texture_seed": (0, 2**31 - 1, ""),
}
CHOICES = {"renderer": ("raster", "tinyrenderer", "egl"), "sampling": ("anisotropic", "nearest"), "direction": ("ccw", "cw"),
           "turn": ("pivot", "arc")}


@dataclass
class Simulator:
    """A PyBullet world seen by a camera on a robot: led along the survey route, then driven by commands."""

    image_width: int = 320
    """pixels; the height is three quarters of it"""
    hfov_deg: float = 57.0
    """horizontal field of view, degrees; 57 is a Kinect's"""
    robot_radius_m: float | None = None
    """of the round robot, metres; null: as the world says"""
    footprint_m: list[tuple[float, float]] = field(default_factory=list)
    """of a robot that is not round: corners [x,y] of a convex polygon one after the other, metres, x ahead, y to the left of
    the point that it turns on; empty: round, or as the world says"""
    camera_height_m: float | None = None
    """of the camera above the floor, metres, and the robot is as tall; null: as the world says"""
    camera_pitch_deg: float | None = None
    """how far the camera looks down, degrees: low things are seen from nearer by; null: as the world says. The horizon must
    stay in the picture, for walls are measured there"""
    distortion: list[float] = field(default_factory=list)
    """Of the lens: k1, k2, p1, p2 and perhaps k3 as OpenCV has them; empty: none. hfov_deg is then that of the
    pinhole behind it: a barrel (k1 < 0) sees more, and a wider view is drawn so that its corners are not empty."""
    baseline_m: float = 0.0
    """metres from the camera to a second one on its right, for sensor=stereo (which takes 0.12); 0: there is none"""
    laser_beams: int = 0
    """beams of a laser scanner on the robot, for sensor=laser (which takes 541); 0: there is none"""
    laser_fov_deg: float = 270.0
    """what the scanner sees round the robot, ahead in its middle, degrees; 270: a Hokuyo UTM-30LX"""
    laser_height_m: float = 0.25
    """of the scanner's plane above the floor, metres: a table top it does not see"""
    laser_range_m: float = 30.0
    """metres that the scanner sees"""
    renderer: str = "raster"
    """What draws the views. raster: the rasteriser of rhs, filtered, in a few milliseconds, the same bytes on every machine;
    tinyrenderer: PyBullet's software renderer, unfiltered; egl: PyBullet's OpenGL renderer"""
    sampling: str = "anisotropic"
    """How raster reads textures. anisotropic: the mean of what a pixel covers, as a camera does, also where a wall is seen
    at a flat angle; nearest: one texel a pixel, as tinyrenderer does, which flickers in the distance"""
    anisotropy: int = 8
    """samples a pixel at most with sampling=anisotropic; 1: blurred where a wall is seen at a flat angle"""
    texture_px_per_m: float = 150.0
    """pixels per metre of wall; finer ones alias in the distance where textures are not filtered"""
    direction: str = "ccw"
    """ccw: the survey route as written; cw: from its end back to its start"""
    step_m: float = 0.2
    """metres between two views of the survey on a straight"""
    turn: str = "pivot"
    """how corners of the route are taken: pivot on the spot, or arc, which keeps the camera moving"""
    turn_step_deg: float = 10.0
    """most degrees between two views of the survey in a corner"""
    arc_radius_m: float = 0.7
    """metres, radius of arcs; shrunk where a leg of the route is too short for it"""
    speed_mps: float = 0.5
    """metres per second of the survey; sets the time stamps and the commands"""
    turn_rate_dps: float = 30.0
    """degrees per second of turns on the spot in the survey"""
    wobble_m: float = 0.02
    """metres rms by which the led camera strays sideways from the route"""
    wobble_deg: float = 0.5
    """degrees rms by which the led camera's heading strays from the route"""
    pitch_roll_deg: float = 0.0
    """degrees rms of camera pitch and of roll while moving; 0: the floor is flat"""
    command_bias_percent: float = 1.0
    """per cent, one sigma: lasting error of distance and of turn against the command"""
    command_noise_percent: float = 3.0
    """per cent, one sigma: fresh error of distance and of turn at each command"""
    paintings_unique: int | None = None
    """how many different paintings exist; null: as the world says"""
    paintings_density: float | None = None
    """0..1, share of hanging places used; null: as the world says"""
    wall_roughness: float | None = None
    """grey levels of the walls' own pattern; null: as the world says"""
    texture_seed: int | None = None
    """seed of all paintings and surfaces; null: as the world says"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "right_image", "right_camera", "scan", "wheel",
                                                "command", "driving", "teleport"})
    preload: ClassVar[tuple[str, ...]] = ("rhs_sources.raster.renderer",)

    def __post_init__(self) -> None:
        for name, (low, high, unit) in RANGES.items():
            if getattr(self, name) is not None:
                check_range("source", name, getattr(self, name), low=low, high=high, unit=unit)
        for name, words in CHOICES.items():
            check_choice("source", name, getattr(self, name), words)
        if self.robot_radius_m is not None and self.footprint_m:
            raise ConfigError("source.footprint_m is of a robot that is not round; leave out source.robot_radius_m")
        footprint_of(self.footprint_m, "source.footprint_m")
        if len(self.distortion) not in (0, 4, 5):
            raise ConfigError(f"source.distortion={list(self.distortion)} has {len(self.distortion)} numbers; expected "
                              "k1, k2, p1, p2 and perhaps k3, or none")
        for value in self.distortion:
            check_range("source", "distortion", value, low=-2.0, high=2.0)
        if self.laser_beams == 1:
            raise ConfigError("source.laser_beams=1 is no scan; expected 0 (none), or 2 and more")
        if self.laser_beams and self.renderer != "raster":
            raise ConfigError(f"source.renderer={self.renderer} has no laser scanner; type source.renderer=raster")

    def build(self, context: SourceContext) -> Source:
        """context: rhs.api.contracts.SourceContext with a world."""
        from .simulator import SimulatorSource

        return SimulatorSource(self, context)
