"""A survey whose odometry had nothing to follow says what to type instead."""

from types import SimpleNamespace

import pytest

from rhs.api.records import Tracking
from rhs.config import registry
from rhs.config.parts import Chosen, spoiling_pictures
from rhs.patrol.job import saw_nothing


def _said(lost: int, *, provides: frozenset[str] = frozenset({"depth"}), odometry: str = "odometry=keyframe",
          **who: str) -> str:
    views = [SimpleNamespace(motion=SimpleNamespace(status=Tracking.LOST if k < lost else Tracking.OK)) for k in range(10)]
    return saw_nothing(views, SimpleNamespace(provides=provides, who={"odometry": odometry, **who}))


def test_a_survey_by_the_wheels_alone_names_a_sensor_and_an_odometry_that_go_by_walls():
    said = _said(6)
    assert "nothing to follow in 6 of 10 views" in said and "sensor=laser" in said and "odometry=fused" in said


@pytest.mark.parametrize("said", [_said(5), _said(10, provides=frozenset({"image"}))])
def test_one_that_followed_half_of_its_views_or_has_one_eye_says_nothing(said):
    assert said == ""


def test_who_goes_by_walls_already_is_not_told_to():
    assert "odometry=fused" not in _said(6, odometry="odometry=fused (rhs)")


def test_a_degradation_that_was_typed_is_named_instead_of_a_guess_about_the_building():
    said = _said(6, degrade="degrade=low_light")
    assert "its pictures were spoiled by degrade=low_light" in said and "without it a run shows" in said
    assert "surfaces without a pattern" not in said and "sensor=laser" not in said  # a laser refuses that degradation


@pytest.mark.parametrize(("typed", "named"), [("low_light", "low_light"), ("mounting+wheel_slip", "mounting"),
                                                ("wheel_slip", "")])
def test_only_a_degradation_of_pictures_is_one_that_spoils_them(typed, named):
    assert spoiling_pictures({"degrade": Chosen(typed, registry.load("degrade", typed)())}) == named
    assert spoiling_pictures({}) == ""
