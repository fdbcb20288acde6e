"""Small rooms with painted walls, seen by exact ray casting: what plugins are checked in (rhs.testing).

None of them is symmetric, and all are entered off the middle: what is mirrored, turned or in another unit does not fit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import Context
from rhs.api.frozen import freeze
from rhs.api.geometry import Camera, camera_from_fov, planar, se2
from rhs.api.grid import OccupancyGrid, frame_of
from rhs.api.records import Capture, FeatureSettings, Observation, Scan, Twist, WorldFacts

LOW, HIGH = np.array([-4.0, -3.0, 0.0]), np.array([4.0, 3.0, 2.6])
TEXELS_PER_M = 40.0
RATE_HZ = 5.0  # views per second of a drive
# steps of drives: metres ahead and radians to the left per view, turning further to the left than to the right
SHORT = ((0.0, 0.0), *[(0.1, 0.05)] * 7)
TOUR = ((0.0, 0.0), *[(0.1, 0.05)] * 5, *[(0.12, 0.02)] * 4, *[(0.1, 0.0)] * 3, *[(0.09, -0.03)] * 3)


@dataclass(frozen=True)
class Room:
    """A box-shaped room, or a tube along x, with boxes standing in it.

    low, high: (3,) corners, metres. radius_m: of a tube whose axis lies that high over y = 0; 0 for a room with flat walls.
    boxes: (low, high) corners each. start: (x m, y m, yaw rad) of the drive through it."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    start: tuple[float, float, float]
    radius_m: float = 0.0
    boxes: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = ()

    @property
    def facts(self) -> WorldFacts:
        bounds = (self.low[0], self.low[1], self.high[0], self.high[1])
        return WorldFacts(f"testing {self.name}", self.start, (("corner", self.high[0] - 2.0, 0.0),), bounds, 0.2)


HALL = Room("room", (-4.0, -3.0, 0.0), (4.0, 3.0, 2.6), (-1.5, -0.5, 0.2))
FURNISHED = Room("furnished room", HALL.low, HALL.high, HALL.start,
                 boxes=(((1.2, 0.9, 0.0), (1.8, 1.4, 1.9)), ((2.4, -1.7, 0.0), (3.0, -1.0, 0.8)),
                        ((0.5, -2.6, 0.0), (0.9, -1.9, 1.4)), ((3.2, 0.0, 0.9), (4.0, 0.5, 1.5))))
CORRIDOR = Room("corridor", (-4.0, -1.0, 0.0), (16.0, 1.0, 2.5), (-3.0, 0.0, 0.0))
TUBE = Room("tube", (-4.0, -1.12, 0.0), (16.0, 1.12, 2.24), (-3.0, 0.0, 0.0), radius_m=1.12)

CAMERA = camera_from_fov(160, 120, 70.0, height_m=1.0)
BEARINGS = np.linspace(-0.6, 0.6, 81)


@cache
def paintings(seed: int = 0) -> np.ndarray:
    """Six smooth random textures (6, 512, 512) of grey levels."""
    rng = np.random.default_rng(seed)
    fine = rng.uniform(0, 255, (6, 512, 512))
    coarse = np.kron(rng.uniform(0, 255, (6, 64, 64)), np.ones((1, 8, 8)))
    for axis in (1, 2):
        fine = (np.roll(fine, 1, axis) + fine + np.roll(fine, -1, axis)) / 3
        coarse = np.mean([np.roll(coarse, n, axis) for n in range(-2, 3)], axis=0)
    textures = 0.4 * fine + 0.6 * coarse
    textures.setflags(write=False)
    return textures


def see(camera: Camera, world_from_body: np.ndarray, textures: np.ndarray, index: int = 0, room: Room = HALL) -> Capture:
    """The ideal view of the room from a pose: RGB image (grey) and depth along the optical axis."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    pose = world_from_body @ camera.body_from_camera
    depth, texel, face = _meet(room, pose[:3, 3], rays @ pose[:3, :3].T)
    low = np.floor(texel).astype(int)
    part = texel - low
    value = np.zeros(len(depth))
    for dx in (0, 1):
        for dy in (0, 1):
            share = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            value += share * textures[face, (low[:, 0] + dx) % 512, (low[:, 1] + dy) % 512]
    grey = np.rint(value).astype(np.uint8).reshape(camera.height, camera.width)
    image = np.repeat(grey[:, :, None], 3, axis=2)
    return Capture(index, index / RATE_HZ, image, depth.reshape(grey.shape).astype(np.float32))


def observe(camera: Camera, world_from_body: np.ndarray, textures: np.ndarray, index: int = 0,
            room: Room = HALL) -> Observation:
    """The same view as a perfect sensor reports it."""
    capture = see(camera, world_from_body, textures, index, room)
    return Observation(index, capture.stamp_s, camera, capture.image, capture.depth)


def _meet(room: Room, eye: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where rays (N, 3) meet the room: (N,) lengths in units of the rays, (N, 2) texels, (N,) faces."""
    low, high = np.array(room.low), np.array(room.high)
    with np.errstate(divide="ignore", invalid="ignore"):
        to_walls = np.where(directions == 0, np.inf, np.where(directions > 0, high - eye, low - eye) / directions)
        if room.radius_m > 0:
            to_walls[:, 1:] = _to_tube(room.radius_m, eye, directions)[:, None]
        axis = to_walls.argmin(axis=1)
        reach = to_walls[np.arange(len(axis)), axis]
        face = 2 * axis + (directions[np.arange(len(axis)), axis] > 0)
        for number, (near, far) in enumerate(room.boxes):
            ends = np.sort(np.stack([np.array(near) - eye, np.array(far) - eye])[:, None, :] / directions, axis=0)
            entry, leave = ends[0].max(axis=1), ends[1].min(axis=1)
            hit = (entry < leave) & (entry > 0.05) & (entry < reach)
            reach, axis = np.where(hit, entry, reach), np.where(hit, ends[0].argmax(axis=1), axis)
            face = np.where(hit, (axis + number) % 6, face)
        at = eye + directions * reach[:, None]
    texel = np.take_along_axis(at, np.array([[1, 2], [0, 2], [0, 1]])[axis], axis=1)
    if room.radius_m > 0:
        around = room.radius_m * np.arctan2(at[:, 1], at[:, 2] - room.radius_m)
        texel = np.where((axis > 0)[:, None], np.stack([at[:, 0], around], axis=1), texel)
        face = np.where(axis > 0, 2, face)
    return reach, texel * TEXELS_PER_M, face


def _to_tube(radius: float, eye: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(N,) lengths of rays (N, 3) from inside a tube along x whose axis lies at y = 0, z = radius."""
    y, z = eye[1], eye[2] - radius
    a = (directions[:, 1:] ** 2).sum(axis=1)
    b = directions[:, 1] * y + directions[:, 2] * z
    return np.asarray((-b + np.sqrt(b**2 + a * (radius**2 - y**2 - z**2))) / a)


def ranges(room: Room, world_from_body: np.ndarray, bearings: np.ndarray,
           origin_xy_m: tuple[float, float] = (0.0, 0.0), height_m: float = 1.0) -> np.ndarray:
    """(N,) exact metres to the room's walls and boxes along bearings (N,), from a point of the body at a height."""
    yaw = planar(world_from_body)[2] + bearings
    eye = world_from_body @ np.array([*origin_xy_m, height_m, 1.0])
    return _meet(room, eye[:3], np.stack([np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))], axis=1))[0]


def scan_of(world_from_body: np.ndarray, room: Room = HALL) -> Scan:
    """Exact ranges to the walls of the room, from the body."""
    return Scan(BEARINGS.copy(), ranges(room, world_from_body, BEARINGS), 12.0)


def cloud_of(world_from_body: np.ndarray, room: Room = HALL, seed: int | None = None) -> np.ndarray:
    """(N, 3) float32 points in the body frame, metres: 16 rings of 180 beams from 1 m above the floor, 15 degrees down to 15
    up. seed: of a noise of 1 cm along the beams; None for exact ones."""
    rise, turn = np.meshgrid(np.radians(np.linspace(-15.0, 15.0, 16)), np.radians(np.arange(-180.0, 180.0, 2.0)))
    rays = np.stack([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)], axis=-1).reshape(-1, 3)
    eye = np.array([0.0, 0.0, 1.0])
    reach = _meet(room, (world_from_body @ [*eye, 1.0])[:3], rays @ world_from_body[:3, :3].T)[0]
    if seed is not None:
        reach = reach + 0.01 * np.random.default_rng(seed).standard_normal(len(reach))
    cloud: np.ndarray = (eye + reach[:, None] * rays).astype(np.float32)
    return cloud


@cache
def drive(room: Room = HALL, steps: tuple[tuple[float, float], ...] = TOUR,
          seed: int = 0) -> tuple[tuple[np.ndarray, Observation], ...]:
    """True poses, and what good sensors of every kind report of a drive: steps are (metres ahead, radians to the left).

    Noise: image 2 grey levels; depth that of a Kinect (Khoshelham and Elberink 2012), to 8 m; scan 5 mm; wheel 1 mm, 1 mrad
    and 2 per cent. The command is what was done."""
    rng, pose, out = np.random.default_rng(seed), se2(*room.start), []
    for index, (ahead, left) in enumerate(steps):
        pose = pose @ se2(ahead, 0.0, left)
        seen = observe(CAMERA, pose, paintings(), index, room)
        assert seen.image is not None and seen.depth is not None
        image = np.clip(seen.image + 2.0 * rng.standard_normal(seen.image.shape[:2])[:, :, None], 0, 255).astype(np.uint8)
        depth = seen.depth + (0.0012 + 0.0019 * (seen.depth - 0.4) ** 2) * rng.standard_normal(seen.depth.shape)
        exact = scan_of(pose, room)
        scan = replace(exact, ranges_m=exact.ranges_m + 0.005 * rng.standard_normal(len(BEARINGS)))
        moved = np.array([ahead, 0.0, left])
        wheel = moved + (0.02 * np.abs(moved) + 1e-3 * bool(index)) * rng.standard_normal(3)
        out.append((pose, freeze(replace(seen, image=image, depth=np.where(depth < 8.0, depth, np.nan).astype(np.float32),
                                       scan=scan, wheel=wheel, extras={"cloud": cloud_of(pose, room, index)},
                                       command=Twist(ahead * RATE_HZ, left * RATE_HZ, 1.0 / RATE_HZ)))))
    return tuple(out)


def blind(observation: Observation, index: int) -> Observation:
    """The view with nothing in it: a grey image, no depth, no ranges, no points, no wheel, no command."""
    scan = observation.scan
    assert observation.image is not None and scan is not None
    return freeze(replace(
        observation, index=index, stamp_s=index / RATE_HZ, wheel=None, command=None,
        image=np.full_like(observation.image, 128), depth=np.full(observation.image.shape[:2], np.nan, np.float32),
        scan=replace(scan, ranges_m=np.full_like(scan.ranges_m, np.nan)), extras={"cloud": np.empty((0, 3), np.float32)}))


def for_part(settings: Any, observation: Observation) -> Observation:
    """The observation with only what the part asked for: of depth, scan and wheel."""
    needs = type(settings).needs
    return replace(observation, depth=observation.depth if "depth" in needs else None,
                   scan=observation.scan if "scan" in needs else None,
                   wheel=observation.wheel if "wheel" in needs else None)


def context(folder: Path, seed: int = 0, room: Room = HALL) -> Context:
    """What a part is built from, in this room."""
    return Context(np.random.default_rng(seed), CAMERA, room.facts, folder, FeatureSettings())


def empty_grid(room: Room = HALL) -> OccupancyGrid:
    """The true map of a room without boxes: walls on its border, free inside."""
    (rows, columns), origin = frame_of(room.facts.bounds_m, 0.1)
    probability = np.full((rows, columns), 0.02, np.float32)
    probability[[0, 1, 2, -3, -2, -1]] = 0.98
    probability[:, [0, 1, 2, -3, -2, -1]] = 0.98
    return OccupancyGrid(probability, 0.1, origin)
