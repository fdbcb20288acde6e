"""The card: honest and dishonest parts by hand-made errors, the page, the command."""

from __future__ import annotations

import json
from dataclasses import dataclass
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse, se2
from rhs.api.records import Belief, BeliefStatus, Motion, Tracking
from rhs.card import laps, localisers, odometries, page, planners
from rhs.card.card import card_of, verdict
from rhs.card.forked import ForkResult
from rhs.card.laps import Seen
from rhs.card.page import page_of
from rhs.card.questions import questions
from rhs.cli.card import main, part_of
from rhs.config import registry
from rhs.testing.room import HALL, SHORT, drive

NONE = frozenset()


def driven(sigma_m: float, claimed_m: float, claimed_rad: float | None = None, count: int = 4000) -> odometries.Driven:
    """Motions whose errors are of sigma_m (and as many radians) and whose covariance says claimed_m, and claimed_rad."""
    errors = sigma_m * np.random.default_rng(0).standard_normal((count, 3))
    normal = (errors / [claimed_m, claimed_m, claimed_rad or claimed_m]) ** 2
    apart = np.stack([normal[:, :2].mean(axis=1), normal[:, 2]], axis=1)
    return odometries.Driven("room", errors, normal.sum(axis=1), np.ones(count, bool), 0.01, np.ones(count), apart)


@pytest.mark.parametrize(("claimed_m", "claimed_rad", "says"), [
    (0.01, None, []), (0.05, None, []), (0.0025, None, []), (1.0, 0.01, ["position 100"]), (0.01, 0.573, ["turn 57"]),
    (1.0, 1.0, ["position 100", "turn 100"])])
def test_a_covariance_that_is_many_times_too_wide_is_said(claimed_m, claimed_rad, says):
    """0.573 is a hundredth of a radian in degrees."""
    wide = odometries.figures(ForkResult([driven(0.01, claimed_m, claimed_rad)]))
    said = verdict({"part": "odometry=mine", "contract": [], "figures": {"odometry=mine": wide}})
    assert [one.partition("error of its ")[2].partition(" times")[0] for one in said if "as wide as it is" in one] == says


def test_an_honest_covariance_holds_95_of_100_errors_and_a_third_of_it_does_not():
    honest = odometries.figures(ForkResult([driven(0.01, 0.01)]))
    assert honest["nees"] == pytest.approx(1.0, abs=0.04) and honest["within_95_share"] == pytest.approx(0.95, abs=0.012)
    sure = odometries.figures(ForkResult([driven(0.03, 0.01)]))
    assert sure["nees"] == pytest.approx(9.0, rel=0.05) and sure["within_95_share"] < 0.2
    assert sure["error_m"] == pytest.approx(0.03 * np.sqrt(2), rel=0.05)
    said = verdict({"part": "odometry=mine", "contract": [], "figures": {"odometry=mine": sure}})
    assert any("too sure of itself" in one for one in said)


def believed(offset_m: float, probability: float, sure: bool) -> localisers.Patrolled:
    """100 views, all believed offset_m ahead of the truth."""
    views = [Seen(observation, pose) for pose, observation in drive(HALL, SHORT)] * 12
    status = BeliefStatus.TRACKING if sure else BeliefStatus.LOST
    said = [Belief(one.world_from_body @ se2(offset_m, 0.0, 0.0), np.diag([0.1] * 6) ** 2, status, probability)
            for one in views]
    return localisers.judged("room", views, said, np.ones(len(views)))


@pytest.mark.parametrize(("offset_m", "probability", "sure", "wrong_sure", "ece"), [
    (0.1, 1.0, True, 0.0, 0.0), (0.5, 1.0, True, 1.0, 1.0), (0.5, 0.3, False, 0.0, 0.3)])
def test_wrong_and_sure_and_the_stated_chances(monkeypatch, offset_m, probability, sure, wrong_sure, ece):
    one = believed(offset_m, probability, sure)
    one.beliefs.kidnapped[5] = True
    found = localisers.figures(ForkResult([one]))
    assert found["wrong_sure_share"] == wrong_sure and found["ece"] == pytest.approx(ece)
    assert found["right_share"] == (offset_m < 0.25)
    if sure:  # one of three dimensions is offset_m / 0.1 sigmas off
        assert found["nees"] == pytest.approx((offset_m / 0.1) ** 2 / 3)


def test_a_robot_that_is_carried_stands_elsewhere_and_no_motion_says_so():
    views = localisers.patrol(HALL, 1)
    carried = [k for k, one in enumerate(views) if one.carried]
    assert carried == [28, 56] and [one.observation.index for one in views] == list(range(84))
    for k in carried:
        jump = np.linalg.norm((inverse(views[k - 1].world_from_body) @ views[k].world_from_body)[:2, 3])
        assert jump > 1.5
    steps = [np.linalg.norm((inverse(a.world_from_body) @ b.world_from_body)[:3, 3])
             for a, b in zip(views, views[1:], strict=False) if not b.carried]
    assert max(steps) == pytest.approx(laps.AHEAD_M)


def test_a_dial_breaks_where_less_than_half_is_left():
    levels = (None, ("a", 1.0, 0.5), ("b", 1.0, 0.9), ("a", 2.0, 0.39), ("b", 2.0, 0.5), ("a", 3.0, 0.0))
    rows = laps.breaks_at([SimpleNamespace(level=level) for level in levels], 0.8)
    assert [row["breaks_at"] for row in rows] == [2.0, None]
    told = page._breaks({"breaks": rows + laps.breaks_at([SimpleNamespace(level=("c", 1.0, 0.0))], 0.0)})
    assert [row[1] for row in told["rows"]] == ["2", "holds", "never right"]


@dataclass
class Blind:
    """An odometry that has never moved and is sure of it."""

    needs: ClassVar[frozenset[str]] = NONE
    provides: ClassVar[frozenset[str]] = NONE

    def build(self, context):
        return self

    def update(self, observation):
        return Motion(np.eye(4), np.diag([1e-4] * 6) ** 2, Tracking.OK)

    def revise(self):
        return None


def test_the_card_of_an_odometry_that_never_moves(monkeypatch):
    monkeypatch.setattr(odometries, "DRIVES", {"room": (HALL, SHORT)})
    monkeypatch.setattr("rhs.card.card.REFERENCES", {"odometry": ("wheel",)})
    monkeypatch.setattr(laps, "DIALS", {"side_light": ("side_share", (0.6,))})
    card = card_of("odometry", "blind", Blind())
    assert not card.passes and any(one.startswith("breaks its contract") for one in card.content["verdict"])
    assert card.content["figures"]["odometry=blind"]["drift_pct"] == pytest.approx(100.0, abs=1.0)
    assert card.content["figures"]["odometry=wheel"]["drift_pct"] < 5.0
    page = page_of(card)
    assert "Card of odometry=blind" in page and page.count("data:image/png;base64") == 2 and 'src="http' not in page


def test_the_card_of_a_planner_is_the_same_again_but_for_times(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(planners, "asked", lambda: few)
    monkeypatch.setattr("rhs.card.card.REFERENCES", {"planner": ("theta_star",)})
    few = tuple(questions(of_each=1))
    assert main(["planner=astar", f"output={tmp_path}"]) == 0
    content = json.loads((tmp_path / "card.json").read_text())
    assert (tmp_path / "card.html").read_text().startswith("<!doctype html>")
    assert list(content["figures"]) == ["planner=astar", "planner=theta_star"] and content["answers"] > 12
    again = planners.figures(ForkResult(list(planners.work(registry.load("planner", "astar")()))))
    first = content["figures"]["planner=astar"]
    assert all(first[name] == value for name, value in again.items() if not name.endswith(("_ms", "_mb")))
    assert "no fault in" in capsys.readouterr().out


def test_a_part_without_a_standard_set_has_its_contract():
    card = card_of("degrade", "side_light", registry.load("degrade", "side_light")())
    assert card.passes and card.content["verdict"] == [f"keeps its contract ({len(card.content['contract'])} checks)"]
    assert "figures" not in card.content and "FAILS" not in page_of(card)


@pytest.mark.parametrize(("words", "says"), [
    ([], "say which part"), (["world=square"], "world=square is no part"), (["planner=astarr"], "did you mean astar"),
    (["task=patrol"], "task=patrol is no part whose contract can be checked"),
    (["planner=prm", "samples=3"], "expected settings of planner=prm"),
    (["planner=prm", "planner.link=3"], "did you mean planner.links"),
    (["planner=prm,rrt"], "several values")])
def test_what_cannot_have_a_card_is_refused_in_one_line(words, says):
    with pytest.raises(ConfigError, match=says):
        part_of(words, "card")


def test_nested_settings_reach_the_part():
    kind, name, settings = part_of(["localiser=sift_db", "localiser.advanced.places.tie=0.2"], "check")
    assert (kind, name) == ("localiser", "sift_db") and settings.advanced.places.tie == 0.2


def test_a_task_has_no_card():
    with pytest.raises(ConfigError, match="a task has no card"):
        card_of("task", "patrol", registry.load("task", "patrol")())
