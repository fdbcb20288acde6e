"""The floor is the lowest level, whatever the scale: a skirting board is not taken for floor further away."""

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov
from rhs_odometry.corridor.config import FloorRules
from rhs_odometry.corridor.fit import cameras_of, fit_free
from rhs_odometry.corridor.floor_level import FloorLevel
from rhs_odometry.corridor.state import BodyMotion, CorridorState, Plane

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0, forward_m=0.0)
PIXELS = 0.3  # noise


def driven(scale: float) -> CorridorState:
    """Ten views, 0.1 m apart times the scale: what a motion input that is so wrong makes of it."""
    state = CorridorState(np.array([0.0, 0.0, 1.0, 1.0]), np.array([1e-3, 1e-3, 0.1, 1e-3]), np.zeros(5), np.full(5, 1e-3))
    state.add_plane(Plane(2, 0.0, 0.0, 0.0, 0.0, 0.0), (0.004, 1e-4))
    step = BodyMotion(np.array([0.1 * scale, 0.0, 0.0]), np.zeros((3, 4)), 1e-6 * np.eye(3), np.zeros(4))
    for _ in range(9):
        state.append_clone(step, 1e-4)
    return state


def chosen(scale: float, heights: tuple[float, ...], seed: int = 0, views: int = 3) -> np.ndarray:
    """Of the (H,) heights, which share of 12 points each is put on the floor, the motion wrong by `scale`."""
    rng = np.random.default_rng(seed)
    true, believed, level = cameras_of(driven(1.0).clones, CAMERA.body_from_camera), driven(scale), FloorLevel(FloorRules())
    for _ in range(views):
        points = np.array([[rng.uniform(2.6, 4.0), rng.uniform(-0.6, 0.6), z] for z in heights for _ in range(12)])
        local = np.einsum("nji,tnj->tni", true.rotation, points[:, None] - true.centre[None])
        rays = local[..., :2] / local[..., 2:] + rng.normal(0.0, PIXELS / CAMERA.fx, (*local.shape[:2], 2))
        seen = np.ones(rays.shape[:2], bool)
        fit = fit_free(cameras_of(believed.clones, CAMERA.body_from_camera), rays, seen, PIXELS / CAMERA.fx)
        on = level.lies_on(believed, fit)
        level.remember()
    return on.reshape(len(heights), 12).mean(axis=1)


@pytest.mark.parametrize("scale", [0.92, 1.0, 1.08])
def test_of_floor_and_skirting_board_the_floor_is_taken_at_any_scale(scale):
    floor, board = np.mean([chosen(scale, (0.0, 0.1), seed) for seed in range(4)], axis=0)
    assert floor > 0.5 and board < 0.05


@pytest.mark.parametrize("scale", [0.92, 1.0, 1.08])
def test_a_floor_alone_is_taken_at_any_scale(scale):
    assert chosen(scale, (0.0,))[0] >= 0.8


def test_what_stands_higher_is_never_floor():
    assert chosen(1.0, (0.0, 0.5)).tolist() == [1.0, 0.0]
