"""A card on recordings of somebody's own: the golden laser log, found again in the map of its own survey."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import rhs
from rhs.base.errors import ConfigError
from rhs.card import card, recordings
from rhs.cli import card as command
from rhs.cli import card_recordings

LOG = Path(__file__).parents[1] / "golden" / "laser.clf"
READ = ["source=replay", f"source.path={LOG}", "sensor=laser", "odometry=wheel"]


@pytest.fixture(autouse=True)
def _contract_elsewhere(monkeypatch):
    """What the contract says is tested where it is checked."""
    monkeypatch.setattr(card, "contract", lambda kind, settings: [{"check": "made", "holds": True, "why": ""}])


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("survey") / "first"
    rhs.run(["task=survey", *READ, "loop_closer=none", "recording=off", "pictures=off", f"output={folder}"], quiet=True)
    return folder


def test_a_localiser_beside_ours_on_a_log(surveyed, tmp_path, capsys):
    """Who never looks is told where it begins one metre off: wrong and sure in every view, which the card says."""
    words = [*READ, f"map={surveyed / 'map.yaml'}", f"source.truth={surveyed / 'corrected.tum'}", "start=[1,0,0]"]
    assert command.main(["localiser=odometry_only", *words, f"output={tmp_path}"]) == 0
    content = json.loads((tmp_path / "card.json").read_text())
    assert list(content["figures"]) == ["localiser=odometry_only", "localiser=particle_filter_scan"]  # no images here
    mine, ours = content["figures"].values()
    assert mine["belief_wrong_sure_share"] == 1.0 and mine["found_share"] == 0.0 and ours["belief_wrong_sure_share"] < 1.0
    assert "apart_share" not in mine and 0.0 <= ours["apart_share"] <= 1.0
    assert any("not beside it, localiser=sift_db: localiser=sift_db needs image" in said for said in content["verdict"])
    said = "laser.clf: found after 0 of 1 starts (90 % wanted), wrong and sure in 100.0 % of the views"
    assert said in content["verdict"][1]
    assert list(content["rooms"]) == ["laser.clf"] and content["rooms"]["laser.clf"]["starts"] == 1.0
    page = (tmp_path / "card.html").read_text()
    assert "On your recordings" in page and page.count("<img") == 2 and "start=[1,0,0]" in page
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/row.json")}
    assert len(before) == 2 and command.main(["localiser=odometry_only", *words, f"output={tmp_path}"]) == 0
    assert before == {path: path.stat().st_mtime_ns for path in tmp_path.glob("runs/*/row.json")}  # not run again
    assert "keeps its contract (1 checks)" in capsys.readouterr().out


def test_what_the_covariance_of_an_odometry_means_stands_beside_its_errors(surveyed, tmp_path):
    """Its truth is its own way, closed by nothing: no error at all."""
    assert command.main(["odometry=wheel", *READ[:3], f"source.truth={surveyed / 'corrected.tum'}", "loop_closer=none",
                         f"output={tmp_path}"]) == 0
    content = json.loads((tmp_path / "card.json").read_text())
    assert content["figures"]["odometry=wheel"]["nees"] < 1e-6 and "nees" in content["columns"]


def test_of_a_recording_without_a_truth_little_can_be_said(tmp_path):
    assert command.main(["odometry=scan_to_map", *READ[:3], f"output={tmp_path}"]) == 0
    content = json.loads((tmp_path / "card.json").read_text())
    assert "laser.clf has no truth (source.truth=FILE): only how many views it could follow" in content["verdict"][1]
    assert "ate_rmse_m" not in content["figures"]["odometry=scan_to_map"]
    assert content["standard_set"].startswith("python -m rhs -m task=survey source=replay")


@pytest.mark.parametrize(("words", "said"), [
    (["planner=prm", *READ[:3]], "on recordings there are cards of localiser and odometry"),
    (["localiser=particle_filter_scan", *READ], "map is empty; type map=MAP.yaml"),
    (["localiser=sift_db", *READ, "map=nowhere.yaml"], "localiser=sift_db needs image"),
    (["localiser=particle_filter_scan", "localiser.particels=3", *READ], "unknown key"),
    (["odometry=wheel", "seed=3"], "card seed=3: expected settings of odometry=wheel")])
def test_what_cannot_be_asked_is_refused_in_one_line(tmp_path, words, said):
    with pytest.raises(ConfigError, match=said):
        command.main([*words, f"output={tmp_path}"])
    assert not (tmp_path / "card.html").exists() and len(list(tmp_path.glob("runs/*_*"))) <= 1  # ours are not asked first


def test_a_localiser_starts_anew_unless_something_else_is_typed():
    assert card_recordings.typed("localiser", ["source=replay"])[:2] == ["task=localise", "restart_every_m=15"]
    assert card_recordings.typed("localiser", ["start=unknown"]) == ["task=localise", "start=unknown"]
    assert card_recordings.typed("odometry", ["seed=1"]) == ["task=survey", "seed=1"]


def test_localisers_that_are_sure_and_apart_are_counted_without_a_truth():
    """Of four views one is apart by 0.5 m, one by 0.2 rad, one is not sure; of the last the other has none."""
    step = {"belief_status": "tracking", "x_m": "0", "y_m": "0", "yaw_rad": "0"}
    mine = [{**step, "stamp_s": str(k)} for k in range(4)]
    other = [{**step, "stamp_s": "0", "x_m": "0.5"}, {**step, "stamp_s": "1", "yaw_rad": "0.2"},
             {**step, "stamp_s": "2", "x_m": "9", "belief_status": "lost"}, {**step, "stamp_s": "7", "x_m": "9"}]
    assert recordings.apart_share(other, mine) == pytest.approx(2 / 3) and np.isnan(recordings.apart_share(mine, []))


def test_figures_are_means_over_what_is_known():
    rows = [{"ate_rmse_m": 0.1, "tracked_share": 1.0, "peak_memory_mb": 200.0},
            {"ate_rmse_m": None, "tracked_share": 0.5, "peak_memory_mb": 300.0}]
    found = recordings.figures("odometry", rows)
    assert found == {"ate_rmse_m": 0.1, "tracked_share": 0.75, "peak_memory_mb": 300.0}
    starts = recordings.figures("localiser", [{"starts": 3, "belief_ece": np.nan}, {"starts": 4, "belief_ece": 0.2}])
    assert starts == {"starts": 7.0, "belief_ece": 0.2}
