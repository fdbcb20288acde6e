"""The corridor filter as a whole, on laps of synthetic tracks: accuracy, honesty, the map it draws."""

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import planar, se2, wrap
from rhs.api.records import Tracking
from rhs.estimation.filters.kalman import nees
from rhs_odometry.corridor.config import CorridorEkf
from rhs_odometry.corridor.ekf import Ledger, corridor_core
from rhs_odometry.tracks import synthetic
from rhs_odometry.tracks.monocular import MonocularOdometry, StructureAlarm
from rhs_odometry.tracks.track_frames import TrackFrame


def lap(clockwise: bool, seed: int, *, radius_m: float = 0.7):
    path = synthetic.corridor_path(synthetic.square_corners(clockwise=clockwise), radius_m=radius_m)
    return synthetic.synthetic_tracks(synthetic.square_plan(), path, np.random.default_rng(seed))


def follow(tracks, settings: CorridorEkf):
    """(core, online poses (N, 3), truth (N, 3), NEES (N,)), and the least eigenvalue of the covariance on the way."""
    core = corridor_core(settings, tracks.camera, tracks.start)
    poses, honesty, least = [], [], np.inf
    for i, frame in enumerate(tracks.frames):
        core.step(frame)
        state = core.filter.state
        poses.append(state.clones[-1, :3])
        error = poses[-1] - planar(tracks.truth[i])
        error[2] = wrap(error[2])
        honesty.append(nees(error, state.pose_covariance()[:3, :3]))
        if i % 50 == 0:
            assert np.array_equal(state.covariance, state.covariance.T)
            least = min(least, np.linalg.eigvalsh(state.covariance)[0])
    truth = np.array([planar(t) for t in tracks.truth])
    return core, np.array(poses), truth, np.array(honesty), least


def ate(poses: np.ndarray, truth: np.ndarray) -> float:
    return float(np.sqrt(((poses[:, :2] - truth[:, :2]) ** 2).sum(1).mean()))


@pytest.fixture(scope="module")
def whole_lap():
    tracks = lap(False, 0)
    return tracks, *follow(tracks, CorridorEkf())


def test_a_lap_round_an_unknown_plan_stays_within_a_quarter_metre(whole_lap):
    """72 m, command 5 % too long: the command alone would end metres away."""
    _, _, poses, truth, honesty, least = whole_lap
    assert ate(poses, truth) < 0.25
    half = len(truth) // 2
    assert np.linalg.norm(poses[half, :2] - truth[half, :2]) < 0.36
    assert np.median(honesty) < 10.0
    assert least > 0


def test_the_lap_leaves_eight_walls_where_they_stand(whole_lap):
    tracks, core, *_ = whole_lap
    revision = core.revise()
    assert len(revision.poses) == len(revision.scans) == len(tracks.frames)
    drawn = np.array([[w.start_xy_m, w.end_xy_m] for w in revision.walls])
    assert len(drawn) == 8
    for wall in synthetic.square_plan().walls:
        gap = [min(np.abs(d - wall).max(), np.abs(d[::-1] - wall).max()) for d in drawn]
        assert min(gap) < 0.3  # both ends, and with them the offset


def test_motions_add_up_to_the_believed_pose(whole_lap):
    tracks, core, poses, *_ = whole_lap
    eye = MonocularOdometry(None, corridor_core(CorridorEkf(), tracks.camera, tracks.start), se2(*tracks.start))
    pose = se2(*tracks.start)
    for frame in tracks.frames[:60]:
        motion = eye.update_tracks(frame)
        pose = pose @ motion.previous_from_body
        assert np.linalg.eigvalsh(motion.covariance)[0] > 0
    assert planar(pose)[:2] == pytest.approx(poses[59, :2], abs=1e-9)
    assert motion.status is Tracking.OK and motion.scan is not None


def test_no_points_is_lost_and_the_covariance_grows(whole_lap):
    tracks, *_ = whole_lap
    eye = MonocularOdometry(None, corridor_core(CorridorEkf(), tracks.camera, tracks.start), se2(*tracks.start))
    for frame in tracks.frames[:40]:
        seen = eye.update_tracks(frame)
    blind = TrackFrame(frame.stamp_s + 0.25, np.zeros(0, int), np.zeros((0, 2)))
    lost = eye.update_tracks(blind)
    assert lost.status is Tracking.LOST and "points followed" in lost.reason
    assert lost.covariance[0, 0] > 10 * seen.covariance[0, 0]


def test_corner_without_any_motion_input():
    """Arcs only: with nothing but the constant-speed model the corner is passed on arcs."""
    path = synthetic.corridor_path(np.array([[3.0, 1.0], [19.0, 1.0], [19.0, 9.0]]))
    tracks = synthetic.synthetic_tracks(synthetic.square_plan(), path, np.random.default_rng(2))
    _, poses, truth, *_ = follow(tracks, CorridorEkf(motion="none"))
    assert np.abs(poses[:, :2] - truth[:, :2]).max() < 0.5
    assert abs(np.degrees(wrap(poses[-1, 2] - truth[-1, 2]))) < 1.0


def test_turning_on_the_spot_without_any_motion_input_keeps_the_scale():
    """What it takes for motion while it turns may stay as an error, but behind the turn a metre is a metre."""
    path = synthetic.corridor_path(np.array([[11.0, 1.0], [19.0, 1.0], [19.0, 9.0]]), radius_m=0.0)
    tracks = synthetic.synthetic_tracks(synthetic.square_plan(), path, np.random.default_rng(2))
    _, poses, truth, *_ = follow(tracks, CorridorEkf(motion="none"))
    driven, true = (np.hypot(*np.diff(p[-50:, :2], axis=0).T).sum() for p in (poses, truth))
    assert driven == pytest.approx(true, rel=0.05)
    assert np.abs(poses[:, :2] - truth[:, :2]).max() < 1.5


def test_turning_on_the_spot_with_the_command():
    path = synthetic.corridor_path(np.array([[11.0, 1.0], [19.0, 1.0], [19.0, 9.0]]), radius_m=0.0)
    tracks = synthetic.synthetic_tracks(synthetic.square_plan(), path, np.random.default_rng(2))
    _, poses, truth, *_ = follow(tracks, CorridorEkf())
    assert np.abs(poses[:, :2] - truth[:, :2]).max() < 0.3


def test_alarm_needs_five_views_above_its_threshold():
    alarm = StructureAlarm()
    for _ in range(12):
        alarm.watch(1, 10)
    assert not alarm.ringing
    rang = []
    for _ in range(12):
        alarm.watch(8, 10)
        rang.append(alarm.ringing)
    assert not any(rang[:5]) and rang[-1]


def test_settings_that_fix_no_scale_are_refused():
    with pytest.raises(ConfigError, match="nothing fixes the scale"):
        CorridorEkf(motion="none", height_known=False, width_m=0.0)
    with pytest.raises(ConfigError, match="pixel_sigma_px"):
        CorridorEkf(pixel_sigma_px=float("nan"))
    with pytest.raises(ConfigError, match="not one of"):
        CorridorEkf(motion="legs")


def test_motions_add_up_to_no_less_than_the_covariance_of_the_pose_and_to_no_more_where_it_shrinks():
    """A pose known to 0.1 m, then to 0.2 m, then to 0.1 m again: the sum stays at 0.2 m (headings without error)."""
    ledger, total = Ledger(), np.zeros((3, 3))
    for x, sigma in ((0.0, 0.1), (1.0, 0.2), (2.0, 0.1)):
        total = total + ledger.motion(np.array([x, 0.0, 0.0]), np.diag([sigma, sigma, 0.0]) ** 2)
    assert np.sqrt(total[0, 0] + 0.1**2) == pytest.approx(0.2, abs=0.001)


def test_a_filter_that_doubts_says_so_with_a_wider_covariance():
    ledgers = [Ledger(), Ledger()]
    pose, own = np.array([1.0, 0.0, 0.3]), np.diag([0.1, 0.1, 0.01]) ** 2
    for ledger in ledgers:
        ledger.motion(np.zeros(3), own)
    sure, doubting = ledgers[0].motion(pose, own), ledgers[1].motion(pose, 4 * own)
    assert doubting[1, 1] > 10 * sure[1, 1]


def test_what_fixes_the_scale_is_said():
    """Of a camera nothing but these can: its height above the floor, the corridors' width, the motion it was told."""
    from rhs_odometry.corridor.config import CorridorEkf
    from rhs_odometry.corridor.ekf import scale_from

    assert scale_from(CorridorEkf()) == "camera height + command"
    assert scale_from(CorridorEkf(width_m=2.0)) == "camera height + width 2 m + command"
    assert scale_from(CorridorEkf(motion="none", width_m=0.0)) == "camera height"
    assert scale_from(CorridorEkf(height_known=False, width_m=0.0, motion="wheel")) == "wheel"
