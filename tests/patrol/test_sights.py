"""The pictures a patrol keeps of its survey: every so many, never more than the bound; and what it says with none."""

import numpy as np
from helpers.synthetic_run import make_steps

from rhs.api.records import FeatureSettings
from rhs.patrol import sights as module
from rhs.patrol.sights import Sights


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
