"""Replaying tracks from the command line, and drawing walls where they can stand."""

import numpy as np
import pytest

from rhs_odometry.__main__ import main
from rhs_odometry.corridor.state import Plane
from rhs_odometry.corridor.wall_map import walls_of
from rhs_odometry.corridor.walls import with_hits
from rhs_odometry.tracks.replay import FilterRun, figures
from rhs_odometry.tracks.synthetic import named_tracks
from rhs_odometry.tracks.track_frames import Tracks, save_tracks


def test_a_tracks_file_is_replayed_with_its_picture(tmp_path, capsys):
    whole = named_tracks("straight:1")
    short = Tracks(whole.camera, whole.start, whole.frames[:30], whole.truth[:30])
    save_tracks(tmp_path / "tracks.npz", short)
    assert main([str(tmp_path), "corridor_ekf", "motion=none", "--picture", str(tmp_path / "p.png")]) == 0
    shown = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert float(shown["way_m"]) == pytest.approx(3.625, abs=0.01)
    assert float(shown["end_error_m"]) < 0.2
    assert (tmp_path / "p.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["synthetic:round", "corridor_ekf"], "is not one of straight, corner, square"),
        (["synthetic:straight", "procrustes"], "does not run on tracks"),
        (["synthetic:straight", "corridor_ekf", "motin=none"], "did you mean"),
        (["/nowhere.npz", "corridor_ekf"], "cannot be read"),
        (["synthetic:straight", "corridor_ekf", "motion"], "expected key=value"),
    ],
)
def test_refusals_are_one_line(words, complaint, capsys):
    assert main(words) != 0
    error = capsys.readouterr().err
    assert complaint in error and error.count("\n") == 1


def test_figures_of_a_constant_error():
    """Always 0.3 m aside and one degree askew, once round a corner."""
    way = np.concatenate([np.arange(0, 5, 0.1), np.full(50, 5.0)])
    truth = np.column_stack([way, np.concatenate([np.zeros(50), np.arange(0, 5, 0.1)]), np.repeat([0.0, np.pi / 2], 50)])
    error = np.tile([0.0, 0.3, np.radians(1.0)], (100, 1))
    run = FilterRun(truth + error, truth, error, np.ones((100, 3)), np.ones(100), np.ones(100, bool), (), np.ones(100))
    got = figures(run)
    assert got["ate_m"] == pytest.approx(0.3) and got["half_way_error_m"] == pytest.approx(0.3)
    assert got["corners"] == 1 and got["yaw_after_corner_deg"] == pytest.approx(1.0)


def wall(axis: int, offset: float, low: float, high: float, per_m: int = 12) -> Plane:
    return with_hits(Plane(axis, offset, 0.0, 0.0, low, high), np.linspace(low, high, int(per_m * (high - low))))


def test_a_wall_ends_at_the_next_wall_across_it():
    """Seen up to 4 m; the corridor's end wall stands at 6 m."""
    path = np.column_stack([np.linspace(0, 4, 40), np.zeros(40)])
    side, end = wall(1, 1.0, 1.0, 4.0), wall(0, 6.0, -1.0, 1.0)
    drawn = [d.wall for d in walls_of([side, end], path)]
    assert drawn[0].end_xy_m == pytest.approx([6.0, 1.0])


def test_no_wall_where_the_robot_has_driven():
    """The side wall of the first corridor is not drawn across the mouth of the second."""
    path = np.vstack([np.column_stack([np.linspace(0, 5, 50), np.zeros(50)]),
                      np.column_stack([np.full(50, 5.0), np.linspace(0, 5, 50)])])
    drawn = [d.wall for d in walls_of([wall(1, 1.0, 0.0, 4.3), wall(0, 4.0, 1.0, 5.0)], path)]
    assert drawn[0].end_xy_m == pytest.approx([4.0, 1.0])


def test_a_weak_wall_beside_a_strong_one_and_one_under_the_path_are_not_drawn():
    path = np.column_stack([np.linspace(0, 5, 50), np.zeros(50)])
    strong, echo, ghost = wall(1, 1.0, 0.0, 5.0, 40), wall(1, 1.3, 1.0, 4.0, 10), wall(1, 0.1, 1.0, 4.0)
    assert len(walls_of([strong, echo, ghost], path)) == 1
