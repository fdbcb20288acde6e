"""Record, then replay with the same parts: the same estimates, bit for bit."""

import pytest

import rhs
from rhs.metrics.evaluate import evaluate
from rhs.runfolder.row import machine_dependent


@pytest.mark.slow
def test_a_replayed_survey_gives_the_same_estimates(tmp_path):
    """Through the whole program: simulator, sensor noise, odometry, loop closing, map; then the recording in their place."""
    parts = ["odometry=procrustes", "loop_closer=error_distribution"]
    driven = ["world=corridor", "source.image_width=160", "recording=full", "mission.tries=1"]
    rhs.run([*parts, *driven, f"output={tmp_path / 'first'}"])
    recording = tmp_path / "first" / "run.mcap"
    rhs.run([*parts, "source=replay", f"source.path={recording}", "recording=off", f"output={tmp_path / 'again'}"])
    for name in ("estimate.tum", "corrected.tum", "truth_survey.tum", "map.pgm", "map.yaml"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "first" / name).read_bytes(), name
    first, again = evaluate(tmp_path / "first"), evaluate(tmp_path / "again")
    same = [name for name in first if name.startswith(("ate", "rpe", "end", "half", "drift"))]
    assert len(same) > 10 and all(repr(first[n]) == repr(again[n]) for n in same if not machine_dependent(n))
