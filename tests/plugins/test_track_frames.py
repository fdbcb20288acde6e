"""Tracks: saved and read back, followed in real pictures, and made without pictures."""

import numpy as np
import pytest

from rhs.api.errors import RecordingError
from rhs.api.geometry import camera_from_fov
from rhs.api.records import Observation, Twist
from rhs_odometry.corridor.window import TrackWindow
from rhs_odometry.tracks import synthetic
from rhs_odometry.tracks.klt import KltTracker
from rhs_odometry.tracks.settings import KltSettings
from rhs_odometry.tracks.track_frames import TrackFrame, common, load_tracks, save_tracks

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.2)


@pytest.fixture(scope="module")
def short_run():
    path = synthetic.corridor_path(np.array([[0.0, 0.0], [2.0, 0.0]]))
    return synthetic.synthetic_tracks(synthetic.straight_plan(), path, np.random.default_rng(0))


def test_saved_tracks_come_back(tmp_path, short_run):
    file = tmp_path / "tracks.npz"
    save_tracks(file, short_run)
    again = load_tracks(file)
    assert again.camera.matrix == pytest.approx(short_run.camera.matrix)
    assert again.camera.body_from_camera == pytest.approx(short_run.camera.body_from_camera)
    assert len(again.frames) == len(short_run.frames)
    for a, b in zip(again.frames, short_run.frames, strict=True):
        assert np.array_equal(a.ids, b.ids) and np.array_equal(a.command, b.command)
        assert a.pixels == pytest.approx(b.pixels, abs=1e-4)
    assert [p.name for p in tmp_path.iterdir()] == ["tracks.npz"]


def test_a_broken_tracks_file_is_refused_in_one_line(tmp_path):
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04 not really")
    for name in ("bad.npz", "missing.npz"):
        with pytest.raises(RecordingError, match="cannot be read"):
            load_tracks(tmp_path / name)


def test_common_points_are_paired_by_number():
    a = TrackFrame(0.0, np.array([3, 1, 7]), np.array([[3.0, 0], [1, 0], [7, 0]]))
    b = TrackFrame(1.0, np.array([7, 8, 3]), np.array([[7.0, 1], [8, 1], [3, 1]]))
    before, after = common(a, b)
    assert before[:, 0].tolist() == [3, 7] and after[:, 0].tolist() == [3, 7]


def observation(image, stamp=0.0):
    return Observation(0, stamp, CAMERA, image=image, command=Twist(0.5, 0.2, 0.25), wheel=np.array([0.1, 0, 0.05]))


def painting(shift: tuple[int, int] = (0, 0)) -> np.ndarray:
    """A picture of blocks, moved by whole pixels (right, down)."""
    blocks = np.random.default_rng(5).integers(0, 255, (40, 50), dtype=np.uint8)
    large = np.kron(blocks, np.ones((8, 8), np.uint8))
    image = large[20 - shift[1] : 260 - shift[1], 40 - shift[0] : 360 - shift[0]]
    return np.repeat(image[:, :, None], 3, axis=2)


def test_points_follow_the_picture():
    tracker = KltTracker(KltSettings())
    first = tracker.track(observation(painting()))
    second = tracker.track(observation(painting((3, -2))))
    before, after = common(first, second)
    assert len(before) > 80
    assert np.median(after - before, axis=0) == pytest.approx([3.0, -2.0], abs=0.05)
    assert first.command == pytest.approx([0.125, 0.05, 0.25])
    assert (first.pixels[:, 1] >= 160).sum() >= 25  # the floor's quota


def test_numbers_are_never_used_twice_and_blank_views_end_all_tracks():
    tracker = KltTracker(KltSettings())
    first = tracker.track(observation(painting()))
    assert len(tracker.track(observation(np.full((240, 320, 3), 128, np.uint8))).ids) == 0
    assert len(tracker.track(observation(None)).ids) == 0
    again = tracker.track(observation(painting()))
    assert len(again.ids) > 80 and not set(again.ids) & set(first.ids)


def test_synthetic_points_project_where_the_camera_says(short_run):
    """Without noise the same point seen twice triangulates onto a wall, the floor or the ceiling."""
    path = synthetic.corridor_path(np.array([[0.0, 0.0], [1.0, 0.0]]))
    exact = synthetic.TrackNoise(white_px=0.0, walk_px=0.0, loss=0.0)
    run = synthetic.synthetic_tracks(synthetic.straight_plan(), path, np.random.default_rng(0), track=exact)
    before, after = common(run.frames[0], run.frames[4])
    r0, r1 = CAMERA.rays(before), CAMERA.rays(after)
    parallax = np.hypot(*(r1 - r0)[:, :2].T) > 0.01  # a point straight ahead has no depth
    depth = (0.5 * r1[:, :2] / (r1 - r0)[:, :2])[parallax]
    depth = np.where(np.abs(r0[parallax, 0]) > np.abs(r0[parallax, 1]), depth[:, 0], depth[:, 1])
    x, z = r0[parallax, 0] * (depth + 0.0), 1.2 - r0[parallax, 1] * depth
    gap = np.min([np.abs(np.abs(x) - 1.0), np.abs(z), np.abs(z - 2.5)], axis=0)
    assert np.percentile(gap, 90) < 0.1


def test_inner_walls_hide_the_corridor_behind_them():
    walls = synthetic.square_plan().walls
    points = np.array([[10.0, 2.0], [10.0, 19.0]])
    assert synthetic.hidden(np.array([10.0, 1.0]), points, walls).tolist() == [False, True]


def test_the_window_hands_out_every_sight_once():
    window = TrackWindow(CAMERA, 6)
    rng, handed, given = np.random.default_rng(3), 0, 0
    alive: dict[int, int] = {}
    for view in range(60):
        alive = {k: v for k, v in alive.items() if rng.uniform() > 0.1}
        for k in range(20 - len(alive)):
            alive[1000 * view + k] = view
        ids = np.array(sorted(alive))
        rays, seen = window.push(TrackFrame(0.25 * view, ids, np.column_stack([ids % 300, ids % 200]).astype(float)))
        given += len(ids)
        handed += int(seen.sum())
        runs = seen.astype(int)
        assert (seen.sum(1) >= 4).all() and (np.abs(np.diff(runs, axis=1)).sum(1) <= 2).all()  # views in a row
    assert 0.5 * given < handed < given
