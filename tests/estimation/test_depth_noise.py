"""How noisy depth is, read off single pictures; and what averaging makes of it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from rhs.estimation.views.depth_noise import DepthLevel, mended, noise_level
from rhs.estimation.views.rigid import KINECT
from rhs.estimation.views.settings import DepthNoiseSettings


def corridor(width: int = 320) -> np.ndarray:
    """(H, W) depth of a corridor 2 m wide and 2.6 m high that ends at 5 m, with a box in it whose rim is an edge."""
    height, focal = 3 * width // 4, 0.92 * width
    u, v = np.meshgrid((np.arange(width) - 0.5 * width) / focal, (np.arange(height) - 0.5 * height) / focal)
    with np.errstate(divide="ignore"):
        z = np.minimum.reduce([np.full_like(u, 5.0), 1.0 / np.abs(u), 1.0 / np.maximum(v, 0.0), 1.6 / np.maximum(-v, 0.0)])
    z[height // 2 : height * 3 // 4, width // 2 : width * 5 // 8] = 2.0
    return z


def noisy(z: np.ndarray, times: float, seed: int = 0, shared_px: float = 0.0) -> np.ndarray:
    """As a sensor hands it on: noise of so many times a Kinect's, 0.4 to 8 m. shared_px: over which they err together."""
    noise = np.random.default_rng(seed).standard_normal(z.shape)
    if shared_px > 0.0:
        noise = gaussian_filter(noise, shared_px)
        noise /= noise.std()
    depth = z + times * KINECT.depth(z) * noise
    return np.where((depth >= 0.4) & (depth <= 8.0), depth, np.nan).astype(np.float32)


@pytest.mark.parametrize("width", [160, 320, 640])
@pytest.mark.parametrize("times", [1.0, 2.0, 4.0, 16.0, 64.0])
def test_planted_noise_is_estimated_within_a_fifth(times, width):
    assert noise_level(noisy(corridor(width), times)) == pytest.approx(times, rel=0.2)


def test_noise_that_neighbours_share_is_seen_too():
    assert noise_level(noisy(corridor(), 16.0, shared_px=1.5)) == pytest.approx(16.0, rel=0.2)


def test_a_picture_without_depth_says_nothing():
    assert np.isnan(noise_level(np.full((240, 320), np.nan, np.float32)))
    level = DepthLevel()
    assert level.look(np.full((240, 320), np.nan, np.float32)) == 1.0


def test_the_level_follows_a_sensor_that_grows_worse_within_its_memory():
    level = DepthLevel(DepthNoiseSettings(memory=5))
    for seed in range(10):
        level.look(noisy(corridor(160), 1.0, seed))
    assert level.level == pytest.approx(1.0, rel=0.2)
    for seed in range(25):
        level.look(noisy(corridor(160), 8.0, seed))
    assert level.level == pytest.approx(8.0, rel=0.2)


def errors(depth: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Of the known depths, times a Kinect's deviation."""
    off = (depth - z) / KINECT.depth(z)
    return off[np.isfinite(off)]


@pytest.mark.parametrize("times", [2.0, 4.0, 16.0])
def test_averaging_brings_noise_back_to_a_kinects(times):
    z = corridor()
    off = errors(mended(noisy(z, times), times, max_range_m=8.0)[0], z)
    assert len(off) > 0.75 * z.size
    assert 1.4826 * np.median(np.abs(off)) < 1.3 and abs(np.median(off)) < 0.4


@pytest.mark.parametrize("times, shared_px", [(64.0, 0.0), (16.0, 1.5)])
def test_what_averaging_cannot_take_away_is_measured(times, shared_px):
    """Beyond the widest window, and where readings err together: within a factor of two of what is truly left."""
    z = corridor()
    depth, side_px = mended(noisy(z, times, shared_px=shared_px), times, max_range_m=8.0)
    truly = 1.4826 * np.median(np.abs(errors(depth, z)))
    assert truly > 3.0 and 0.5 < noise_level(depth, lag_px=side_px) / truly < 2.0
    if times == 64.0:
        assert np.isnan(depth[z > 4.5]).mean() > 0.98  # a reading there errs by 2 m; beyond 8 m they are cut off


def test_an_edge_is_not_averaged_over():
    """A step from 2 m to 3 m, noise of 4 Kinects: no depth between the two sides is invented."""
    z = np.full((120, 160), 3.0)
    z[:, :80] = 2.0
    depth, _ = mended(noisy(z, 4.0), 4.0, max_range_m=8.0)
    known = depth[np.isfinite(depth)]
    assert not ((known > 2.25) & (known < 2.75)).any()
    assert np.isfinite(depth[:, :76]).mean() > 0.99 and np.isfinite(depth[:, 84:]).mean() > 0.99
