"""The corridor filter's state: growing, shrinking and rescaling change what they should and nothing else."""

import numpy as np
import pytest

from rhs_odometry.corridor.motion import ConstantVelocity, GivenMotion, MotionNoise
from rhs_odometry.corridor.state import BodyMotion, CorridorState, Plane
from rhs_odometry.corridor.walls import WallFinder, WallRules, merge_one, with_hits
from rhs_odometry.corridor.width import find_pair, use_pair
from rhs_odometry.tracks.track_frames import TrackFrame


def start() -> CorridorState:
    return CorridorState(np.array([0.5, 0, 1, 2.0]), np.array([0.1, 0.1, 0.05, 0.3]), np.array([1.0, 2, 0.3, 0, 0]),
                         np.full(5, 0.02))


MOVE = BodyMotion(np.array([0.2, 0.0, 0.1]), np.zeros((3, 4)), np.diag([0.01, 0.01, 0.02]) ** 2, np.zeros(4))


def positive(covariance: np.ndarray) -> bool:
    return bool(np.array_equal(covariance, covariance.T) and np.linalg.eigvalsh(covariance).min() > 0)


def test_a_new_pose_leaves_the_old_ones_as_they_were():
    state = start()
    state.append_clone(MOVE, 0.01)
    before, mean = state.covariance.copy(), state.clones.copy()
    state.append_clone(MOVE, 0.01)
    assert np.allclose(state.covariance[: len(before), : len(before)], before, atol=0)
    assert np.array_equal(state.clones[:2], mean)
    assert positive(state.covariance)


def test_moving_follows_the_half_turned_heading():
    state = start()
    state.append_clone(MOVE, 0.01)
    assert state.clones[1, :3] == pytest.approx([1 + 0.2 * np.cos(0.35), 2 + 0.2 * np.sin(0.35), 0.4])


def test_dropping_a_pose_only_forgets_it():
    state = start()
    for _ in range(3):
        state.append_clone(MOVE, 0.01)
    rest = state.covariance[state.clone_slice(1).start :, state.clone_slice(1).start :].copy()
    dropped = state.drop_oldest_clone()
    assert dropped[:2] == pytest.approx([1.0, 2.0])
    assert np.array_equal(state.covariance[state.first_clone :, state.first_clone :], rest)


def test_a_new_wall_is_independent_at_first():
    state = start()
    state.append_clone(MOVE, 0.01)
    poses = state.covariance[4:, 4:].copy()
    state.add_plane(Plane(0, 3.0, 0.0, 0.0, 0.0, 4.0), (0.5, 0.003))
    block = state.plane_slice(0)
    assert state.covariance[block, block] == pytest.approx(np.diag([0.25, 9e-6]))
    assert np.array_equal(state.covariance[state.first_clone :, state.first_clone :], poses)
    state.remove_plane(0)
    assert np.array_equal(state.covariance[4:, 4:], poses)


def test_rescaling_is_a_similarity_about_the_start():
    state = start()
    state.append_clone(MOVE, 0.01)
    state.add_plane(Plane(0, 3.0, 0.01, 2.5, 2.0, 4.0, 5), (0.5, 0.003))
    state.add_plane(Plane(2, 0.0, 0.0, 0.0, 0.0, 4.0), (0.1, 1e-4))
    before, sigma = state.clones.copy(), np.sqrt(np.diag(state.covariance))
    state.rescale(2.0, np.array([1.0, 2.0, 1.2]))
    assert state.clones[1, :2] - [1, 2] == pytest.approx(2 * (before[1, :2] - [1, 2]))
    assert state.clones[:, 2] == pytest.approx(before[:, 2])
    wall, floor = state.planes
    assert (wall.offset_m, wall.low_m, wall.high_m, wall.pivot_m) == pytest.approx((5.0, 2.0, 6.0, 3.0))
    assert wall.angle_rad == 0.01
    assert floor.offset_m == pytest.approx(-1.2)  # twice as far below the camera at 1.2 m
    ratio = np.sqrt(np.diag(state.covariance)) / sigma
    expected = [2, 1, 2, 1, 2, 1, 2, 1] + 2 * [2, 2, 1, 1, 1]
    assert ratio == pytest.approx(expected)


def test_command_wheel_and_inertia_expect_what_they_say():
    frame = TrackFrame(0.5, np.zeros(0, int), np.zeros((0, 2)), np.array([0.2, 0.1, 0.4]), np.array([0.3, 0.01, 0.2]))
    base = np.array([0.5, 0.2, 1.1, 2.0])
    noise = MotionNoise()
    assert GivenMotion(noise, wheels=False).expect(frame, base, 0.4).mean == pytest.approx([0.22, 0.0, 0.1])
    assert GivenMotion(noise, wheels=True).expect(frame, base, 0.4).mean == pytest.approx([0.33, 0.01, 0.2])
    assert ConstantVelocity(noise).expect(frame, base, 0.4).mean == pytest.approx([0.2, 0.0, 0.08])
    silent = TrackFrame(0.5, np.zeros(0, int), np.zeros((0, 2)))
    assert GivenMotion(noise, wheels=True).expect(silent, base, 0.4).noise[0, 0] > 0.01


def wall_points(rng: np.random.Generator, n: int = 40) -> np.ndarray:
    return np.column_stack([rng.uniform(2, 5, n), np.full(n, 1.0) + 0.02 * rng.standard_normal(n), rng.uniform(0, 2.4, n)])


def test_a_wall_of_points_is_found():
    finder = WallFinder(WallRules(), camera_height_m=1.2)
    finder.remember(wall_points(np.random.default_rng(0)), 3)
    plane = finder.find([])
    assert plane is not None and plane.axis == 1
    assert plane.offset_m == pytest.approx(1.0, abs=0.03)
    assert finder.find([plane]) is None  # its points are used up


def test_two_small_paintings_facing_each_other_are_not_a_wall():
    """Their points line up across the corridor, but fill two short stretches only."""
    rng = np.random.default_rng(1)
    paintings = np.column_stack([3 + 0.06 * rng.uniform(-1, 1, 40), np.repeat([1.0, -1.0], 20), rng.uniform(1, 1.6, 40)])
    finder = WallFinder(WallRules(), camera_height_m=1.2)
    finder.remember(paintings, 3)
    assert finder.find([]) is None


def test_a_skirting_board_is_not_a_wall():
    rng = np.random.default_rng(2)
    row = np.column_stack([rng.uniform(2, 6, 60), np.full(60, 1.0), np.full(60, 0.1)])
    finder = WallFinder(WallRules(), camera_height_m=1.2)
    finder.remember(row, 3)
    assert finder.find([]) is None


def two_walls(gap: float) -> CorridorState:
    state = start()
    for offset, hits in ((3.0, 30), (3.0 + gap, 10)):
        plane = with_hits(Plane(0, offset, 0.0, 2.0, 0.0, 4.0), np.linspace(0, 4, hits))
        state.add_plane(plane, (0.1, 0.003))
    return state


def test_merging_equal_walls_keeps_them_where_they_are():
    state = two_walls(0.0)
    assert merge_one(state, WallRules())
    (wall,) = state.planes
    assert wall.offset_m == pytest.approx(3.0, abs=1e-12)
    assert wall.hits == 40
    assert positive(state.covariance)


def test_merging_near_walls_meets_between_them_and_far_walls_stay_two():
    state = two_walls(0.1)
    assert merge_one(state, WallRules())
    assert state.planes[0].offset_m == pytest.approx(3.05, abs=0.01)
    assert not merge_one(two_walls(0.6), WallRules())


def test_a_wall_reaches_as_far_as_three_hits():
    plane = with_hits(Plane(0, 0.0, 0.0, 0.0, 1.0, 2.0), np.array([1.1, 1.2, 1.3, 1.9, 1.8, 1.7, 7.0]))
    assert (plane.low_m, plane.high_m) == pytest.approx((1.0, 2.0))


def test_the_width_between_a_pair_of_walls_is_used_once():
    state = start()
    for offset in (1.2, 2.9):
        plane = with_hits(Plane(1, offset, 0.0, 1.0, 0.0, 4.0), np.linspace(0, 4, 30))
        state.add_plane(plane, (0.5, 0.003))
    pair = find_pair(state)
    assert pair is not None and pair.gap_m == pytest.approx(1.7)
    use_pair(state, pair)
    gap = state.planes[1].at(1.0) - state.planes[0].at(1.0)
    assert gap == pytest.approx(state.base[3], abs=0.01)
    assert find_pair(state) is None
    assert positive(state.covariance)


