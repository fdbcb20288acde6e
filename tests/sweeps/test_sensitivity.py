"""`python -m rhs sensitivity`: which values are tried, what an effect is, what is refused, that it goes on."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from rhs.api.errors import ConfigError, check_ranges
from rhs.cli.main import main
from rhs.config.compose import compose_config
from rhs.reports.sensitivity_picture import sensitivity_picture
from rhs.sweeps import sensitivity
from rhs.sweeps.kept import broken_off
from rhs.sweeps.sensitivity import Change, ask, changes_of, check_recorded, effects, in_words, numbers


@dataclass
class Knobs:
    share: float = 0.75
    count: int = 1
    off: float = 0.0
    yes: bool = True
    unset: float | None = None

    def __post_init__(self) -> None:
        check_ranges("", self, share=(0.0, 1.0), count=(1, 50))


@dataclass
class Chosen:
    settings: Knobs
    name: str = "mine"


def test_half_and_double_within_the_range(monkeypatch):
    """0.75 doubles to the end of its range, 1; a whole 1 has no half; 0 has neither; what is no number is not tried."""
    monkeypatch.setattr(sensitivity, "to_plain", lambda config: {"odometry": {"name": "mine", **vars(Knobs())}})
    config = type("Config", (), {"odometry": Chosen(Knobs())})()
    changes, left_out = changes_of("odometry", config)
    assert [(one.key, one.before, one.value) for one in changes] == [
        ("odometry.share", 0.75, 0.375), ("odometry.share", 0.75, 1.0), ("odometry.count", 1, 2)]
    assert isinstance(changes[2].value, int)
    assert list(left_out) == ["odometry.off"] and "no double" in left_out["odometry.off"]
    assert [one.key for one in changes_of("odometry", config, ["cou"])[0]] == ["odometry.count"]
    with pytest.raises(ConfigError, match="no such numeric setting as nothing"):
        changes_of("odometry", config, ["cou", "nothing"])


def test_settings_of_nested_groups_are_found_and_composed():
    asked = ask(["odometry=procrustes", "world=square_small", "seed=0"], only=["advanced.sway.share", "min_inliers"])
    assert [str(change.word.text) for change in asked.changes] == [
        "odometry.min_inliers=6", "odometry.min_inliers=24", "odometry.advanced.sway.share=0.05",
        "odometry.advanced.sway.share=0.2"]
    assert [job.config.odometry.settings.advanced.sway.share for (job,) in asked.changed[2:]] == [0.05, 0.2]
    values = compose_config(["task=survey"]).odometry.settings
    assert values.advanced.sway.share == 0.1  # and nothing else was changed
    assert list(numbers({"a": {"b": 1, "c": True}, "d": "x", "e": 2.0})) == [(("a", "b"), 1), (("e",), 2.0)]


def test_an_effect_by_hand():
    """Errors 1.1, 1.2, 1.1 times what they were in three buildings: 13.2 % more on the geometric mean."""
    asked = ask(["odometry=procrustes", "zip(world=square_small,square,corridor seed=0,1,2)"], only=["min_inliers"])
    asked = replace(asked, changes=(Change("odometry.a", 1.0, 2.0, 2.0), Change("odometry.b", 1.0, 2.0, 2.0),
                                    Change("odometry.c", 1.0, 0.5, 0.5)))
    rows = [[{"status": "ok", asked.measure: error * times, "success": success, "wall_ms": k}
             for k, (error, times) in enumerate(zip((0.1, 0.2, 0.4), by, strict=True))]
            for by, success in (((1, 1, 1), 1.0), ((1.1, 1.2, 1.1), 1.0), ((1, 1, 1), 1.0), ((1, math.nan, 1), 0.0))]
    found = {one.of.key: one for one in effects(asked, [row for four in rows for row in four])}
    a, b, c = (found[f"odometry.{name}"] for name in "abc")
    assert a.change == pytest.approx(math.prod((1.1, 1.2, 1.1)) ** (1 / 3) - 1) and a.low < a.change < a.high
    assert a.low == pytest.approx(math.expm1(math.log1p(a.change) - 4.3027 * 0.050236 / math.sqrt(3)), abs=1e-4)
    assert b.same and b.says == "changes nothing" and (c.lost, c.pairs, c.says) == (3, 2, "fails")
    said = in_words(list(found.values()), asked)
    assert "1 of 3 settings" in said[0] and "+3 of 3 runs fail" in said[0] and said[1].endswith("nothing: odometry.b")


def test_maps_without_fault_are_compared_too():
    """Of five maps one is whole before and one after: all five count, a thousandth being added to what is lacking."""
    five = "zip(world=square_small,square,corridor,lobby,office seed=0,1,2,3,4)"
    asked = ask(["mapper=occupancy", five], only=["resolution_m"])
    asked = replace(asked, changes=(Change("mapper.a", 1.0, 2.0, 2.0),))
    maps = ((1.0, 0.99, 0.98, 0.97, 1.0), (1.0, 0.99, 0.98, 1.0, 0.999))
    rows = [{"status": "ok", asked.measure: share, "n": number, "success": 1.0}
            for number, shares in enumerate(maps) for share in shares]
    (one,) = effects(asked, rows)
    assert one.pairs == 5 and one.change == pytest.approx((1 / 31 * 2) ** (1 / 5) - 1)


@pytest.mark.parametrize(("before", "after", "says"), [
    (5, 5, "no effect"), (5, 3, "not sure"), (5, 2, "fails"), (4, 0, "fails"), (3, 1, "not sure"), (1, 3, "no effect")])
def test_runs_that_are_lost_by_chance_are_not_called_failing(before, after, says):
    """Of two sets of five runs that succeed half of the time, one has two more in 17 of 100 pairs of sets."""
    asked = ask(["odometry=procrustes", "zip(world=square_small,square,corridor,lobby,office seed=0,1,2,3,4)"],
                only=["min_inliers"])
    asked = replace(asked, changes=(Change("odometry.a", 1.0, 2.0, 2.0),))
    rows = [{"status": "ok", asked.measure: 0.1, "n": number, "success": float(seed < count)}
            for number, count in enumerate((before, after)) for seed in range(5)]
    (one,) = effects(asked, rows)
    assert one.says == says
    assert ("may be chance" in " ".join(in_words([one], asked))) == (says == "not sure")


def test_a_setting_that_only_stirs_the_luck_fails_in_one_of_twenty():
    chance = np.random.default_rng(0).random((400, 2, 20)) < 0.8
    called = [sensitivity._fails(int(before.sum()), int(after.sum()), 20) for before, after in chance]
    assert np.mean(called) <= 0.05 < np.mean(chance[:, 0].sum(1) - chance[:, 1].sum(1) >= 2)


def test_of_runs_that_all_broke_off_nothing_is_known():
    asked = ask(["odometry=procrustes", "zip(world=square_small,square,corridor seed=0,1,2)"], only=["min_inliers"])
    asked = replace(asked, changes=(Change("odometry.a", 1.0, 2.0, 2.0),))
    rows = [{"status": "failed", "reason": "of mine", "success": 0.0, asked.measure: 0.001}] * 6
    (one,) = effects(asked, rows)
    assert (one.same, one.pairs, one.says) == (False, 0, "not sure")
    assert broken_off(rows[:3]) == "3 of 3 broke off, most by: of mine" and not broken_off([{"status": "ok"}])


@pytest.mark.parametrize(("words", "says"), [
    ([], "say which part"), (["source=simulator"], "say which part"), (["odometry=procrusts"], "did you mean"),
    (["odometry=wheel", "localiser=sift_db,odometry_only"], "localiser takes one value"),
    (["planner=prm", "planner.milestones=-4"], "milestones"),
    (["localiser=sift_db", "--recording", "x"], "compared by patrol_rmse_m, which no recording tells"),
    (["mapper=occupancy", "--recording", "x"], "compared by map_agreement, which no recording tells"),
    (["odometry=procrustes", "--recording", "'x"], "No closing quotation"),
    (["odometry=procrustes", "--data", "nowhere"], "nothing at nowhere/rgbd"),
    (["odometry=wheel", "sensor=laser", "--data", "nowhere"], "no true poses")])
def test_what_is_no_question_is_refused_in_one_line(words, says, capsys):
    assert main(["sensitivity", *words]) == 2
    said = capsys.readouterr().err
    assert says in said and said.count("\n") == 1


def test_recordings_are_asked_in_addition(tmp_path, monkeypatch):
    """Each is a pair of its own, without the words that are the buildings'; a folder's name may hold anything."""
    monkeypatch.setattr("rhs.sweeps.recorded.check_data", lambda data, names: None)
    data = tmp_path / "with a space, (brackets)"
    words = ["odometry=procrustes", "world=square_small", "seed=0,1", "source.image_width=320"]
    given = [sensitivity.recording(f"'{tmp_path}/one two' source.camera=tum_fr1"), sensitivity.recording("other")]
    asked = ask(words, only=["min_inliers"], recordings=[*given, *sensitivity.frozen(data, words)])
    assert [where for where, _ in asked.pairs] == ["square_small", "square_small", f"{tmp_path}/one two", "other",
                                                   "tum_fr1_rpy_60", "open3d_5"]
    sources = [job.config.source.settings for _, job in asked.pairs[2:]]
    assert [str(one.path) for one in sources] == [f"{tmp_path}/one two", "other", f"{data}/rgbd/tum_fr1_rpy_60",
                                                  f"{data}/rgbd/open3d_5"]
    assert [one.camera for one in sources] == ["tum_fr1", "auto", "tum_fr1", "auto"]
    assert [[job.config.odometry.settings.min_inliers for job in jobs] for jobs in asked.changed] == [[6] * 6, [24] * 6]


def test_the_command_goes_on_where_it_was_stopped(tmp_path, capsys):
    """Rows stay in shards and no folder does; a second start runs nothing and writes the same table."""
    words = ["sensitivity", "planner=rrt", "zip(world=map1,map1 seed=0,1)", "--only", "goal_bias", "--jobs", "1",
             f"output={tmp_path / 'out'}"]
    assert main(words) == 0
    table = (tmp_path / "out" / "sensitivity.csv").read_bytes()
    rows = list(csv.DictReader(table.decode().splitlines()))
    assert [row["setting"] for row in rows] == ["planner.goal_bias"] * 2 and rows[0]["pairs"] == "2"
    shards = sorted((tmp_path / "out" / "rows").glob("*"))
    assert len(shards) == 1 and not list((tmp_path / "out").glob("*/row.json"))
    assert main(words) == 0 and (tmp_path / "out" / "sensitivity.csv").read_bytes() == table
    assert sorted((tmp_path / "out" / "rows").glob("*")) == shards
    content = json.loads((tmp_path / "out" / "sensitivity.json").read_text())
    picture = sensitivity_picture(content["effects"], "same", tmp_path / "again.png").read_bytes()
    assert sensitivity_picture(content["effects"], "same", tmp_path / "once.png").read_bytes() == picture
    assert "settings of planner=rrt matter here" in capsys.readouterr().out


def test_a_recording_that_is_refused_ends_the_question_before_any_setting_is_tried():
    """Else it would count for nothing, and nobody be told."""
    asked = ask(["odometry=orb", "world=square_small", "seed=0"], only=["ratio"],
                recordings=[sensitivity.recording("views source.camera=tum_fr1")])
    assert [job.config.source.settings.path for job in asked.recorded] == ["views"] and len(asked.pairs) == 2
    with pytest.raises(ConfigError, match=r"--recording 'PATH source.KEY=VALUE': views: no such file"):
        check_recorded([{"status": "refused", "reason": "views: no such file"}])
    check_recorded([{"status": "ok"}, {"status": "failed"}])


def test_a_source_of_somebody_else_is_not_given_settings_of_the_simulator():
    said = [{word.key for word in words} for given in ([], ["source=mine"])
            for _, words in sensitivity._runs("survey", ["odometry=wheel", "world=square_small", *given], [])]
    assert "source.image_width" in said[0] and "source.image_width" not in said[-1]
