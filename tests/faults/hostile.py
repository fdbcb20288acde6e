"""Parts that misbehave in the way one asks for: `--plugin hostile.py odometry=hostile odometry.how=mirror`."""

from __future__ import annotations

import os
import shutil
import subprocess
import threading
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rhs_fakes import parts

import rhs

KEPT: list[Any] = []  # what is leaked


class Wrapped:
    """A light part but for what a subclass changes; `how` says in what way."""

    def __init__(self, inner: Any, how: str, context: Any = None) -> None:
        self.inner, self.how, self.context, self.count = inner, how, context, 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)


def mirrored() -> np.ndarray:
    return np.diag([1.0, -1.0, 1.0, 1.0])


class Odometry(Wrapped):
    """Changes the motion of the third view and of those after it."""

    def update(self, observation: Any) -> Any:
        self.count += 1
        motion = self.inner.update(observation)
        return motion if self.count < 3 else self.spoilt(motion)

    def spoilt(self, motion: Any) -> Any:
        pose, covariance = motion.previous_from_body.copy(), motion.covariance
        lopsided = covariance.copy()
        lopsided[0, 1] = 0.5 * covariance[0, 0]
        row = pose.copy()
        row[3] = [1.0, 2.0, 3.0, 4.0]
        far = pose.copy()
        far[0, 3] = 1e9
        changes = {
            "negative_covariance": {"covariance": -covariance},
            "zero_covariance": {"covariance": 0.0 * covariance},
            "lopsided_covariance": {"covariance": lopsided},
            "nan_covariance": {"covariance": covariance * np.nan},
            "huge_covariance": {"covariance": 1e13 * np.eye(6)},
            "mirror": {"previous_from_body": mirrored()},
            "zeros": {"previous_from_body": np.zeros((4, 4))},
            "last_row": {"previous_from_body": row},
            "scaled": {"previous_from_body": 2.0 * pose},
            "nan_pose": {"previous_from_body": pose * np.nan},
            "far": {"previous_from_body": far},
            "word": {"status": "fine"},
            "no_word": {"status": None},
            "text_pose": {"previous_from_body": "here"},
        }
        return replace(motion, **changes[self.how])


def scan_of(pose: np.ndarray, *, pillar: bool) -> Any:
    """Ranges (N,) metres to the walls of the room of 6 m by 4 m, which looks the same turned round unless a pillar stands
    in it."""
    from rhs.api.geometry import planar
    from rhs.api.records import Scan

    boxes = [(0.0, 0.0, 6.0, 4.0)] + [(4.2, 2.4, 5.0, 3.4)] * pillar
    sides = [
        side
        for x0, y0, x1, y1 in boxes
        for side in (((x0, y0), (x1, y0)), ((x1, y0), (x1, y1)), ((x1, y1), (x0, y1)), ((x0, y1), (x0, y0)))
    ]
    x, y, yaw = planar(pose)
    bearings = np.linspace(-np.pi, np.pi, 90, endpoint=False)
    ranges = np.full(len(bearings), np.inf)
    way = np.stack([np.cos(yaw + bearings), np.sin(yaw + bearings)])
    for start, end in sides:
        along = np.subtract(end, start)
        off = np.subtract(start, (x, y))
        with np.errstate(divide="ignore", invalid="ignore"):
            cross = way[0] * along[1] - way[1] * along[0]
            reach, share = (off[0] * along[1] - off[1] * along[0]) / cross, (off[0] * way[1] - off[1] * way[0]) / cross
        hit = (reach > 1e-6) & (share >= 0.0) & (share <= 1.0)
        ranges[hit] = np.minimum(ranges[hit], reach[hit])
    return Scan(bearings, ranges, 8.0)


class Localiser(Wrapped):
    def update(self, observation: Any, motion: Any) -> Any:
        belief = self.inner.update(observation, motion)
        if self.how == "probability":
            return replace(belief, probability=7.0)
        pose = belief.map_from_body.copy()
        pose[0, 3] = {"far": 1e7, "nan": np.nan}[self.how]
        return replace(belief, map_from_body=pose)


def seed_of(context: Any) -> int:
    """The seed of the run, from its folder's config.yaml."""
    import yaml

    return int(yaml.safe_load((context.folder / "config.yaml").read_text())["seed"])


def forever(context: Any) -> None:
    while True:
        time.sleep(1.0)


def eat_memory(context: Any) -> None:
    while True:
        KEPT.append(bytearray(os.urandom(1 << 20)) * 50)
        time.sleep(0.02)


HARMS = {
    "remove_folder": lambda context: shutil.rmtree(context.folder),
    "os_exit": lambda context: os._exit(0),
    "thread": lambda context: threading.Thread(target=time.sleep, args=(3600,)).start(),
    "child": lambda context: subprocess.Popen(["sleep", parts.MARK]),
    "memory": eat_memory,
    "forever": forever,
}


class Planner(Wrapped):
    """sealed: there is no way to the first place. map: writes into its map. leak: keeps files and memory. long: a path of
    three million points. The others harm whoever is near (HARMS), in the run with the seed only_seed."""

    def plan(self, problem: Any) -> Any:
        from rhs.api.records import Path, PlanReason

        if self.how in HARMS and self.settings.only_seed in (-1, seed_of(self.context)):
            HARMS[self.how](self.context)

        if self.how == "sealed" and problem.goal_m[0] > 2.5:
            return Path(PlanReason.DISCONNECTED, np.zeros((0, 2)), np.zeros((0, 2)))
        if self.how == "map":
            problem.blocked.setflags(write=True)
            problem.blocked[:] = False
        if self.how == "leak":
            KEPT.append((open(os.devnull), bytearray(20 << 20)))
        if self.how == "long":
            points = np.linspace(problem.start_m, problem.goal_m, 3_000_000)
            return Path(PlanReason.OK, points, points)
        return self.inner.plan(problem)


class Mapper(Wrapped):
    def grid(self) -> Any:
        grid = self.inner.grid()
        change = {
            "flat": {"resolution_m": 0.0},
            "chances": {"probability": 0.0 * grid.probability + 7.0},
            "empty": {"probability": grid.probability[:0]},
            "turned": {"probability": grid.probability[0]},
        }
        return replace(grid, **change[self.how])


class Source(Wrapped):
    """same, back, jump, unknown: stamps. stuck: the wheels slip, the robot stays. wall: it comes no further than x = 1.7 m.
    mirror, zeros, no_truth: the truth. scans, pillar: captures hold a scan of the room, with a pillar in it or not."""

    def __init__(self, inner: Any, how: str, context: Any) -> None:
        super().__init__(inner, how, context)
        self.patrolling = False

    def lead(self) -> Any:
        return self.spoilt(self.inner.lead())

    def begin_patrol(self) -> None:
        self.patrolling = True

    def drive(self, command: Any) -> Any:
        before = self.inner.pose.copy()
        capture = self.inner.drive(command)
        if self.how == "stuck" or (self.how == "wall" and self.inner.pose[0, 3] > 1.7):
            turned = self.inner.pose.copy()
            turned[:3, 3] = before[:3, 3]
            self.inner.pose = before if self.how == "stuck" else turned
            capture = replace(
                capture,
                travel=np.zeros(3) if self.how == "stuck" else np.array([0.0, 0.0, command.turn_radps * command.duration_s]),
            )
        return self.spoilt(capture)

    def teleport(self, world_from_body: np.ndarray) -> None:
        self.inner.pose = world_from_body.copy()

    def spoilt(self, capture: Any) -> Any:
        self.count += 1
        if capture is not None and self.how in ("scans", "pillar"):
            return replace(capture, scan=scan_of(self.inner.pose, pillar=self.how == "pillar"))
        if capture is None or self.count < 3:
            return capture
        stamps = {
            "same": 0.8,
            "back": 10.0 - self.count,
            "jump": capture.stamp_s + 3600.0 * (self.count > 3),
            "unknown": float("nan"),
        }
        return replace(capture, stamp_s=stamps.get(self.how, capture.stamp_s))

    def truth(self) -> Any:
        known = self.inner.truth()
        return {"mirror": mirrored(), "zeros": np.zeros((4, 4)), "no_truth": None}.get(self.how, known)


class Sensor(Wrapped):
    """negative, mismatch: a scan that is none. near: every beam ends at 1 cm. sealed_view: a wall ahead of a driven robot,
    wherever it looks. laser: the scan of the capture."""

    def sense(self, capture: Any) -> Any:
        observation = self.inner.sense(capture)
        if self.how == "laser":
            return replace(observation, scan=capture.scan)
        scan, ranges = observation.scan, observation.scan.ranges_m
        self.count += 1
        spoilt = {"negative": -np.ones_like(ranges), "mismatch": ranges[:-1], "near": np.full_like(ranges, 0.01)}
        if self.how == "sealed_view" and capture.command is not None:
            ranges = np.where(np.abs(scan.bearings_rad) < 0.5, 0.6, np.inf)
        return replace(observation, scan=replace(scan, ranges_m=spoilt.get(self.how, ranges)))


def plugin(kind: str, base: type, wrapper: type) -> None:
    """Register `kind`=hostile: the light part of that kind inside the wrapper."""

    @dataclass
    class Hostile(base):  # type: ignore[misc, valid-type]
        how: str = "none"
        only_seed: int = -1

        def build(self, context: Any) -> Any:
            part = wrapper(super().build(context), self.how, context)
            part.settings = self
            return part

    rhs.register(kind, "hostile", Hostile)


for _kind, _base, _wrapper in (
    ("odometry", parts.FakeOdometry, Odometry),
    ("localiser", parts.FakeLocaliser, Localiser),
    ("planner", parts.FakePlanner, Planner),
    ("mapper", parts.FakeMapper, Mapper),
    ("source", parts.FakeSource, Source),
    ("sensor", parts.FakeSensor, Sensor),
):
    plugin(_kind, _base, _wrapper)
