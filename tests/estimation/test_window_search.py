"""Wide windows: bounds of blocks of blocks leave nothing out, and what moves leaves a scan."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.estimation.scans.point_map import MOST_MOVING, Cloud, without_passed
from rhs.estimation.scans.window_kernels import BLOCK, best_of, bounded, bounded_again, bounds_of, stamped
from rhs.estimation.scans.window_search import WindowSearch

CELL_M, SIGMA_M = 0.1, 0.2


def walls(rng: np.random.Generator, n: int = 14) -> np.ndarray:
    """Points every 10 cm along n walls of 2 m, here and there in 24 x 24 m."""
    along = np.arange(0.0, 2.0, 0.1)[:, None]
    ends, angles = rng.uniform(-12.0, 12.0, (n, 2)), rng.uniform(-np.pi, np.pi, n)
    return np.concatenate([end + along * [[np.cos(angle), np.sin(angle)]] for end, angle in zip(ends, angles, strict=True)])


@pytest.mark.parametrize("seed", range(6))
def test_a_wide_window_finds_what_trying_every_shift_finds(seed):
    """One shift after the other, without any bound, comes to the same place and score."""
    rng = np.random.default_rng(seed)
    points = walls(rng)
    shift, yaw = rng.uniform(-3.0, 3.0, 2), 0.1
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    seen = np.ascontiguousarray(((points - shift) @ turn)[rng.random(len(points)) < 0.5])
    search = WindowSearch(points, cell_m=CELL_M, sigma_m=SIGMA_M)
    found = search.best(seen, np.zeros(3), window_m=4.0, window_rad=0.1, step_rad=0.1, least=0.3)
    blocks = int(np.ceil(4.0 / (CELL_M * BLOCK)))
    assert blocks > BLOCK and found is not None  # wide enough for blocks of blocks
    side = np.arange(-blocks, blocks + 1) * BLOCK
    tries = np.array([(k, dx, dy, 1.0) for k in range(3) for dy in side for dx in side], float)
    turns = np.column_stack([np.cos([-0.1, 0.0, 0.1]), np.sin([-0.1, 0.0, 0.1])])
    each = best_of(search._field, np.ascontiguousarray(seen / CELL_M), -search._corner / CELL_M, turns, tries, 0.3, 0.94)
    top = each[each[:, 3].argmax()]
    assert found.score == pytest.approx(top[3], abs=1e-6)
    assert found.pose[:2] == pytest.approx(top[:2] * CELL_M, abs=CELL_M) and found.pose[2] == pytest.approx(0.1)
    assert found.pose[:2] == pytest.approx(shift, abs=2 * CELL_M)


def test_the_bound_of_a_block_of_blocks_is_never_below_a_score_in_it():
    """With nothing left out (least 0) and with a threshold: what the threshold leaves out scores less than it."""
    rng = np.random.default_rng(7)
    points = walls(rng)
    field = stamped(points, -14.0, -14.0, 280, 280, CELL_M, SIGMA_M)
    coarse = bounded(field)
    both, cells = (coarse, bounded_again(coarse)), np.ascontiguousarray(points[::3] / CELL_M)
    centre, yaws = np.full(2, 140.0), np.array([0.0, 0.3])
    _, every = bounds_of(both, cells, centre, yaws, 9, 0.0)
    _, promising = bounds_of(both, cells, centre, yaws, 9, 0.4)
    assert (promising == 0.0).any() and every[promising == 0.0].max() < 0.4
    assert np.array_equal(promising[promising > 0.0], every[promising > 0.0])


def scanner(ranges: np.ndarray, points: list) -> Cloud:
    return Cloud(np.array(points, float), np.tile([0.0, 1.0], (len(points), 1)), ranges,
                 np.linspace(-np.pi / 2, np.pi / 2, len(ranges)), np.zeros(3))


def test_who_stands_where_other_beams_saw_nothing_leaves_the_scan_and_walls_stay():
    """Beams of 5 m all round: of points at 2 m, 4.95 m and 7 m only the first stands where they passed."""
    other = scanner(np.full(181, 5.0), [])
    cloud = scanner(np.full(181, 5.0), [[2.0, 0.0], [4.95, 0.0], [7.0, 0.0]])
    left = without_passed(cloud, np.zeros(3), [(other, np.zeros(3))], np.array([0.2, 0.05, 0.01]))
    assert left.points.tolist() == [[4.95, 0.0], [7.0, 0.0]] and len(left.normals) == 2


def test_a_beam_passes_nobody_by_that_a_wrong_pose_would_put_beside_it():
    """One beam of 181 passes; its neighbours end at 2 m. Poses wrong by 10 cm may have taken it for them."""
    ranges = np.full(181, 2.0)
    ranges[90] = 5.0
    cloud = scanner(np.full(181, 5.0), [[2.0, 0.0], [1.0, 1.0], [1.0, -1.0]])
    kept = without_passed(cloud, np.zeros(3), [(scanner(ranges, []), np.zeros(3))], np.array([0.2, 0.1, 0.0]))
    assert [2.0, 0.0] in kept.points.tolist()


def test_where_most_of_a_scan_seems_to_move_its_pose_is_wrong_and_it_stays():
    points = [[1.0 + 0.1 * k, 0.0] for k in range(10)]
    cloud, other = scanner(np.full(181, 5.0), points), scanner(np.full(181, 5.0), [])
    assert MOST_MOVING < 1.0
    assert without_passed(cloud, np.zeros(3), [(other, np.zeros(3))], np.array([0.2, 0.05, 0.01])) is cloud
