"""Triangulation and linearisation of the corridor filter: exactness without noise, derivatives against differences."""

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov
from rhs.estimation.filters.kalman import numeric_jacobian
from rhs_odometry.corridor import fit
from rhs_odometry.corridor.state import BodyMotion, CorridorState, Plane
from rhs_odometry.corridor.update import free_rows, plane_rows

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.2, forward_m=0.1)
SIGMA = 1.0 / CAMERA.fx


def window(views: int = 6) -> CorridorState:
    """A state driven forward on a slight arc, with tilts, so that no derivative is zero by symmetry."""
    state = CorridorState(np.array([0.5, 0, 1, 2.0]), np.full(4, 0.1), np.array([0, 0, 0.05, 0.01, -0.02]), np.full(5, 0.02))
    move = BodyMotion(np.array([0.15, 0.01, 0.04]), np.zeros((3, 4)), 1e-4 * np.eye(3), np.zeros(4))
    for i in range(views - 1):
        state.append_clone(move, 0.01)
        state.clones[-1, 3:] = 0.01 * np.sin(i), 0.02 * np.cos(i)
    return state


def look(state: CorridorState, points: np.ndarray):
    """Exact rays (T, N, 2) of points in all poses of the window, all seen."""
    cameras = fit.cameras_of(state.clones, CAMERA.body_from_camera)
    local = np.einsum("nji,tnj->tni", cameras.rotation, points[:, None] - cameras.centre[None])
    assert (local[..., 2] > 0.2).all()
    return cameras, local[..., :2] / local[..., 2:], np.ones(local.shape[:2], bool)


POINTS = np.array([[3.0, 1.0, 1.5], [4.0, -1.0, 0.4], [6.0, 1.0, 0.9], [2.5, 0.3, 0.0]])


def test_free_fit_without_noise_finds_the_points():
    cameras, rays, seen = look(window(), POINTS)
    found = fit.fit_free(cameras, rays, seen, SIGMA)
    assert found.good.all()
    assert found.points() == pytest.approx(POINTS, abs=1e-5)
    assert found.cost == pytest.approx(np.zeros(4), abs=1e-9)


def test_point_seen_from_one_place_has_no_depth():
    """Two equal poses give no parallax: the spread of the inverse distance says so."""
    state = window(2)
    state.clones[1] = state.clones[0]
    cameras, rays, seen = look(state, POINTS[:1])
    assert fit.fit_free(cameras, rays, seen, SIGMA).rho_sigma[0] > 100.0


def test_plane_fit_equals_free_fit_for_points_of_that_plane():
    cameras, rays, seen = look(window(), POINTS)
    left = Plane(0 + 1, 1.0, 0.0, 0.0, 0.0, 8.0)
    right = Plane(1, -1.0 + 0.02 * 4.0, 0.02, 0.0, 0.0, 8.0)  # y = d - alpha x passes through (4, -1)
    floor = Plane(2, 0.0, 0.0, 0.0, 0.0, 8.0)
    found = fit.fit_on_planes(cameras, rays, seen, SIGMA, [left, right, left, floor])
    assert found.points() == pytest.approx(POINTS, abs=1e-5)


def test_tracks_seen_in_some_views_only():
    cameras, rays, seen = look(window(), POINTS)
    seen = seen.copy()
    seen[:, 4:], seen[:, 0] = False, False
    rays = np.where(seen[..., None], rays, 7.0)
    assert fit.fit_free(cameras, rays, seen, SIGMA).points() == pytest.approx(POINTS, abs=1e-4)


def test_derivatives_by_the_poses_agree_with_differences():
    state = window()
    cameras, rays, seen = look(state, POINTS)
    found = fit.fit_free(cameras, rays, seen, SIGMA)
    from rhs_odometry.corridor.update import _by_clones, _linearised

    camera, _, own = _linearised(cameras, found, seen)
    analytic = _by_clones(cameras, found, camera)

    def predicted(pose, n):
        clones = state.clones.copy()
        clones[n] = pose
        _, p = fit.seen_from(fit.cameras_of(clones, CAMERA.body_from_camera), found.angles, found.rho, found.anchor)
        return (p[:, n, :2] / p[:, n, 2:]).ravel()

    for n in range(state.window):
        numeric = numeric_jacobian(lambda pose, n=n: predicted(pose, n), state.clones[n])
        assert analytic[:, n].reshape(-1, 5) == pytest.approx(numeric, abs=1e-5)

    def of_point(x):
        _, p = fit.seen_from(cameras, found.angles + x[None, :2], found.rho + x[2], found.anchor)
        return (p[..., :2] / p[..., 2:]).ravel()

    assert own.reshape(-1, 3) == pytest.approx(numeric_jacobian(of_point, np.zeros(3)), abs=1e-5)


def test_derivatives_of_the_distance_to_a_plane_agree_with_differences():
    cameras, rays, seen = look(window(), POINTS)
    angles, anchor = fit.start_angles(cameras, rays, seen)

    def rho(x):
        planes = [Plane(axis, d + x[0], 0.01 * (axis < 2) + x[1] * (axis < 2), 1.5, 0, 9) for axis, d in
                  ((1, 1.0), (1, -1.0), (0, 7.0), (2, 0.0))]
        return fit.plane_rho(planes, angles + x[None, 2:], anchor)

    numeric = numeric_jacobian(lambda x: rho(x)[0], np.zeros(4))
    _, by_angles, by_plane = rho(np.zeros(4))
    assert np.hstack([by_plane, by_angles]) == pytest.approx(numeric, abs=1e-5)


def test_rows_do_not_depend_on_where_the_point_was_thought_to_be():
    """What is left after projecting the point away is orthogonal to every move of the point."""
    state = window()
    cameras, rays, seen = look(state, POINTS)
    found = fit.fit_free(cameras, rays, seen, SIGMA)
    rows = free_rows(state, cameras, rays, seen, found, SIGMA)
    own = fit.by_point(cameras, found.angles, found.anchor,
                       fit.by_camera_point(fit.seen_from(cameras, found.angles, found.rho, found.anchor)[1]))
    moved = np.einsum("tri,trd->tid", own.reshape(len(POINTS), -1, 3), rows.jacobian)
    assert np.abs(moved).max() < 1e-6 * np.abs(rows.jacobian).max()
    assert (rows.dof == 2 * 6 - 3).all()


def test_gate_is_the_chi_square_of_the_null_space():
    """The projected rows give the same normalised innovation as an explicit basis of the null space."""
    state = window()
    cameras, rays, seen = look(state, POINTS)
    noisy = rays + SIGMA * np.random.default_rng(0).standard_normal(rays.shape)
    found = fit.fit_free(cameras, noisy, seen, SIGMA)
    rows = free_rows(state, cameras, noisy, seen, found, SIGMA)
    own = fit.by_point(cameras, found.angles, found.anchor,
                       fit.by_camera_point(fit.seen_from(cameras, found.angles, found.rho, found.anchor)[1]))
    basis = np.linalg.svd(own[0].reshape(-1, 3))[0][:, 3:]
    h, r = basis.T @ rows.jacobian[0], basis.T @ rows.residual[0]
    expected = r @ np.linalg.solve(h @ state.covariance @ h.T + np.eye(9), r)
    assert rows.gamma[0] == pytest.approx(expected, rel=1e-6)


def test_a_point_on_a_wall_says_more_than_a_free_point():
    state = window()
    state.add_plane(Plane(1, 1.0, 0.0, 0.0, 0.0, 8.0), (0.5, 0.003))
    cameras, rays, seen = look(state, POINTS[:1])
    flat = fit.fit_on_planes(cameras, rays, seen, SIGMA, state.planes)
    on_wall = plane_rows(state, cameras, rays, seen, (flat, np.array([0]), SIGMA))
    free = free_rows(state, cameras, rays, seen, fit.fit_free(cameras, rays, seen, SIGMA), SIGMA)
    assert on_wall.dof[0] == free.dof[0] + 1
    assert np.abs(on_wall.jacobian[0][:, state.plane_slice(0)]).max() > 0
