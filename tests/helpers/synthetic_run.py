"""Steps and run folders without a simulator: a robot that goes round a square room, with a small known drift."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from rhs.api.geometry import Camera, camera_from_fov, inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Belief, Event, Motion, Observation, PlanReason, Scan, Step, Tracking, Twist, WorldFacts
from rhs.api.records import Path as Plan
from rhs.api.trajectory import Trajectory, read_tum, write_tum
from rhs.runfolder.steps_csv import StepTable

CAMERA = camera_from_fov(32, 24, 60.0, height_m=1.0)
FACTS = WorldFacts("room", (2.0, 2.0, 0.0), (("east", 8.0, 2.0), ("north", 8.0, 8.0)), (0.0, 0.0, 10.0, 10.0), 0.3)


def true_pose(index: int, count: int) -> np.ndarray:
    """Round the square (2, 2) to (8, 8), heading along the side."""
    way = 24.0 * index / max(count - 1, 1)
    side, along = min(int(way // 6.0), 3), way - 6.0 * min(int(way // 6.0), 3)
    corners = ((2.0, 2.0), (8.0, 2.0), (8.0, 8.0), (2.0, 8.0))
    heading = side * np.pi / 2
    return se2(corners[side][0] + along * np.cos(heading), corners[side][1] + along * np.sin(heading), heading)


def make_steps(count: int = 40, *, phase: str = "survey", drift: float = 0.01, camera: Camera = CAMERA, first: int = 0):
    """Steps whose believed motion is `drift` too long each time; images and depth are seeded noise."""
    rng = np.random.default_rng(7)
    belief = true_pose(0, count)
    plan = Plan(PlanReason.OK, np.array([[2.0, 2.0], [8.0, 2.0], [8.0, 8.0]]), np.array([[2.0, 2.0], [8.0, 8.0]]))
    patrol = phase == "patrol"
    for i in range(count):
        truth = true_pose(i, count)
        motion = np.eye(4)
        if i:
            motion = inverse(true_pose(i - 1, count)) @ truth
            motion[:3, 3] *= 1.0 + drift
        belief = belief @ motion
        yield Step(first + i, phase, 0.4 * (first + i), observe(first + i, rng, camera),
                   Motion(motion, np.eye(6) * 1e-4, Tracking.OK, details={"inliers": 50.0 + i}),
                   Belief(belief, np.eye(6) * 1e-3), None, truth, plan if patrol else None, int(patrol),
                   (Event.ARRIVED,) if patrol and i in (count // 4, count // 2) else (),
                   Twist(0.5, 0.0, 0.4), {"sense": 1.0, "odometry": 2.0 + i % 3}, 0.4, False)


def observe(index: int, rng: np.random.Generator, camera: Camera) -> Observation:
    """A view of noise: what compresses worst and reveals any loss."""
    shape = (camera.height, camera.width)
    depth = rng.uniform(0.5, 8.0, shape).astype(np.float32)
    depth[:4] = np.nan
    scan = Scan(np.arctan(np.linspace(0.5, -0.5, camera.width)), rng.uniform(1.0, 8.0, camera.width), 8.0, (0.1, 0.0))
    return Observation(index, 0.4 * index, camera, rng.integers(0, 255, (*shape, 3), dtype=np.uint8), depth, scan,
                       Twist(0.5, 0.1, 0.4), np.array([0.2, 0.001, 1.0 / 3.0]))


def room(resolution_m: float = 0.1) -> OccupancyGrid:
    """The room's plan: walls round 10 m by 10 m, a pillar block in the middle."""
    n = round(10.0 / resolution_m)
    p = np.full((n, n), 0.01, np.float32)
    p[:3] = p[-3:] = p[:, :3] = p[:, -3:] = 0.99
    p[n * 2 // 5 : n * 3 // 5, n * 2 // 5 : n * 3 // 5] = 0.99
    return OccupancyGrid(p, resolution_m, (0.0, 0.0))


def make_run(folder: Path, *, count: int = 40, drift: float = 0.01, patrol: bool = True) -> Path:
    """A run folder with the files the loop leaves."""
    from rhs.worlds.maps import save_map

    folder.mkdir(parents=True, exist_ok=True)
    table = StepTable(folder)
    for step in make_steps(count, drift=drift):
        table.add(step)
    if patrol:
        for step in make_steps(count, phase="patrol", drift=0.001, first=count):
            table.add(step)
    table.close()
    truth = read_tum(folder / "truth_survey.tum")
    write_tum(folder / "corrected.tum", Trajectory(truth.stamps_s, truth.poses @ se2(0.02, 0.0, 0.0)))
    seen = room()
    seen.probability[:, :5] = np.nan
    save_map(folder / "map", seen)
    save_map(folder / "true_map", room())
    places = [{"name": name, "x_m": x, "y_m": y} for name, x, y in FACTS.places]
    (folder / "facts.json").write_text(json.dumps({"name": FACTS.name, "start": FACTS.start, "places": places,
                                                   "bounds_m": FACTS.bounds_m, "robot_radius_m": FACTS.robot_radius_m}))
    missions = [{"mission": i + 1, "place": name, "goal_m": [x, y], "start_m": [2.0, 2.0], "status": "arrived",
                 "reason": "", "replans": i, "steps": 10} for i, (name, x, y) in enumerate(FACTS.places)]
    (folder / "missions.json").write_text(json.dumps(missions if patrol else []))
    plans = [{"step": count, "mission": 1, "reason": "ok", "points_m": [[2, 2], [8, 2]], "raw_m": [[2, 2], [8, 2]],
              "plan_ms": 1.0, "learn_ms": 2.0}]
    (folder / "plans.json").write_text(json.dumps(plans if patrol else []))
    return folder
