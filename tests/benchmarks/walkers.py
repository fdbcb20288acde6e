"""Where people stood during a patrol, worked out from its folder, and to which places nobody could have got for them."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from rhs.api.floorplan import World, after, truth_grid
from rhs.api.geometry import inverse, planar, se2
from rhs.api.grid import OccupancyGrid, configuration_space
from rhs.worlds.live import Live
from rhs_sources.simulator import SUBSTEP_S, unicycle

CELL_M, SIDE_M = 0.05, 0.02  # of the plan; least room beside a robot that knows where everybody is
SPEED_MPS = 0.5  # of such a robot
AFTER_S = 300.0  # so long people walk on after the patrol, seconds


def people_at(world: World, steps: list[Mapping[str, str]]) -> Iterator[tuple[float, np.ndarray]]:
    """Of each view of a patrol, and every half second for AFTER_S more with the robot where it ended: seconds since the one
    before, and where the people of the world stood, (P, 2) metres. steps: rows of steps.csv. Right to a millimetre (median,
    by the clearance in that table), as people heed the robot only."""
    patrol = [step for step in steps if step["phase"] == "patrol"]
    stand = stand_of([step for step in steps if step["phase"] == "survey"][-1])
    live = Live(world.moving, np.array([*stand[:2], world.robot_radius_m]), patrol=True)
    ways = [(float(step["duration_s"]), stand_of(step)) for step in patrol]
    for seconds, to in [*ways, *[(0.5, ways[-1][1])] * round(2 * AFTER_S)]:
        moved = planar(inverse(se2(*stand)) @ se2(*to))
        chord = float(moved[0] * np.cos(0.5 * moved[2]) + moved[1] * np.sin(0.5 * moved[2]))
        length = chord / np.sinc(moved[2] / (2 * np.pi))
        substeps = max(1, int(np.ceil(seconds / SUBSTEP_S - 1e-9)))
        for share in np.arange(substeps) / substeps:
            at = unicycle(stand, length * share, moved[2] * share)
            live.step(seconds / substeps, np.array([*at[:2], world.robot_radius_m]))
        stand = to
        yield seconds, np.array([(at.x_m, at.y_m) for at in live.stands()[:len(world.moving.people)]]).reshape(-1, 2)


def got_to(world: World, folder: Path) -> set[str]:
    """Names of the places that a robot which knew where everybody would walk could have got to from where the patrol began,
    while it went on or soon after: cells that it reaches in time, round people who walk as they did. An upper bound."""
    with (folder / "steps.csv").open(newline="") as file:
        steps = list(csv.DictReader(file))
    plan = truth_grid(after(world), CELL_M)
    growth_m = world.robot_radius_m + SIDE_M
    free = ~configuration_space(~plan.free(), growth_m / CELL_M)
    goals = {name: tuple(plan.cells(np.array([[x, y]]))[0]) for name, x, y in world.places}
    reached, found, left_m = np.zeros(free.shape, bool), set[str](), 0.0
    reached[tuple(plan.cells(np.array([stand_of([s for s in steps if s["phase"] == "patrol"][0])[:2]]))[0])] = True
    for seconds, people_m in people_at(world, steps):
        left_m += SPEED_MPS * seconds
        rings, left_m = int(left_m // CELL_M), left_m % CELL_M
        now = free & ~taken(world, plan, people_m, growth_m)
        reached = spread(reached & now, now, rings)
        found |= {name for name, cell in goals.items() if reached[cell]}
        if len(found) == len(goals):
            break
    return found


def taken(world: World, plan: OccupancyGrid, people_m: np.ndarray, growth_m: float) -> np.ndarray:
    """(H, W) bool: where the middle of the robot would be in somebody."""
    rows, columns = (np.arange(count) + 0.5 for count in plan.shape)
    y_m, x_m = rows[:, None] * CELL_M + plan.origin_m[1], columns[None] * CELL_M + plan.origin_m[0]
    out = np.zeros(plan.shape, bool)
    for person, (x, y) in zip(world.moving.people, people_m, strict=True):
        out |= np.hypot(y_m - y, x_m - x) < growth_m + 0.5 * person.width_m
    return out


def spread(reached: np.ndarray, free: np.ndarray, rings: int) -> np.ndarray:
    """Cells within so many steps of those reached, over free ones."""
    from scipy.ndimage import binary_dilation

    if not rings:
        return reached
    grown: np.ndarray = binary_dilation(reached, np.ones((3, 3)), iterations=rings, mask=free)
    return grown


def stand_of(step: Mapping[str, str]) -> np.ndarray:
    """(3,) the true x, y and yaw of a view."""
    return np.array([float(step[name]) for name in ("true_x_m", "true_y_m", "true_yaw_rad")])
