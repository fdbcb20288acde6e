"""A lens that distorts, on request: bent by the amount Brown's formula says, undone by whoever asks for rays."""

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, camera_from_fov, inverse, se2, transform
from rhs.api.records import Twist
from rhs.worlds.world import load_world
from rhs_sources.lens import Lens, checked_rays
from rhs_sources.simulator_config import Simulator

TUM_FR1 = (0.2624, -0.9531, -0.0054, 0.0026, 1.1633)
WIDE_PINCUSHION = (0.3, 0.0, 0.0, 0.0)
WORLD = load_world("square_small")
EXACT = {"command_bias_percent": 0.0, "command_noise_percent": 0.0, "wobble_m": 0.0, "wobble_deg": 0.0,
         "texture_px_per_m": 60.0, "image_width": 160}


def camera(distortion, width=160, hfov_deg=57.0) -> Camera:
    plain = camera_from_fov(width, width * 3 // 4, hfov_deg, height_m=1.0)
    return Camera(plain.width, plain.height, plain.fx, plain.fy, plain.cx, plain.cy, distortion=distortion)


def grid(camera) -> np.ndarray:
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def source(folder, **settings):
    return Simulator(**{**EXACT, **settings}).build(SourceContext(np.random.default_rng(0), WORLD, folder))


def look_from(source, x, y, yaw):
    source.teleport(se2(x, y, yaw))
    return source.drive(Twist(0.0, 0.0, 0.0))


def test_brown_by_hand():
    """x = 0.3, y = 0.4, so r^2 = 0.25. k1 = -0.2: shrunk by 1 - 0.05. p1 = 0.01: aside by 2 p1 x y = 0.0024, down by
    p1 (r^2 + 2 y^2) = 0.0057."""
    at = np.array([[0.3, 0.4, 1.0]])
    radial = Camera(320, 240, 100.0, 100.0, 0.0, 0.0, distortion=(-0.2, 0.0, 0.0, 0.0))
    assert radial.project(at) == pytest.approx(np.array([[28.5, 38.0]]))
    both = Camera(320, 240, 100.0, 100.0, 0.0, 0.0, distortion=(-0.2, 0.0, 0.01, 0.0))
    assert both.project(at) == pytest.approx(np.array([[28.74, 38.57]]))


@pytest.mark.parametrize(("distortion", "hfov_deg"), [
    (TUM_FR1, 57.0), (WIDE_PINCUSHION, 90.0), ((-0.3, 0.1, 0.001, -0.002), 90.0)])
def test_every_pixel_of_a_picture_leads_back_to_itself(distortion, hfov_deg):
    lens = camera(distortion, hfov_deg=hfov_deg)
    assert np.abs(lens.project(checked_rays(lens, grid(lens), "source")) - grid(lens)).max() < 1e-6


def test_a_straight_line_is_bent_by_the_amount_of_the_formula():
    """A picture black left of the vertical line x = 0.25 of the plane z = 1, at 116.3 px. With k1 = -0.3 a point of the line
    comes to 0.25 (1 - 0.3 (0.0625 + y^2)): in the middle row 0.7 px further in, in the top row, where y = 0.44, 2.8 px."""
    bent = camera((-0.3, 0.0, 0.0, 0.0))
    lens = Lens(bent, "source")
    ideal = lens.ideal
    first = int(round(0.25 * ideal.fx + ideal.cx))  # the first white column: the line runs half a pixel left of it
    x = (first - 0.5 - ideal.cx) / ideal.fx
    image = np.zeros((ideal.height, ideal.width, 3), np.uint8)
    image[:, first:] = 255
    picture, _ = lens.bend(image, np.ones((ideal.height, ideal.width), np.float32))
    inwards = []
    for row in (0, 60, 119):
        crossing = float(np.interp(127.5, picture[row, 80:, 0].astype(float), np.arange(80, 160)))
        y = bent.rays(np.array([[crossing, row]]))[0, 1]
        by_hand = bent.fx * x * (1.0 - 0.3 * (x * x + y * y)) + bent.cx
        assert crossing == pytest.approx(by_hand, abs=0.2)  # sampled once a pixel
        inwards.append(bent.fx * x + bent.cx - crossing)
    assert inwards == pytest.approx([2.8, 0.7, 2.8], abs=0.3)


@pytest.mark.parametrize("distortion", [TUM_FR1, (-0.3, 0.1, 0.001, -0.002), WIDE_PINCUSHION])
def test_depth_follows_the_picture_and_lies_on_the_plan(tmp_path, distortion):
    """Every pixel's depth along its own ray ends on a surface of the plan; no corner of the picture is empty."""
    made = source(tmp_path, distortion=list(distortion))
    try:
        for x, y, yaw in ((2.0, 1.0, 0.0), (1.0, 1.2, 0.6), (1.0, 6.5, 1.2)):
            capture = look_from(made, x, y, yaw)
            assert capture.image.shape == (120, 160, 3) and capture.depth.shape == (120, 160)
            assert np.isfinite(capture.depth).all()
            points = made.camera.points(grid(made.camera), capture.depth.ravel())
            there = transform(made.truth() @ made.camera.body_from_camera, points)
            planes = [there[:, 0] - v for v in (0, 2, 6, 8)] + [there[:, 1] - v for v in (0, 2, 6, 8)]
            off = np.abs([*planes, there[:, 2], there[:, 2] - 2.6]).min(axis=0)
            assert np.quantile(off, 0.98) < 2e-3  # the rest are within a pixel of an edge
    finally:
        made.close()


def test_the_bent_view_shows_what_the_straight_one_shows_elsewhere(tmp_path):
    """A pixel of the bent view and the pixel of the straight view on the same ray show the same grey."""
    bent, straight = source(tmp_path / "a", distortion=list(TUM_FR1)), source(tmp_path / "b")
    try:
        one, other = look_from(bent, 1.2, 3.0, 1.3).image, look_from(straight, 1.2, 3.0, 1.3).image
        where = np.rint(straight.camera.project(bent.camera.rays(grid(bent.camera)))).astype(int)
        inside = ((where >= 0) & (where < [160, 120])).all(axis=1)
        moved = np.abs(where - grid(bent.camera)).max(axis=1)[inside]
        assert moved.max() >= 2
        shown = one.reshape(-1, 3)[inside].mean(axis=1)
        same = other[where[inside, 1], where[inside, 0]].mean(axis=1)
        unmoved = other.reshape(-1, 3)[inside].mean(axis=1)
        assert np.abs(shown - same).mean() < 0.5 * np.abs(shown - unmoved).mean()
    finally:
        bent.close()
        straight.close()


def test_depth_is_not_mixed_across_an_edge():
    """A near board before a far wall: between 1 m and 5 m there is nothing, whatever the lens."""
    lens = Lens(camera((-0.3, 0.1, 0.0, 0.0)), "source")
    depth = np.full((lens.ideal.height, lens.ideal.width), 5.0, np.float32)
    depth[:, 40:90] = 1.0
    depth[:20] = np.nan
    _, bent = lens.bend(np.zeros((*depth.shape, 3), np.uint8), depth)
    known = bent[np.isfinite(bent)]
    assert np.all((np.abs(known - 1.0) < 1e-5) | (np.abs(known - 5.0) < 1e-5))
    assert 0.0 < np.isnan(bent).mean() < 0.2


def test_a_corner_of_the_world_appears_where_the_bent_camera_projects_it(tmp_path):
    """The free end of the inner wall, x = 2, y = 2, seen from the corridor: an edge in depth where `project` says."""
    made = source(tmp_path, distortion=[-0.3, 0.1, 0.0, 0.0])
    try:
        capture = look_from(made, 1.0, 5.0, -np.pi / 2)
        height = made.camera.body_from_camera[2, 3]
        camera_from_world = inverse(made.truth() @ made.camera.body_from_camera)
        u, v = made.camera.project(transform(camera_from_world, np.array([[2.0, 2.0, height]])))[0]
        row = capture.depth[int(round(v))].astype(float)
        jump = int(np.argmax(np.abs(np.diff(row))))
        assert jump + 0.5 == pytest.approx(u, abs=1.0)
    finally:
        made.close()


@pytest.mark.parametrize(("settings", "complaint"), [
    ({"distortion": [0.1]}, "expected k1"),
    ({"distortion": [float("nan"), 0.0, 0.0, 0.0]}, "distortion"),
    ({"distortion": [9.0, 0.0, 0.0, 0.0]}, "distortion"),
])
def test_settings_of_the_lens_are_checked(settings, complaint):
    with pytest.raises(ConfigError, match=complaint) as caught:
        Simulator(**settings)
    assert "\n" not in str(caught.value)


def test_a_lens_that_folds_the_picture_is_refused_in_one_line():
    """k1 = -1: r (1 - r^2) has its largest value, 0.385, at r = 0.577; a corner of the picture lies at 0.68."""
    with pytest.raises(ConfigError, match=r"pixel \(0, 0\) of 160x120 has no ray") as caught:
        Lens(camera((-1.0, 0.0, 0.0, 0.0)), "source")
    assert "\n" not in str(caught.value)


@pytest.mark.benchmark
def test_one_eye_goes_round_a_corner_as_well_through_a_lens(tmp_path):
    """Two corridors of 17 m with the lens of tum_fr1: seed 100 gave an ATE of 0.034 m with and without it."""
    from rhs.config.compose import compose_config
    from rhs.patrol.run import run_config

    words = ["experiment=mono_two_corridors", "task=survey", "seed=100", "recording=off"]
    (tmp_path / "a").mkdir()
    row = run_config(compose_config([*words, f"source.distortion={list(TUM_FR1)}"]), tmp_path / "a")
    assert row["status"] == "ok" and row["ate_rmse_m"] < 0.08
