"""The simulator source: a camera led along the route of a PyBullet world, then a robot driven in it.

The robot is a unicycle: a Twist turns and moves it along an arc; what it really does differs from what it is commanded by a
lasting and a fresh error. Whether it touches something is judged by PyBullet on the true geometry; where PyBullet is not
installed the camera can be led, and how near it came to anything stays unknown.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rhs.api.contracts import Source, SourceContext
from rhs.api.errors import ConfigError, RhsError
from rhs.api.floorplan import World, after
from rhs.api.geometry import Camera, camera_from_fov, exp_so3, inverse, planar, se2, se3, wrap
from rhs.api.records import Capture, Twist
from rhs.worlds.live import Live
from rhs.worlds.world import reversed_world

from .lens import Lens
from .simulator_config import Simulator
from .simulator_laser import LaserScanner
from .simulator_mesh import brighter
from .simulator_pair import EXTRAS, SecondCamera
from .simulator_route import RoutePace, Waypoint, Wobble, waypoints
from .simulator_scene import Look, Scene, scene_of

if TYPE_CHECKING:
    from .simulator_solid import Solid

log = logging.getLogger("rhs.simulator")

SUBSTEP_S = 0.05  # a robot at 0.5 m/s moves a twelfth of its radius between two tests for collision
BISECTIONS = 8  # contact is found to 1/256 of a substep


class SimulatorSource(Source):
    """See rhs.api.contracts.Source."""

    def __init__(self, settings: Simulator, context: SourceContext) -> None:
        if context.world is None:
            raise ConfigError("source=simulator needs a world; type for example world=square")
        self.settings = settings
        self.world = dressed(context.world, settings)
        self.facts = self.world.facts()
        pinhole = pinhole_of(self.world, settings)
        self.camera = replace(pinhole, distortion=tuple(settings.distortion))
        self.lens = Lens(self.camera, "source") if settings.distortion else None
        self._seed(context.rng)
        self.views = waypoints(self.world.route_m, self.world.start[2], pace(settings))
        self.views_expected: int | None = len(self.views)
        self.solid = judge_of(self.world)
        self.live: Live | None = None
        self.provides = settings.provides - (frozenset() if self.solid else {"driving", "teleport"})
        self.right = SecondCamera(self.camera, settings.baseline_m) if settings.baseline_m else None
        if self.right is None:
            self.provides -= EXTRAS
        self.laser = laser_of(settings)
        if self.laser is None:
            self.provides -= {"scan"}
        self.folder = context.folder
        self.scene = self._scene()
        self.renderer = self.scene.renderer
        self.leads_ahead = self.renderer == "raster"  # an OpenGL context belongs to one thread
        self.stand = np.array(self.world.start)  # true x, y, yaw
        self._begin_moving(patrol=False)
        self.travelled_m, self.stamp_s, self.index, self.led = 0.0, 0.0, 0, 0
        self.nearest_m, self.touched = np.inf if self.solid else np.nan, False
        self.bumped = False  # the robot's bumper, since the last view
        self.world_from_body = se2(*self.stand)
        self._check_picture()

    def _scene(self) -> Scene:
        settings = self.settings
        probes = settings.anisotropy if settings.sampling == "anisotropic" else 0
        look = Look(settings.texture_px_per_m, settings.renderer, probes, self.folder)
        ideal = self.lens.ideal if self.lens else self.camera
        return scene_of(self.world, ideal, look)

    def _seed(self, rng: np.random.Generator) -> None:
        """One child generator per purpose: settings of one do not change the draws of another."""
        strays, tilts, self.rng = rng.spawn(3)
        settings = self.settings
        self.sideways = Wobble(strays, settings.wobble_m)
        self.askew = Wobble(strays, np.radians(settings.wobble_deg))
        self.pitch = Wobble(tilts, np.radians(settings.pitch_roll_deg))
        self.roll = Wobble(tilts, np.radians(settings.pitch_roll_deg))
        self.bias = self.rng.normal(0.0, settings.command_bias_percent / 100, 2)

    def _check_picture(self) -> None:
        image, _ = self._look(self.world_from_body)
        if float(image.std()) < 1.0:
            raise RhsError(f"source.renderer={self.renderer} draws one flat colour ({image.mean():.0f}) at the start "
                           f"of world {self.world.name}; look at that world, or try another source.renderer")

    def lead(self) -> Capture | None:
        """The next view along the survey route."""
        if self.led >= len(self.views):
            return None
        view = self.views[self.led]
        self.led += 1
        if self.led == 1:
            self._note_clearance()
            return self._capture(0.0, None, None)
        self.travelled_m += view.distance_m
        before, self.stand = self.stand, self._strayed(view)
        self._pass(view.duration_s)
        if self.live is not None:
            self.live.makes_way(self._robot())
            self._place()
        travel = planar(inverse(se2(*before)) @ se2(*self.stand))
        self._note_clearance()
        return self._capture(view.duration_s, self._command_for(travel, view.duration_s), travel)

    def _strayed(self, view: Waypoint) -> np.ndarray:
        """Where a hand really holds the camera that should be at this waypoint."""
        aside, askew = self.sideways(self.travelled_m), self.askew(self.travelled_m)
        c, s = np.cos(view.yaw_rad), np.sin(view.yaw_rad)
        return np.array([view.x_m - s * aside, view.y_m + c * aside, float(wrap(view.yaw_rad + askew))])

    def _command_for(self, travel: np.ndarray, duration_s: float) -> Twist:
        """The command that a robot with these errors would have been given to travel like this."""
        error = 1.0 + self.bias + self.rng.normal(0.0, self.settings.command_noise_percent / 100, 2)
        dx, turn = travel[0], travel[2]
        length = dx * turn / np.sin(turn) if 1e-9 < abs(turn) < 3.0 else dx
        return Twist(float(length / error[0] / duration_s), float(turn / error[1] / duration_s), duration_s)

    def begin_patrol(self) -> None:
        """From now on the world is as its file says it is after the survey."""
        changed = after(self.world)
        if changed is not self.world:
            self.close()
            self.world = changed
            self.solid = judge_of(changed)
            self.scene = self._scene()
        self._begin_moving(patrol=True)

    def _begin_moving(self, *, patrol: bool) -> None:
        """What moves by itself begins anew: survey and patrol have a clock each."""
        if not self.world.moving.still:
            self.live = Live(self.world.moving, self._robot(), patrol=patrol)
            self._place()

    def _robot(self) -> np.ndarray:
        return np.array([*self.stand[:2], self.world.robot_radius_m])

    def _pass(self, seconds: float) -> None:
        """Let time pass for what moves by itself, while the robot stands where it is."""
        if self.live is not None:
            self.live.step(seconds, self._robot())
            self._place()

    def _place(self) -> None:
        """Put what moves where it is now, for the picture and for the judge."""
        if self.live is not None:
            stands = self.live.stands()
            self.scene.place(stands)
            if self.solid is not None:
                self.solid.place(stands)

    def drive(self, command: Twist) -> Capture:
        """Follow the command as well as this robot can, stopping at contact, and look."""
        if not np.all(np.isfinite([command.forward_mps, command.turn_radps, command.duration_s])):
            raise RhsError(f"source.simulator was given the command {command}; expected finite numbers")
        error = 1.0 + self.bias + self.rng.normal(0.0, self.settings.command_noise_percent / 100, 2)
        forward, turn = command.forward_mps * error[0], command.turn_radps * error[1]
        before, self.bumped = self.stand, False
        substeps = max(1, int(np.ceil(command.duration_s / SUBSTEP_S - 1e-9)))
        for _ in range(substeps):
            self._advance(forward, turn, command.duration_s / substeps)
        travel = planar(inverse(se2(*before)) @ se2(*self.stand))
        return self._capture(command.duration_s, command, travel)

    def _advance(self, forward_mps: float, turn_radps: float, seconds: float) -> None:
        """One substep, shortened to the contact if there is something in the way; turning never blocks a round robot."""
        self._pass(seconds)
        here = self._distance(self.stand)
        spins = self.world.footprint is None  # whatever is beside it
        share, goal = 1.0, unicycle(self.stand, forward_mps * seconds, turn_radps * seconds)
        there = self._distance(goal) if forward_mps or not spins else here
        if there < 0 and there < here:
            self.touched = self.bumped = True
            low, high = 0.0, 1.0
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                turn_rad = turn_radps * seconds * (1.0 if spins else middle)
                reached = unicycle(self.stand, forward_mps * seconds * middle, turn_rad)
                low, high = (middle, high) if self._distance(reached) >= 0 else (low, middle)
            share = low if here >= 0 else 0.0
            goal = unicycle(self.stand, forward_mps * seconds * share, turn_radps * seconds * (1.0 if spins else share))
            there = self._distance(goal)
        self.travelled_m += abs(forward_mps) * seconds * share
        self.stand = goal
        self._note(there)

    def _distance(self, stand: np.ndarray) -> float:
        return self.solid.distance_m(*map(float, stand)) if self.solid else np.nan

    def _note_clearance(self) -> None:
        self._note(self._distance(self.stand))

    def _note(self, distance_m: float) -> None:
        self.nearest_m = min(self.nearest_m, distance_m)
        self.touched |= self.nearest_m < 0

    def _capture(self, seconds: float, command: Twist | None, travel: np.ndarray | None) -> Capture:
        self.stamp_s += seconds
        tilt = exp_so3(np.array([self.roll(self.travelled_m), self.pitch(self.travelled_m), 0.0]))
        self.world_from_body = se2(*self.stand) @ se3(tilt, np.zeros(3))
        image, depth = self._look(self.world_from_body)
        for array in (image, depth) if travel is None else (image, depth, travel):
            array.flags.writeable = False
        self.index += 1
        extras = self.right.extras(self._look, self.world_from_body) if self.right else {}
        scan = self.scene.scan(self.laser, self.world_from_body) if self.laser else None
        return Capture(self.index - 1, self.stamp_s, image, depth, command, travel, scan, extras=extras,
                       contact=self.bumped)

    def _look(self, world_from_body: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Picture and depth from there, through the lens if there is one."""
        image, depth = self.scene.render(world_from_body)
        if self.live is not None:
            image = brighter(image, self.live.brightness)
        return (image, depth) if self.lens is None else self.lens.bend(image, depth)

    def teleport(self, world_from_body: np.ndarray) -> None:
        """Put the robot elsewhere; the next drive shows where. Refuses a place where it would overlap something."""
        stand = planar(world_from_body)
        distance = self._distance(stand)
        if distance < 0:
            raise RhsError(f"source.simulator cannot teleport to ({stand[0]:.2f}, {stand[1]:.2f}): the robot would "
                           f"overlap something by {-distance:.2f} m")
        self.stand = stand

    def truth(self) -> np.ndarray | None:
        """World_from_body (4x4) of the last capture."""
        return self.world_from_body.copy()

    def clearance_m(self) -> tuple[float, bool]:
        """Least distance between the robot's side and anything solid since the last call; whether it touched."""
        answer = self.nearest_m, self.touched
        self.nearest_m, self.touched = self._distance(self.stand), False
        return float(answer[0]), bool(answer[1])

    def close(self) -> None:
        self.scene.close()
        if self.solid:
            self.solid.close()


def judge_of(world: World) -> Solid | None:
    """What judges collisions in this world; None where PyBullet is not installed."""
    try:
        from .simulator_solid import Solid
    except ModuleNotFoundError:
        log.warning("nothing judges collisions and the robot cannot be driven: the package pybullet is not installed; "
                    "type: pip install pybullet, or pybullet-arm64, its fork with wheels for more systems")
        return None
    return Solid(world)


def dressed(world: World, settings: Simulator) -> World:
    """The world as these settings want it: direction of the survey, paintings, walls, seed."""
    if settings.direction == "cw":
        world = reversed_world(world)
    paintings = world.paintings
    if settings.paintings_unique is not None:
        paintings = replace(paintings, unique=settings.paintings_unique)
    if settings.paintings_density is not None:
        paintings = replace(paintings, density=settings.paintings_density)
    walls = world.walls
    if settings.wall_roughness is not None:
        walls = tuple(replace(w, surface=replace(w.surface, roughness=settings.wall_roughness)) for w in walls)
    seed = world.seed if settings.texture_seed is None else settings.texture_seed
    pitch_deg = world.camera_pitch_deg if settings.camera_pitch_deg is None else settings.camera_pitch_deg
    return replace(world, paintings=paintings, walls=walls, seed=seed, camera_pitch_deg=pitch_deg)


def pinhole_of(world: World, settings: Simulator) -> Camera:
    """The camera without its lens; it looks down as far as the world says, or less, so that it sees the horizon. Raises
    ConfigError where the settings say otherwise."""
    width, height = settings.image_width, settings.image_width * 3 // 4
    most_deg = float(np.degrees(np.arctan(0.75 * np.tan(0.5 * np.radians(settings.hfov_deg))))) - 1.0
    if settings.camera_pitch_deg is not None and abs(settings.camera_pitch_deg) > most_deg:
        raise ConfigError(f"source.camera_pitch_deg={settings.camera_pitch_deg:g} leaves the horizon out of the picture; "
                          f"expected at most {most_deg:.1f} with source.hfov_deg={settings.hfov_deg:g}")
    pitch_deg = float(np.clip(world.camera_pitch_deg, -most_deg, most_deg))
    return camera_from_fov(width, height, settings.hfov_deg, height_m=world.camera_height_m, pitch_deg=pitch_deg)


def laser_of(settings: Simulator) -> LaserScanner | None:
    """The laser scanner that these settings want."""
    if not settings.laser_beams:
        return None
    return LaserScanner(settings.laser_beams, float(np.radians(settings.laser_fov_deg)), settings.laser_height_m,
                        settings.laser_range_m)


def pace(settings: Simulator) -> RoutePace:
    """The survey's pace in SI units."""
    return RoutePace(settings.step_m, float(np.radians(settings.turn_step_deg)), settings.speed_mps,
                float(np.radians(settings.turn_rate_dps)), settings.arc_radius_m if settings.turn == "arc" else 0.0)


def unicycle(stand: np.ndarray, length_m: float, turn_rad: float) -> np.ndarray:
    """(3,) x, y, yaw after an arc of that length and turn: Thrun et al., Probabilistic Robotics, section 5.3."""
    x, y, yaw = stand
    chord = length_m * float(np.sinc(turn_rad / (2 * np.pi)))
    middle = yaw + turn_rad / 2
    return np.array([x + chord * np.cos(middle), y + chord * np.sin(middle), float(wrap(yaw + turn_rad))])
