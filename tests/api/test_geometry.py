"""Facts of rigid motion and of the pinhole camera."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rhs.api import geometry as g

RNG = np.random.default_rng(7)


def random_pose(rng):
    return g.exp_se3(rng.normal(size=6))


def test_exponential_and_logarithm_are_inverse():
    for _ in range(20):
        xi = RNG.normal(size=6) * np.array([3, 3, 3, 0.9, 0.9, 0.9])
        if np.linalg.norm(xi[3:]) < 3.0:
            assert np.allclose(g.log_se3(g.exp_se3(xi)), xi, atol=1e-9)


def test_inverse_undoes_a_pose_alone_and_in_a_stack():
    poses = np.stack([random_pose(RNG) for _ in range(5)])
    assert np.allclose(g.inverse(poses) @ poses, np.eye(4))
    assert np.allclose(g.inverse(poses[0]) @ poses[0], np.eye(4))


def test_adjoint_moves_a_twist_through_a_pose():
    pose, xi = random_pose(RNG), 0.3 * RNG.normal(size=6)
    assert np.allclose(pose @ g.exp_se3(xi), g.exp_se3(g.adjoint(pose) @ xi) @ pose)


def test_covariance_of_a_composition_agrees_with_sampling():
    a, b = random_pose(RNG), random_pose(RNG)
    la, lb = 0.01 * RNG.normal(size=(6, 6)), 0.01 * RNG.normal(size=(6, 6))
    covariance = g.compose_covariance(la @ la.T, b, lb @ lb.T)
    rng = np.random.default_rng(3)
    inverse = g.inverse(a @ b)
    deltas = np.stack([
        g.log_se3(inverse @ (a @ g.exp_se3(la @ rng.normal(size=6)) @ b @ g.exp_se3(lb @ rng.normal(size=6))))
        for _ in range(4000)])
    sampled = np.cov(deltas.T)
    assert np.linalg.norm(sampled - covariance) < 0.1 * np.linalg.norm(covariance)


def test_planar_shadow_of_a_standing_body():
    assert np.allclose(g.planar(g.se2(1.0, -2.0, 0.5)), [1.0, -2.0, 0.5])


@pytest.mark.parametrize("with_scale", [False, True])
def test_alignment_recovers_a_known_motion(with_scale):
    pose, points = random_pose(RNG), RNG.normal(size=(30, 3))
    scale = 2.5 if with_scale else 1.0
    found, found_scale = g.align(points, scale * points @ pose[:3, :3].T + pose[:3, 3], with_scale=with_scale)
    assert np.allclose(found, pose) and found_scale == pytest.approx(scale)


def test_alignment_never_answers_with_a_mirror():
    points = RNG.normal(size=(10, 3))
    found, _ = g.align(points, points * np.array([1.0, 1.0, -1.0]))
    assert np.linalg.det(found[:3, :3]) == pytest.approx(1.0)


def test_weights_silence_an_outlier():
    points = RNG.normal(size=(10, 3))
    moved = points + np.array([1.0, 0.0, 0.0])
    moved[0] += 5.0
    weights = np.ones(10)
    weights[0] = 0.0
    found, _ = g.align(points, moved, weights)
    assert np.allclose(found, g.se3(np.eye(3), np.array([1.0, 0.0, 0.0])))


# freiburg1's lens, and a rational model like that of wide depth cameras
RATIONAL = (0.52, -2.7, 0.0006, -0.0002, 1.56, 0.4, -2.51, 1.48)


@pytest.mark.parametrize("distortion", [(), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633), RATIONAL])
def test_projection_and_back_projection_are_inverse(distortion):
    camera = g.Camera(640, 480, 517.3, 516.5, 318.6, 255.3, skew=1.5, distortion=distortion)
    points = np.stack([RNG.uniform(-0.5, 0.5, 50), RNG.uniform(-0.4, 0.4, 50), np.ones(50)], axis=1)
    points *= RNG.uniform(1.0, 4.0, 50)[:, None]
    pixels = camera.project(points)
    assert np.allclose(camera.points(pixels, points[:, 2]), points, atol=1e-5)


def test_a_point_straight_ahead_falls_on_the_principal_point():
    camera = g.camera_from_fov(320, 240, 57.0, height_m=1.2)
    ahead_of_body = np.array([[3.0, 0.0, 1.2]])
    in_camera = g.transform(g.inverse(camera.body_from_camera), ahead_of_body)
    assert np.allclose(in_camera, [[0.0, 0.0, 3.0]])
    assert np.allclose(camera.project(in_camera), [[159.5, 119.5]])


def test_left_of_the_body_is_left_in_the_image():
    camera = g.camera_from_fov(320, 240, 57.0, height_m=1.2)
    left = g.transform(g.inverse(camera.body_from_camera), np.array([[3.0, 1.0, 1.2]]))
    assert camera.project(left)[0, 0] < 159.5


def test_a_point_behind_the_camera_has_no_pixel():
    camera = g.camera_from_fov(320, 240, 57.0, height_m=1.2)
    assert np.all(np.isnan(camera.project(np.array([[0.0, 0.0, -1.0]]))))


@pytest.mark.parametrize("quaternion", [(0, 0, 0, 0), (np.nan, 0, 0, 1)])
def test_a_quaternion_without_direction_is_refused(quaternion):
    with pytest.raises(ValueError, match="no direction"):
        g.rotation_of_quaternion(np.array(quaternion, float))


def test_quaternions_and_rotation_vectors_are_scipys():
    rng = np.random.default_rng(0)
    turns = [g.exp_so3(v * 10.0 ** rng.uniform(-9, 0.5)) for v in rng.standard_normal((400, 3))]
    turns += [np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])]
    turns += [turn.astype(np.float32).astype(float) for turn in turns[:50]]  # rotations to seven digits
    for turn in turns:
        known = Rotation.from_matrix(turn)
        assert np.abs(g.quaternion_xyzw(turn) - known.as_quat(canonical=True)).max() < 1e-15
        assert np.abs(g.log_so3(turn) - known.as_rotvec()).max() < 1e-14


def test_quaternion_round_trip_with_w_last():
    rotation = g.rotation_z(np.pi / 2)
    assert np.allclose(g.quaternion_xyzw(rotation), [0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert np.allclose(g.rotation_of_quaternion(g.quaternion_xyzw(rotation)), rotation)


@pytest.mark.parametrize("distortion", [(0.2, -0.9, -0.005, 0.0026), (0.2624, -0.9531, -0.0054, 0.0026, 1.1633), RATIONAL])
def test_distortion_is_opencvs(distortion):
    import cv2

    camera = g.Camera(640, 480, 517.3, 516.5, 318.6, 255.3, distortion=distortion)
    points = np.random.default_rng(0).uniform([-1, -0.8, 2], [1, 0.8, 4], (50, 3))
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, np.array(distortion))
    np.testing.assert_allclose(camera.project(points), expected[:, 0], atol=1e-9)
