"""Settings of the simulator source."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from rhs.api.errors import ConfigError, check_choice, check_range
from rhs.api.robot_shape import footprint_of

if TYPE_CHECKING:
    from rhs.api.contracts import Source, SourceContext


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
        check_range("source", "image_width", self.image_width, low=32, high=4096, unit="px")
        check_range("source", "hfov_deg", self.hfov_deg, low=10, high=120, unit="degrees")
        if self.robot_radius_m is not None:
            check_range("source", "robot_radius_m", self.robot_radius_m, low=0.05, high=2.0, unit="m")
            if self.footprint_m:
                raise ConfigError("source.footprint_m is of a robot that is not round; leave out source.robot_radius_m")
        footprint_of(self.footprint_m, "source.footprint_m")
        if self.camera_height_m is not None:
            check_range("source", "camera_height_m", self.camera_height_m, low=0.1, high=3.0, unit="m")
        if self.camera_pitch_deg is not None:
            check_range("source", "camera_pitch_deg", self.camera_pitch_deg, low=-45, high=60, unit="degrees")
        if len(self.distortion) not in (0, 4, 5):
            raise ConfigError(f"source.distortion={list(self.distortion)} has {len(self.distortion)} numbers; expected "
                              "k1, k2, p1, p2 and perhaps k3, or none")
        for value in self.distortion:
            check_range("source", "distortion", value, low=-2.0, high=2.0)
        check_range("source", "baseline_m", self.baseline_m, low=0.0, high=1.0, unit="m")
        check_range("source", "laser_beams", self.laser_beams, low=0, high=10_000)
        if self.laser_beams == 1:
            raise ConfigError("source.laser_beams=1 is no scan; expected 0 (none), or 2 and more")
        check_range("source", "laser_fov_deg", self.laser_fov_deg, low=1.0, high=360.0, unit="degrees")
        check_range("source", "laser_height_m", self.laser_height_m, low=0.02, high=3.0, unit="m")
        check_range("source", "laser_range_m", self.laser_range_m, low=0.1, high=1000.0, unit="m")
        if self.laser_beams and self.renderer != "raster":
            raise ConfigError(f"source.renderer={self.renderer} has no laser scanner; type source.renderer=raster")
        check_choice("source", "renderer", self.renderer, ("raster", "tinyrenderer", "egl"))
        check_choice("source", "sampling", self.sampling, ("anisotropic", "nearest"))
        check_range("source", "anisotropy", self.anisotropy, low=1, high=16)
        check_range("source", "texture_px_per_m", self.texture_px_per_m, low=10, high=1000, unit="px/m")
        check_choice("source", "direction", self.direction, ("ccw", "cw"))
        check_range("source", "step_m", self.step_m, low=0.01, high=2.0, unit="m")
        check_choice("source", "turn", self.turn, ("pivot", "arc"))
        check_range("source", "turn_step_deg", self.turn_step_deg, low=0.5, high=90, unit="degrees")
        check_range("source", "arc_radius_m", self.arc_radius_m, low=0.05, high=10, unit="m")
        check_range("source", "speed_mps", self.speed_mps, low=0.01, high=5, unit="m/s")
        check_range("source", "turn_rate_dps", self.turn_rate_dps, low=1, high=360, unit="degrees/s")
        check_range("source", "wobble_m", self.wobble_m, low=0, high=0.3, unit="m")
        check_range("source", "wobble_deg", self.wobble_deg, low=0, high=15, unit="degrees")
        check_range("source", "pitch_roll_deg", self.pitch_roll_deg, low=0, high=15, unit="degrees")
        check_range("source", "command_bias_percent", self.command_bias_percent, low=0, high=30, unit="%")
        check_range("source", "command_noise_percent", self.command_noise_percent, low=0, high=30, unit="%")
        if self.paintings_unique is not None:
            check_range("source", "paintings_unique", self.paintings_unique, low=1, high=100_000)
        if self.paintings_density is not None:
            check_range("source", "paintings_density", self.paintings_density, low=0, high=1)
        if self.wall_roughness is not None:
            check_range("source", "wall_roughness", self.wall_roughness, low=0, high=100, unit="grey levels")
        if self.texture_seed is not None:
            check_range("source", "texture_seed", self.texture_seed, low=0, high=2**31 - 1)

    def build(self, context: SourceContext) -> Source:
        """context: rhs.api.contracts.SourceContext with a world."""
        from .simulator import SimulatorSource

        return SimulatorSource(self, context)
