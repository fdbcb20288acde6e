"""The simulated laser scanner: distances one can work out, and those that every beam finds by itself."""

import numpy as np
import pytest

import rhs
from rhs.api.geometry import exp_so3, se2, se3
from rhs_sources.simulator_laser import LaserScanner, cuts, nearest_m

ROOM = np.array([(0.0, 0.0), (4.0, 0.0), (4.0, 6.0), (0.0, 6.0)])


def walls(corners_m: np.ndarray, low_m: float, high_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Upright quads round these corners: vertices and faces."""
    vertices, faces = [], []
    for begin, end in zip(corners_m, np.roll(corners_m, -1, axis=0), strict=True):
        faces.append(np.arange(4) + len(vertices))
        vertices += [(*begin, low_m), (*end, low_m), (*end, high_m), (*begin, high_m)]
    return np.array(vertices), np.array(faces)


def both(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    faces = [faces + start for (_, faces), start in zip(parts, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces)


def at(scan, degrees: float) -> float:
    return float(scan.ranges_m[np.argmin(np.abs(scan.bearings_rad - np.radians(degrees)))])


def test_a_room_of_4_by_6_metres_from_its_middle():
    laser = LaserScanner(541, np.radians(270.0), 0.25, 30.0)
    scan = laser.scan(*walls(ROOM, 0.0, 2.5), se2(2.0, 3.0, 0.0))
    assert [at(scan, 0), at(scan, 90), at(scan, -90)] == pytest.approx([2.0, 3.0, 3.0])
    assert at(scan, 45) == pytest.approx(2.0 * np.sqrt(2.0)) and at(scan, 135) == pytest.approx(2.0 * np.sqrt(2.0))
    assert at(laser.scan(*walls(ROOM, 0.0, 2.5), se2(2.0, 3.0, np.pi / 2)), 0) == pytest.approx(3.0)
    assert np.isfinite(scan.ranges_m).all()


def test_what_is_lower_or_higher_than_its_plane_is_not_seen_and_what_crosses_it_is():
    room, corners = walls(ROOM, 0.0, 2.5), ROOM / 8.0 + (3.0, 2.7)
    laser = LaserScanner(360, 2.0 * np.pi, 0.25, 30.0)
    for low, high, ahead_m in ((0.0, 0.2, 2.0), (0.7, 0.75, 2.0), (0.0, 0.4, 1.0)):
        scan = laser.scan(*both(room, walls(corners, low, high)), se2(2.0, 3.0, 0.0))
        assert at(scan, 0) == pytest.approx(ahead_m), (low, high)
    assert len(np.unique(np.round(np.exp(1j * scan.bearings_rad), 9))) == 360, "a full turn holds no beam twice"


def test_nothing_within_its_range_is_infinite_and_a_tilted_robot_sees_the_floor():
    laser, room = LaserScanner(181, np.pi, 0.25, 2.5), walls(ROOM, 0.0, 2.5)
    assert np.isinf(at(laser.scan(*room, se2(2.0, 3.0, 0.0)), 90)) and at(laser.scan(*room, se2(2.0, 3.0, 0.0)), 0) == 2.0
    floor = np.array([(*corner, 0.0) for corner in ROOM]), np.arange(4)[None]
    tilt = se3(exp_so3(np.array([0.0, np.radians(15.0), 0.0])), np.zeros(3))
    assert at(laser.scan(*both(room, floor), se2(2.0, 3.0, 0.0) @ tilt), 0) == pytest.approx(0.25 / np.tan(np.radians(15.0)))


def test_each_beam_finds_what_a_search_through_all_faces_finds():
    rng = np.random.default_rng(3)
    vertices, faces = rng.uniform(-5.0, 5.0, (300, 3)), rng.permutation(300).reshape(-1, 3)
    faces = np.column_stack([faces, np.full(len(faces), -1)])
    bearings = np.linspace(-np.pi, np.pi, 200, endpoint=False)
    segments = cuts(vertices, faces)
    assert 20 < len(segments) < 100
    expected = np.full(len(bearings), np.inf)
    for number, bearing in enumerate(bearings):
        for begin, end in segments:
            matrix = np.column_stack([(np.cos(bearing), np.sin(bearing)), begin - end])
            along, share = np.linalg.solve(matrix, begin)
            if along > 0.0 and 0.0 <= share <= 1.0:
                expected[number] = min(expected[number], along)
    assert nearest_m(segments, bearings) == pytest.approx(expected)


def test_a_laser_maps_a_building():
    row = rhs.run(["sensor=laser", "world=square_small", "task=survey", "source.image_width=64", "recording=off",
                   "pictures=off"])
    assert row["status"] == "ok" and row["ate_rmse_m"] < 0.02 and row["map_agreement"] > 0.97


@pytest.mark.parametrize("words, message", [
    (["source.laser_beams=1"], "laser_beams=1 is no scan"),
    (["source.renderer=tinyrenderer"], "type source.renderer=raster"),
])
def test_what_cannot_scan_is_refused(words, message):
    with pytest.raises(rhs.api.errors.ConfigError, match=message):
        rhs.run(["sensor=laser", "world=square_small", *words])


def test_a_task_of_pictures_is_refused_without_a_camera():
    with pytest.raises(rhs.api.errors.ConfigError, match="task=places needs image, which sensor=laser does not"):
        rhs.run(["sensor=laser", "task=places", "world=square_small"])
