"""The source `tube`: its views, depth and texture agree with one another, through any lens."""

from pathlib import Path

import numpy as np
import pytest

from rhs.api.contracts import SourceContext
from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, transform
from rhs_sources.tube_config import Tube


def build(**settings):
    return Tube(image_width=160, length_m=0.5, step_m=0.1, **settings).build(
        SourceContext(np.random.default_rng(0), None, Path()))


@pytest.mark.parametrize("settings", [{}, {"pieces": [0.1, 0.0, 0.6, -30.0]}, {"shape": "rectangular", "aspect": 1.3},
                                      {"distortion": [-0.2, 0.05, 0.001, -0.001], "skew_px": 2.0}])
def test_depth_leads_to_the_wall_and_the_wall_has_the_colour_of_the_picture(settings):
    """Every pixel is carried by its depth and the true pose to the wall; the texture there is what the pixel shows. A lens
    that distorts moves pixels, and is undone by the camera's own rays."""
    source = build(**settings)
    for _ in range(4):
        capture = source.lead()
    v, u = (a.ravel()[::7] for a in np.indices(capture.depth.shape))
    depth = capture.depth[v, u].astype(float)
    near = depth < 1.0
    points = source.camera.points(np.stack([u, v], axis=1).astype(float)[near], depth[near])
    world = transform(source.truth() @ source.camera.body_from_camera, points)
    half = 0.25 * settings.get("aspect", 1.0)
    inside = world - [0.0, 0.0, half]
    _, left, up = source.tube.locate(inside)
    assert np.abs(source.tube.section.slack(left, up)).max() < 1e-4
    shown = capture.image[v[near], u[near], 0].astype(float)
    true = source.texture(*source.tube.flat(inside).T)
    assert np.corrcoef(shown, true)[0, 1] > 0.97


def test_the_first_view_stands_on_the_axis_and_the_travel_is_the_motion():
    source = build(camera_share=0.5)
    first = source.lead()
    assert first.travel is None and np.allclose(source.truth(), np.eye(4))
    assert source.camera.height_m == pytest.approx(0.25)
    before = source.truth()
    second = source.lead()
    move = inverse(before) @ source.truth()
    assert second.travel[:2] == pytest.approx(move[:2, 3])
    assert second.stamp_s - first.stamp_s == pytest.approx(0.4)
    assert second.command.forward_mps * second.command.duration_s == pytest.approx(0.1, rel=0.2)


@pytest.mark.parametrize(("settings", "complaint"), [
    ({"pieces": [1.0]}, "expected pairs"), ({"size_m": -1.0}, "size_m"), ({"pieces": [0.1, 170.0]}, "bend"),
    ({"distortion": [0.1]}, "expected k1"),
])
def test_settings_are_checked(settings, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Tube(**settings)


def test_a_lens_that_folds_the_picture_is_refused():
    with pytest.raises(ConfigError, match="folds the picture"):
        build(distortion=[-1.0, 0.0, 0.0, 0.0])
