"""Recordings of a camera in a hand that nobody has to be asked for: a furnished room, a way through it, a Kinect's noise.

A room drawn from a seed (walls in part plain, pictures, a counter with things on it, cupboards, a table, chairs), seen along
one of WAYS by the rasteriser of rhs, with what a hand and a Kinect add: shake, blur over the exposure, an exposure that
follows the light, depth in steps of disparity with noise that neighbours share, a smooth distortion and a scale of its own,
frayed edges, shadows of the projector, nothing under 0.5 m, over 5 m and on surfaces seen edge on. Written as a TUM folder.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rhs.api.floorplan import Box, Surface
from rhs.api.geometry import Camera, exp_so3, inverse, log_so3, se3
from rhs.api.trajectory import Trajectory, read_tum, write_tum
from rhs_sources.raster.renderer import Mesh, Renderer
from rhs_sources.replay_cameras import DEPTH_CAMERAS
from rhs_sources.simulator_mesh import WHOLE, box_lids, box_sides, floor_and_ceiling
from rhs_sources.simulator_textures import painting, surface

RATE_HZ = 20.0
WAYS = ("counter", "round", "table", "back", "nod", "covered")
DISPARITY_M_PX = 43.5  # of a Kinect: 580 pixels, 75 mm
EXPOSED_S = 0.02
PAIR = DEPTH_CAMERAS["seven_scenes"]


def room(seed: int) -> tuple[Mesh, np.ndarray, tuple[float, float]]:
    """What stands in a room of (width, depth) metres, and the middle (3,) of its table top."""
    rng = np.random.default_rng([seed, 1])
    w, d, h = rng.uniform(3.6, 5.2), rng.uniform(3.4, 4.6), rng.uniform(2.4, 2.8)
    painted: list = []

    def wear(quads, look: Surface, size_m, px_per_m=150.0):
        painted.append((quads, surface(rng, look, size_m, px_per_m)))

    def stand(name, x, y, size, *, bottom=0.0, yaw=0.0, look=None, pictured=False):
        box = Box(name, (x, y), size, yaw, bottom, look or tint(rng, ("wood", "plain", "plaster")))
        if pictured:
            painted.append((box_sides(box), painting(rng, (240, 120))))
            painted.append((box_lids(box), painting(rng, (120, 120))))
            return
        wear(box_sides(box), box.surface, (2 * (size[0] + size[1]), size[2]))
        wear(box_lids(box), box.surface, size[:2])

    floor, ceiling = floor_and_ceiling((0.0, 0.0, w, d), h)
    wear([floor], tint(rng, ("wood", "tiles", "carpet"), (90, 170), (8, 25)), (w, d))
    wear([ceiling], tint(rng, ("plain", "plaster"), (190, 225), (1, 5)), (w, d))
    corners = np.array([[0, 0], [w, 0], [w, d], [0, d]])
    for n in range(4):
        a, b = corners[n], corners[(n + 1) % 4]
        length = float(np.linalg.norm(b - a))
        wear([(upright(a, b, 0.0, h), WHOLE)], tint(rng, ("plaster", "plain", "tiles"), (130, 220), (2, 9)), (length, h))
        inward = np.array([a[1] - b[1], b[0] - a[0]]) / length
        for at in np.arange(rng.uniform(0.3, 0.8), length - 0.6, rng.uniform(0.9, 1.8)):
            if rng.random() < 0.6:
                p, q = (a + (b - a) * t / length + 0.01 * inward for t in (at, at + rng.uniform(0.3, 0.55)))
                low = rng.uniform(1.2, 1.5)
                painted.append(([(upright(p, q, low, low + rng.uniform(0.3, 0.5)), WHOLE)], painting(rng, (160, 140))))
    stand("counter", w / 2, 0.3, (w - 0.2, 0.6, 0.9))
    stand("fridge", w - 0.35, d * 0.6, (0.6, 0.6, 1.8), look=Surface("plain", (215.0, 215.0, 210.0), 1.0))
    for n in range(3):
        stand(f"cupboard{n}", w * (0.2 + 0.3 * n), 0.18, (0.7, 0.35, 0.6), bottom=1.5)
    for n in range(12):
        size = (*rng.uniform(0.08, 0.28, 2), rng.uniform(0.08, 0.35))
        stand(f"thing{n}", rng.uniform(0.3, w - 0.3), rng.uniform(0.2, 0.5), size, bottom=0.9, yaw=rng.uniform(0, 3),
              pictured=n % 3 > 0)
    middle = np.array([w * rng.uniform(0.45, 0.55), d * rng.uniform(0.52, 0.6), 0.75])
    stand("top", *middle[:2], (1.2, 0.8, 0.04), bottom=0.71, yaw=rng.uniform(-0.3, 0.3))
    for n, (dx, dy) in enumerate(((-0.5, -0.3), (0.5, -0.3), (0.5, 0.3), (-0.5, 0.3))):
        stand(f"leg{n}", middle[0] + dx, middle[1] + dy, (0.05, 0.05, 0.71))
        stand(f"chair{n}", middle[0] + 1.5 * dx, middle[1] + 2.2 * dy, (0.4, 0.4, 0.45), yaw=rng.uniform(0, 3))
    for n in range(7):
        size = (*rng.uniform(0.06, 0.3, 2), rng.uniform(0.03, 0.25))
        stand(f"dish{n}", *(middle[:2] + rng.uniform((-0.5, -0.3), (0.5, 0.3))), size, bottom=0.75, yaw=rng.uniform(0, 3),
              pictured=n % 2 > 0)
    stand("shelf", 0.15, d * 0.7, (0.3, 1.0, 1.7), pictured=rng.random() < 0.5)
    return Mesh.of_quads(painted), middle, (w, d)


def tint(rng, recipes, light=(60, 210), rough=(3, 15)) -> Surface:
    colour = np.clip(rng.uniform(*light) + rng.uniform(-25, 25, 3), 20, 240)
    return Surface(recipes[int(rng.integers(len(recipes)))], tuple(map(float, colour)), float(rng.uniform(*rough)))


def upright(a, b, low: float, high: float) -> np.ndarray:
    """(4, 3) corners of a quad over the ground line from a to b, seen from its left."""
    return np.array([[*b, low], [*a, low], [*a, high], [*b, high]], float)


def held(way: str, seed: int, views: int, middle: np.ndarray, size: tuple[float, float], nod: Path | None) -> np.ndarray:
    """(N, 4, 4) world_from_body, x ahead, z up, of a hand. nod: TUM trajectory of a real hand's turning."""
    rng = np.random.default_rng([seed, 2])
    t, (w, d), side = np.linspace(0.0, 1.0, views), size, rng.choice([-1.0, 1.0])
    slow = sway(rng, t, 3)
    if way in ("counter", "covered"):  # along the counter and back, looking at it, up and down
        x = w / 2 + side * 0.3 * w * np.sin(2 * np.pi * t)
        eye = np.column_stack([x, 0.48 * d + 0.3 * slow[:, 0], 1.35 + 0.15 * slow[:, 1]])
        at = np.column_stack([x + 0.3 * side * np.sin(4 * np.pi * t), np.full(views, 0.2), 1.05 + 0.3 * slow[:, 2]])
    elif way == "round":  # once round on a circle, looking outward, and a little on
        angle = side * 2.2 * np.pi * t + rng.uniform(0, 6)
        out = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(views)])
        eye = np.array([w / 2, d / 2, 1.4]) + 0.5 * out + 0.1 * slow
        at = eye + out + np.array([0.0, 0.0, -0.15]) + 0.15 * sway(rng, t, 4)
    elif way == "table":  # round the table, looking at it from the other side on the way back
        angle = side * 1.25 * np.pi * np.sin(np.pi * t) ** 2 * 1.6 + rng.uniform(0, 6)
        reach = np.minimum(0.36 * min(w, d), 1.5) * (1.0 + 0.1 * slow[:, 0])
        eye = middle + np.column_stack([reach * np.cos(angle), reach * np.sin(angle), 0.65 + 0.15 * slow[:, 1]])
        at = middle + 0.2 * sway(rng, t, 4)
    elif way == "back":  # away from the counter to the far wall, round, and back at the counter from elsewhere
        s = np.sin(np.pi * t) ** 2
        eye = np.column_stack([w / 2 + side * 0.08 * w * (2 * t - 1), d * (0.4 + 0.3 * s), 1.4 + 0.1 * slow[:, 0]])
        yaw = -np.pi / 2 + side * 2 * np.pi * t + 0.25 * slow[:, 1]
        at = eye + np.column_stack([np.cos(yaw), np.sin(yaw), -0.25 + 0.1 * slow[:, 2]])
    else:  # "nod": turns of a real hand, slower, there and back, at the table
        assert nod is not None
        real = read_tum(nod).poses
        k = np.minimum(np.abs(((4.0 * t) % 2.0) - 1.0), 1.0) * (len(real) - 1)
        low = np.minimum(k.astype(int), len(real) - 2)
        turns = [log_so3(real[0][:3, :3].T @ real[i][:3, :3] @ exp_so3((f - i) * log_so3(
            real[i][:3, :3].T @ real[i + 1][:3, :3]))) for f, i in zip(k, low, strict=True)]
        eye = middle + np.array([side * 1.2, -0.1, 0.6]) + 0.25 * slow
        base = looking(eye[:1], middle[None])[0][:3, :3]
        optical = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]], float)
        poses = np.stack([se3(base @ optical @ exp_so3(turn * [side, 1.0, side]) @ optical.T, e)
                          for turn, e in zip(turns, eye, strict=True)])
        return shaken(poses, rng, t)
    return shaken(looking(eye, at), rng, t)


def looking(eye: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N, 4, 4) poses at eye (N, 3) with x towards at (N, 3), upright."""
    x = at - eye
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    return np.stack([se3(np.column_stack([a, b, np.cross(a, b)]), e) for a, b, e in zip(x, y, eye, strict=True)])


def sway(rng: np.random.Generator, t: np.ndarray, waves: int) -> np.ndarray:
    """(T, 3) smooth, within one, the same at both ends of t in 0..1."""
    out = sum(rng.uniform(-1, 1, 3) * np.sin(2 * np.pi * (n * t[:, None] + rng.uniform(0, 1, 3)))
              for n in range(1, waves + 1))
    return out / max(1.0, float(np.abs(out).max()))


def shaken(poses: np.ndarray, rng: np.random.Generator, t: np.ndarray) -> np.ndarray:
    """The same with the shake of a hand: 3 mm and 0.4 degrees, up to 4 Hz."""
    waves = int(4.0 * len(t) / RATE_HZ)
    def shake():
        return sum(rng.normal(0, 1, 3) * np.sin(2 * np.pi * (n * t[:, None] + rng.uniform(0, 1, 3)))
                   for n in range(5, max(waves, 6))) / np.sqrt(0.5 * max(waves - 5, 1))
    turns, shifts = np.radians(0.4) * shake(), 0.003 * shake()
    return np.stack([p @ se3(exp_so3(a), b) for p, a, b in zip(poses, turns, shifts, strict=True)])


def camera_of(width: int) -> Camera:
    """Of these recordings: a Kinect's, without distortion."""
    f = 525.0 * width / 640
    return Camera(width, width * 3 // 4, f, f, (width - 1) / 2, (width * 3 // 4 - 1) / 2)


class Kinect:
    """The depth of a Kinect, from the true one."""

    def __init__(self, rng: np.random.Generator, shape: tuple[int, int], shift_px: float = 0.0) -> None:
        """shift_px: disparities are all too large by so much (of 640 pixels): depth is short by shift_px / 43.5 z^2."""
        self._rng, self._shape, self._shift = rng, shape, shift_px
        self._scale = 1.0 + 0.005 * rng.standard_normal()
        self._bent = 0.08 * self._smooth(shape[1] // 5)  # pixels of disparity

    def _smooth(self, cell: int) -> np.ndarray:
        h, w = self._shape
        return cv2.resize(self._rng.standard_normal((h // cell + 2, w // cell + 2)).astype(np.float32), (w, h),
                          interpolation=cv2.INTER_CUBIC)

    def sees(self, depth: np.ndarray) -> np.ndarray:
        """(H, W) metres, NaN unknown."""
        h, w = self._shape
        columns, rows = np.meshgrid(np.arange(w, dtype=np.float32), np.arange(h, dtype=np.float32))
        frayed = cv2.remap(np.nan_to_num(depth), columns + self._smooth(4) * w / 640, rows + self._smooth(4) * w / 640,
                           cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        with np.errstate(divide="ignore", invalid="ignore"):
            disparity = DISPARITY_M_PX / frayed
            across = columns + disparity * w / 640
            hidden = across < np.maximum.accumulate(np.nan_to_num(across, posinf=0.0), axis=1) - 1.0
            slope = np.hypot(cv2.Sobel(disparity, cv2.CV_32F, 1, 0), cv2.Sobel(disparity, cv2.CV_32F, 0, 1)) / 8 * w / 640
            noise = 0.05 * self._rng.standard_normal(depth.shape).astype(np.float32) + 0.04 * self._smooth(3)
            measured = np.rint(8.0 * (disparity + self._shift + self._bent + noise)) / 8.0
            metres = self._scale * DISPARITY_M_PX / measured
            metres[hidden | (slope > 0.35) | ~((metres > 0.5) & (metres < 5.0))] = np.nan
        return metres


def write(folder: Path, way: str, seed: int, *, views: int = 400, width: int = 320, nod: Path | None = None,
          beside: bool = False, shift_px: float = 0.0) -> Camera:
    """A TUM folder of one way through one room; returns its camera. beside: depth is that of a camera beside the one of
    colour, and left so, as in 7-Scenes. shift_px: Kinect."""
    mesh, middle, size = room(seed)
    poses = held(way, seed, views, middle, size, nod)
    camera = camera_of(width)
    drawer, rng = Renderer(camera), np.random.default_rng([seed, 3])
    kinect, gain = Kinect(rng, (camera.height, camera.width), shift_px), None
    f = PAIR.fx * width / 640
    ranger = Renderer(replace(camera, fx=f, fy=f, cx=width / 2, cy=width * 3 / 8)) if beside else None
    aside = camera.body_from_camera @ PAIR.color_from_depth @ inverse(camera.body_from_camera)
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    lines, stamps = [], 100.0 + np.arange(views) / RATE_HZ
    for n in range(views):
        step = inverse(poses[max(n - 1, 0)]) @ poses[min(n + 1, views - 1)]
        share = EXPOSED_S * RATE_HZ / 2.0
        parts = []
        for k in (-0.5, 0.0, 0.5):
            part = se3(exp_so3(k * share * log_so3(step[:3, :3])), k * share * step[:3, 3])
            image, depth = drawer.render(mesh, poses[n] @ part)
            parts.append(image.astype(np.float32))
            if k == 0.0:
                seen = kinect.sees(depth if ranger is None else ranger.render(mesh, poses[n] @ aside)[1])
        light = np.mean(parts, axis=0)
        wanted = 110.0 / max(float(light.mean()), 1.0)
        gain = wanted if gain is None else gain + 0.15 * (wanted - gain)
        noisy = gain * light + 2.5 * rng.standard_normal(light.shape, np.float32)
        if way == "covered" and 0.45 * views <= n < 0.45 * views + 15:
            noisy, seen = np.full_like(noisy, 12.0), np.full_like(seen, np.nan)
        name = f"{stamps[n]:.6f}.png"
        cv2.imwrite(str(folder / "rgb" / name), np.clip(np.rint(noisy), 0, 255).astype(np.uint8)[..., ::-1])
        cv2.imwrite(str(folder / "depth" / name), np.rint(5000.0 * np.nan_to_num(seen)).clip(0, 65535).astype(np.uint16))
        lines.append(f"{stamps[n]:.6f} rgb/{name} {stamps[n]:.6f} depth/{name}\n")
    (folder / "associations.txt").write_text("".join(lines))
    write_tum(folder / "groundtruth.txt", Trajectory(stamps, poses @ camera.body_from_camera))
    return camera
