"""The thesis's filter: what it can do (a straight corridor, a wrong start) and what it cannot (a corner)."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, log_so3, se2
from rhs_odometry.section.config import SectionEkf, TubeEkf
from rhs_odometry.section.ekf import section_core
from rhs_odometry.section.filter import Rectangular, Round
from rhs_odometry.tracks import synthetic
from rhs_odometry.tracks.monocular import MonocularOdometry


def corridor(length_m: float = 5.0, step_m: float = 0.1):
    """Thesis 4.4.1: 50 steps of 0.1 m along a corridor 2 m wide and 2.5 m high."""
    path = synthetic.corridor_path(np.array([[0.0, 0.0], [length_m, 0.0]]), step_m=step_m)
    return synthetic.synthetic_tracks(synthetic.straight_plan(), path, np.random.default_rng(0))


def errors(tracks, settings):
    """(N, 6) error of the sum of the motions in the true body frame: x, y, z m, roll, pitch, yaw degrees; the motions."""
    eye = MonocularOdometry(None, section_core(settings, tracks.camera, tracks.start), se2(*tracks.start))
    pose, rows, motions = se2(*tracks.start), [], []
    for frame, truth in zip(tracks.frames, tracks.truth, strict=True):
        motions.append(eye.update_tracks(frame))
        pose = pose @ motions[-1].previous_from_body
        gap = inverse(truth) @ pose
        rows.append([*gap[:3, 3], *np.degrees(log_so3(gap[:3, :3]))])
    return np.array(rows), motions


def test_rays_meet_a_tube_at_its_radius():
    directions = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, -2.0], [1.0, 0.0, 0.0]])
    reach = Round().meet(np.array([0.0, 0.5, 0.0]), directions, 2.0)
    hit = np.array([0.0, 0.5, 0.0]) + directions[:2] * reach[:2, None]
    assert np.hypot(hit[:, 1], hit[:, 2]) == pytest.approx([2.0, 2.0])
    assert reach[0] == pytest.approx(1.5)
    assert not np.isfinite(reach[2])  # along the tube there is no wall


def test_rays_meet_the_nearest_side_of_a_rectangle():
    directions = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.1], [1.0, 0.1, 1.0], [0.0, 0.1, -1.0]])
    reach = Rectangular(1.25).meet(np.array([0.0, 0.2, -0.05]), directions, 1.0)
    assert reach == pytest.approx([0.8, 1.2, 1.3, 1.2])


def test_straight_corridor_is_followed():
    """Within one per cent of the way, angles within a degree: thesis 5.7."""
    rows, motions = errors(corridor(), SectionEkf(speed_mps=0.4))
    assert np.linalg.norm(rows[-1, :3]) < 0.05
    assert np.abs(rows[-1, 3:]).max() < 1.0
    assert all(np.linalg.eigvalsh(m.covariance)[0] > 0 for m in motions)


def test_a_wrong_start_half_a_metre_aside_is_forgotten():
    """Thesis 4.4.1: started 0.5 m off in x, the filter corrects itself."""
    settings = SectionEkf(speed_mps=0.4, start_error_m=[0.0, 0.5, 0.0], start_sigma_m=0.5)
    rows, _ = errors(corridor(), settings)
    assert np.linalg.norm(rows[-1, :3]) < 0.07


def test_a_start_wrong_in_every_axis_is_forgotten_where_it_can_be_seen():
    """Half a metre aside and up and ten degrees about each axis. Along a corridor without ends nothing is observable:
    an error along it stays, whatever the filter."""
    settings = SectionEkf(
        speed_mps=0.4,
        iterations=3,
        start_error_m=[0.5, 0.5, 0.5],
        start_error_deg=[10.0, 10.0, 10.0],
        start_sigma_m=0.5,
        start_sigma_deg=10.0,
    )
    rows, _ = errors(corridor(), settings)
    assert np.abs(rows[-1, 1:3]).max() < 0.05
    assert np.abs(rows[-1, 3:]).max() < 1.0
    assert rows[-1, 0] > 0.3


def test_a_round_section_in_a_rectangular_corridor_is_biased():
    rows, _ = errors(corridor(), TubeEkf(speed_mps=0.4))
    assert 0.03 < np.linalg.norm(rows[-1, :3]) / 5.0 < 0.25


def test_the_corner_fails_and_the_filter_says_so():
    """The thesis's failure: one straight section cannot explain a corner. The alarm rings before the error is large,
    while the share of accepted points stays high."""
    path = synthetic.corridor_path(np.array([[3.0, 1.0], [19.0, 1.0], [19.0, 9.0]]))
    tracks = synthetic.synthetic_tracks(synthetic.square_plan(), path, np.random.default_rng(2))
    rows, motions = errors(tracks, SectionEkf())
    error = np.linalg.norm(rows[:, :2], axis=1)
    assert error[-1] > 1.0
    rang = next(i for i, m in enumerate(motions) if m.status == "degenerate" and i > 60)
    assert error[rang] < 1.0
    assert motions[-1].details["accepted_share"] > 0.5


def test_settings_are_checked():
    with pytest.raises(ConfigError, match="^aspect="):
        SectionEkf(aspect=float("inf"))
    with pytest.raises(ConfigError, match="^half_size_m="):
        TubeEkf(half_size_m=-1.0)
    with pytest.raises(ConfigError, match="expected 3"):
        SectionEkf(start_error_m=[0.5])
