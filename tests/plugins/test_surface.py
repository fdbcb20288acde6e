"""Surfaces read from depth images: planes exactly, edges and the unknown not at all."""

from __future__ import annotations

import numpy as np

from rhs_odometry.keyframe.surface import surfaces

V, U = np.mgrid[0:120, 0:160].astype(float)


def test_a_plane_is_read_exactly_between_the_pixels():
    inverse = 0.3 + 0.002 * U - 0.001 * V
    pixels = np.array([[40.3, 50.8], [100.0, 20.5], [8.2, 110.9]])
    rho, slopes = surfaces((1.0 / inverse).astype(np.float32), pixels)
    np.testing.assert_allclose(rho, 0.3 + 0.002 * pixels[:, 0] - 0.001 * pixels[:, 1], atol=1e-6)
    np.testing.assert_allclose(slopes, [[0.002, -0.001]] * 3, atol=1e-6)


def test_noise_is_averaged_over_the_window():
    """49 readings: a seventh of the noise of one."""
    rng = np.random.default_rng(0)
    depth = (1.0 / (0.5 + 0.01 * rng.standard_normal((120, 160)))).astype(np.float32)
    pixels = rng.uniform([10, 10], [150, 110], (500, 2))
    rho, _ = surfaces(depth, pixels)
    assert 0.8 < rho.std() / (0.01 / 7) < 1.25


def test_unknown_depth_an_edge_and_the_outside_are_nan():
    depth = np.where(U < 80, 1.0, 2.0).astype(np.float32)
    depth[:60] = np.nan
    pixels = np.array([[40.0, 90.0], [80.0, 90.0], [40.0, 20.0], [-5.0, 90.0], [np.nan, 90.0], [40.0, 500.0]])
    rho, slopes = surfaces(depth, pixels)
    assert rho[0] == 1.0
    assert np.isnan(rho[1:]).all() and np.isnan(slopes[1:]).all()


def test_values_that_no_camera_means_are_unknown():
    for value in (0.0, -1.0, np.inf, 1e6):
        rho, _ = surfaces(np.full((120, 160), value, np.float32), np.array([[80.0, 60.0]]))
        assert np.isnan(rho[0])
