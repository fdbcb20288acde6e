"""Gaps hardly wider than the robot are planned through where the finer view of them leaves room, and nowhere else."""

import numpy as np
import pytest
from flatland import Dijkstra

from rhs.api.grid import OccupancyGrid
from rhs.patrol.guard import TIGHT_M
from rhs.patrol.mission import MissionSettings
from rhs.patrol.planning import RoomyPlanner, length_m

RADIUS_M = 0.22


def gap(width_m: float, at_m: float) -> tuple[OccupancyGrid, np.ndarray]:
    """A room of 4 m with a wall along x = 2 and a gap in it from y = at_m on, on a map of 10 cm, where a cell is taken when
    the wall is in part of it; and the wall's points every 5 cm."""
    y = np.concatenate([np.arange(0.0, at_m + 1e-9, 0.05), [at_m, at_m + width_m], np.arange(4.0, at_m + width_m, -0.05)])
    wall = np.stack([np.full(len(y), 2.02), y], axis=1)
    probability = np.full((40, 40), 0.05, np.float32)
    grid = OccupancyGrid(probability, 0.1, (0.0, 0.0))
    cells = np.clip(grid.cells(wall), 0, 39)
    probability[cells[:, 0], cells[:, 1]] = 0.95
    return grid, wall


def way(width_m: float, at_m: float, *, seen: bool):
    grid, wall = gap(width_m, at_m)
    roads = RoomyPlanner(Dijkstra(), grid, grid.free(), radius_m=RADIUS_M, settings=MissionSettings(), who="dijkstra")
    path = roads.plan(np.array([0.8, 2.0]), np.array([3.2, 2.0]), obstacles=np.zeros(grid.shape, bool),
                      things_m=np.zeros((0, 2)), squeeze=True, seen_m=wall if seen else None)
    return path, wall, roads


@pytest.mark.parametrize("at_m", [1.7, 1.72, 1.735])
def test_a_gap_12_cm_wider_than_the_robot_is_passed_in_its_middle_wherever_it_lies_on_the_grid(at_m):
    width_m = 2 * RADIUS_M + 0.12
    path, wall, roads = way(width_m, at_m, seen=True)
    assert path.found and roads.side_m <= TIGHT_M and length_m(path) < 3.0
    stations = np.concatenate([a + np.linspace(0, 1, 50)[:, None] * (b - a)
                               for a, b in zip(path.points_m[:-1], path.points_m[1:], strict=True)])
    gaps = np.linalg.norm(stations[:, None] - wall[None], axis=2)
    assert gaps.min() > RADIUS_M + 0.02
    assert not way(width_m, at_m, seen=False)[0].found, "the map's cells alone close it"


@pytest.mark.parametrize("at_m", [1.7, 1.71, 1.72, 1.73, 1.74, 1.75])
def test_a_gap_9_cm_wider_than_the_robot_is_found_wherever_it_lies_on_the_grid(at_m):
    """A centimetre more than the guard keeps from its sides: cells of 3.3 cm, as they once were, missed half of these."""
    assert way(2 * (RADIUS_M + TIGHT_M) + 0.01, at_m, seen=True)[0].found


def test_a_gap_narrower_than_the_robot_stays_closed():
    assert not way(2 * RADIUS_M + 0.04, 1.73, seen=True)[0].found


def test_there_is_no_way_round_the_outside_of_the_map():
    """The wall ends 30 cm before the border of the map: a robot of 44 cm would lean out by half."""
    grid, wall = gap(0.3, 3.7)
    grid.probability[38:, 20], wall = 0.05, wall[wall[:, 1] < 3.71]
    roads = RoomyPlanner(Dijkstra(), grid, grid.free(), radius_m=RADIUS_M, settings=MissionSettings(), who="dijkstra")
    assert not roads.plan(np.array([0.8, 3.5]), np.array([3.2, 3.5]), obstacles=np.zeros(grid.shape, bool),
                          things_m=np.zeros((0, 2)), squeeze=True, seen_m=wall).found


def test_a_wide_way_is_planned_as_ever_whatever_was_seen():
    path, _, roads = way(1.5, 1.2, seen=True)
    assert np.array_equal(path.points_m, way(1.5, 1.2, seen=False)[0].points_m)
    assert roads.side_m == MissionSettings().margin_m
