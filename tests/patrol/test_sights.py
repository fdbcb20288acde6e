"""The pictures a patrol keeps of its survey: every so many, never more than the bound; and what it says with none."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.synthetic_run import make_steps

from rhs.api.errors import ConfigError
from rhs.api.geometry import se2
from rhs.api.records import BeliefStatus, FeatureSettings
from rhs.estimation.views.changes import Change
from rhs.patrol import sights as module
from rhs.patrol.sights import Sights, check_looks, confirmed


def test_every_third_picture_is_kept_and_beyond_the_bound_every_sixth(monkeypatch):
    sights = Sights(3, FeatureSettings())
    assert len(list(sights.watch(make_steps(10)))) == 10
    assert sorted(sights.kept) == [0, 3, 6, 9]
    monkeypatch.setattr(module, "MOST", 3)
    bounded = Sights(3, FeatureSettings())
    list(bounded.watch(make_steps(20)))
    assert len(bounded.kept) <= 3 and all(number % bounded.every == 0 for number in bounded.kept)


def test_a_place_that_no_picture_shows_is_not_compared(tmp_path):
    step = next(iter(make_steps(2)))
    sights = Sights(3, FeatureSettings())
    sights.compare(step, "01_east", tmp_path / "places_before", rng=np.random.default_rng(0))
    assert [(row["picture"], row["before"], row["changes"]) for row in sights.rows] == [("01_east", [], [])]
    assert not (tmp_path / "places_before").exists()


def _change(verdict, x_m, y_m, pixels=100):
    return Change(verdict, np.zeros((3, 3)), 0.3, 0.3, np.array([x_m, y_m, 0.2]), pixels)


def test_on_the_way_one_look_is_not_believed_and_two_tell_a_thing_once():
    """Looks 0 and 2 see one thing that is gone, 40 cm apart, look 2 more of it; look 1 alone sees something new, looks 0
    and 1 something that only looks different."""
    looks = [[_change("gone", 1.0, 1.0, 80), _change("looks different", 5.0, 5.0)],
             [_change("new", 3.0, 1.0), _change("looks different", 5.0, 5.0)],
             [_change("gone", 1.4, 1.0, 90)]]
    assert confirmed(looks, []) == {2: [looks[2][0]]}
    at_a_place = {"verdict": "gone", "at_m": [1.2, 1.2, 0.3]}
    assert confirmed(looks, [at_a_place]) == {}
    assert confirmed([*looks, [_change("new", 3.0, 1.6)]], [at_a_place]) == {}  # 60 cm apart: two things, each seen once


@pytest.mark.parametrize("look_m", [0.0, 0.5])
def test_a_look_is_due_half_a_metre_or_45_degrees_on_where_the_robot_is_sure(look_m, monkeypatch):
    sights = Sights(3, FeatureSettings(), look_m)
    sights.references = [object()]
    monkeypatch.setattr(module, "_complete", lambda observation: True)
    monkeypatch.setattr(sights, "_compared", lambda step, row, rng, then: lambda: row)
    step = next(iter(make_steps(1)))
    poses = [(0.0, 0), (0.3, 0), (0.55, 0), (0.6, 50), (1.2, 50)]
    for number, (x_m, turn_deg) in enumerate(poses):
        belief = replace(step.belief, map_from_body=se2(x_m, 0.0, np.radians(turn_deg)), status=BeliefStatus.TRACKING)
        sights.look(replace(step, index=number, belief=belief), seed=0)
        lost = replace(belief, map_from_body=se2(x_m, 9.0, 0.0), status=BeliefStatus.LOST)
        sights.look(replace(step, index=number + 100, belief=lost), seed=0)
    assert [look()["index"] for look in sights._looks] == ([0, 2, 3, 4] if look_m else [])


def test_looks_of_a_sensor_without_depth_are_refused():
    check_looks(0.5, {"image", "depth", "scan"})
    with pytest.raises(ConfigError, match="found gray, image; type sensor=rgbd"):
        check_looks(0.5, {"image", "gray"})
