"""Settings of the simulator source."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

from rhs.api.contracts import PartSettings, Source, SourceContext
from rhs.api.errors import ConfigError, check_range, one_of, within
from rhs.api.robot_shape import footprint_of


@dataclass
class Simulator(PartSettings):
    """A PyBullet world seen by a camera on a robot: led along the survey route, then driven by commands."""

    image_width: int = within(320, 32, 4096, unit="px")
    """pixels; the height is three quarters of it"""
    hfov_deg: float = within(57.0, 10, 120)
    """horizontal field of view, degrees; 57 is a Kinect's"""
    robot_radius_m: float | None = within(None, 0.05, 2.0)
    """of the round robot, metres; null: as the world says"""
    footprint_m: list[tuple[float, float]] = field(default_factory=list)
    """of a robot that is not round: corners [x,y] of a convex polygon one after the other, metres, x ahead, y to the left of
    the point that it turns on; empty: round, or as the world says"""
    camera_height_m: float | None = within(None, 0.1, 3.0)
    """of the camera above the floor, metres, and the robot is as tall; null: as the world says"""
    camera_pitch_deg: float | None = within(None, -45, 60)
    """how far the camera looks down, degrees: low things are seen from nearer by; null: as the world says. The horizon must
    stay in the picture, for walls are measured there"""
    distortion: list[float] = field(default_factory=list)
    """Of the lens: k1, k2, p1, p2 and perhaps k3 as OpenCV has them; empty: none. hfov_deg is then that of the
    pinhole behind it: a barrel (k1 < 0) sees more, and a wider view is drawn so that its corners are not empty."""
    baseline_m: float = within(0.0, 0.0, 1.0)
    """metres from the camera to a second one on its right, for sensor=stereo (which takes 0.12); 0: there is none"""
    laser_beams: int = within(0, 0, 10_000)
    """beams of a laser scanner on the robot, for sensor=laser (which takes 541); 0: there is none"""
    laser_fov_deg: float = within(270.0, 1.0, 360.0)
    """what the scanner sees round the robot, ahead in its middle, degrees; 270: a Hokuyo UTM-30LX"""
    laser_height_m: float = within(0.25, 0.02, 3.0)
    """of the scanner's plane above the floor, metres: a table top it does not see"""
    laser_range_m: float = within(30.0, 0.1, 1000.0)
    """metres that the scanner sees"""
    renderer: str = one_of("raster", "tinyrenderer", "egl")
    """What draws the views. raster: the rasteriser of rhs, filtered, in a few milliseconds, the same bytes on every machine;
    tinyrenderer: PyBullet's software renderer, unfiltered; egl: PyBullet's OpenGL renderer"""
    sampling: str = one_of("anisotropic", "nearest")
    """How raster reads textures. anisotropic: the mean of what a pixel covers, as a camera does, also where a wall is seen
    at a flat angle; nearest: one texel a pixel, as tinyrenderer does, which flickers in the distance"""
    anisotropy: int = within(8, 1, 16)
    """samples a pixel at most with sampling=anisotropic; 1: blurred where a wall is seen at a flat angle"""
    texture_px_per_m: float = within(150.0, 10, 1000, unit="px/m")
    """pixels per metre of wall; finer ones alias in the distance where textures are not filtered"""
    direction: str = one_of("ccw", "cw")
    """ccw: the survey route as written; cw: from its end back to its start"""
    step_m: float = within(0.2, 0.01, 2.0)
    """metres between two views of the survey on a straight"""
    turn: str = one_of("pivot", "arc")
    """how corners of the route are taken: pivot on the spot, or arc, which keeps the camera moving"""
    turn_step_deg: float = within(10.0, 0.5, 90)
    """most degrees between two views of the survey in a corner"""
    arc_radius_m: float = within(0.7, 0.05, 10)
    """metres, radius of arcs; shrunk where a leg of the route is too short for it"""
    survey_m: float | None = within(None, 20.0, 10_000.0)
    """metres, at most, of a survey that is proposed for a map, plan, mesh or scene; null: as the world says, else 60"""
    speed_mps: float = within(0.5, 0.01, 5)
    """metres per second of the survey; sets the time stamps and the commands"""
    turn_rate_dps: float = within(30.0, 1, 360, unit="degrees/s")
    """degrees per second of turns on the spot in the survey"""
    wobble_m: float = within(0.02, 0, 0.3)
    """metres rms by which the led camera strays sideways from the route"""
    wobble_deg: float = within(0.5, 0, 15)
    """degrees rms by which the led camera's heading strays from the route"""
    pitch_roll_deg: float = within(0.0, 0, 15)
    """degrees rms of camera pitch and of roll while moving; 0: the floor is flat"""
    command_bias_percent: float = within(1.0, 0, 30)
    """per cent, one sigma: lasting error of distance and of turn against the command"""
    command_noise_percent: float = within(3.0, 0, 30)
    """per cent, one sigma: fresh error of distance and of turn at each command"""
    paintings_unique: int | None = within(None, 1, 100_000)
    """how many different paintings exist; null: as the world says"""
    paintings_density: float | None = within(None, 0, 1)
    """0..1, share of hanging places used; null: as the world says"""
    wall_roughness: float | None = within(None, 0, 100, unit="grey levels")
    """grey levels of the walls' own pattern; null: as the world says"""
    texture_seed: int | None = within(None, 0, 2**31 - 1)
    """seed of all paintings and surfaces; null: as the world says"""

    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "right_image", "right_camera", "scan", "wheel",
                                                "command", "driving", "teleport"})
    preload: ClassVar[tuple[str, ...]] = ("rhs_sources.raster.renderer",)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.robot_radius_m is not None and self.footprint_m:
            raise ConfigError("footprint_m is of a robot that is not round; leave out source.robot_radius_m")
        footprint_of(self.footprint_m, "source.footprint_m")
        if len(self.distortion) not in (0, 4, 5):
            raise ConfigError(f"distortion={list(self.distortion)} has {len(self.distortion)} numbers; expected "
                              "k1, k2, p1, p2 and perhaps k3, or none")
        for value in self.distortion:
            check_range("", "distortion", value, low=-2.0, high=2.0)
        if self.laser_beams == 1:
            raise ConfigError("laser_beams=1 is no scan; expected 0 (none), or 2 and more")
        if self.laser_beams and self.renderer != "raster":
            raise ConfigError(f"renderer={self.renderer} has no laser scanner; type source.renderer=raster")

    def build(self, context: SourceContext) -> Source:
        """context: rhs.api.contracts.SourceContext with a world."""
        from .simulator import SimulatorSource

        return SimulatorSource(self, context)
