"""Break points: laws of the posterior, curves whose threshold is known, and how near 40 runs come to it."""

import numpy as np
import pandas as pd
import pytest

from rhs.metrics.threshold import Dial, Posterior, between_seeds, dial_between, fit, in_words
from rhs.reports.summary import thresholds


def chance(level, threshold, slope, lapse, direction=1):
    """Success at a level: half at the threshold, whatever the lapses."""
    return (1 - lapse) / (1 + (1 - 2 * lapse) * np.exp(np.clip(direction * (level - threshold) / slope, -60, 60)))


def searched(rng, threshold, slope, lapse, direction, runs):
    known = Posterior()
    while known.runs < runs:
        for level in known.next_levels(2):
            known.learn(level, rng.random() < chance(level, threshold, slope, lapse, direction))
    return known.summary()


def test_forty_runs_come_within_a_twentieth_of_the_dial_in_nine_of_ten():
    rng = np.random.default_rng(5)
    off, held = [], 0
    for _ in range(30):
        truth, slope = rng.uniform(0.1, 0.9), np.exp(rng.uniform(np.log(0.01), np.log(0.15)))
        found = searched(rng, truth, slope, rng.choice([0.0, 0.05]), rng.choice([1, -1]), runs=40)
        off.append(abs(found.middle - truth))
        held += found.low <= truth <= found.high
    assert np.mean(np.array(off) <= 0.05) >= 0.9
    assert held >= 26  # 95 % of 30 is 28.5; fewer than 26 has a chance of 1 in 60


def test_on_a_flat_curve_forty_runs_are_too_few_and_as_many_as_are_said_are_enough():
    """Forty runs know a slope of 0.15 to 2 x 0.15 / sqrt(40) = 0.047 of the dial at best (Cramer and Rao)."""
    rng = np.random.default_rng(3)
    few = [searched(rng, 0.6, 0.15, 0.0, -1, runs=40) for _ in range(20)]
    needed = int(np.median([found.runs_needed for found in few]))
    assert 80 <= needed <= 160
    many = [searched(rng, 0.6, 0.15, 0.0, -1, runs=needed) for _ in range(20)]
    assert np.mean([abs(found.middle - 0.6) <= 0.05 for found in many]) >= 0.8
    assert searched(rng, 0.6, 0.03, 0.0, -1, runs=40).runs_needed <= 40


def test_a_steep_threshold_is_not_moved_by_the_grid():
    """A slope of half a cell of the grid: the interval held the truth in 48 of 60, all too low by half a cell, before each
    threshold stood for its cell."""
    rng = np.random.default_rng(7)
    found = [searched(rng, 0.5, 0.005, 0.0, 1, runs=40) for _ in range(30)]
    assert abs(np.mean([one.middle for one in found]) - 0.5) < 0.0025
    assert sum(one.low <= 0.5 <= one.high for one in found) >= 26


@pytest.mark.parametrize(("success", "says"), [
    (lambda level: 0.3 < level < 0.7, "not one threshold"), (lambda level: 0.1 < level < 0.6, "not one threshold"),
    (lambda level: level < 0.4, "more above")])
def test_a_dial_that_is_good_in_its_middle_alone_is_not_called_bad_everywhere(success, says):
    """Both ends fail: a search that looked there alone said `fails nearly everywhere` of it."""
    known = Posterior()
    while known.runs < 40:
        for level in known.next_levels(2):
            known.learn(level, success(level))
    said = in_words(known.summary(), Dial("a", 0.0, 1.0))
    assert said.startswith("half fail at") and said.endswith(says)


def test_a_dial_that_does_nothing_is_seldom_given_a_threshold_without_a_word():
    rng = np.random.default_rng(5)
    idle = [searched(rng, 0.5, 1e9, 0.0, 1, runs=40) for _ in range(30)]
    real = [searched(rng, 0.5, 0.08, 0.0, 1, runs=40) for _ in range(30)]
    assert sum(one.found and not (one.idle or one.two_sided) for one in idle) <= 10  # 23 without these words
    assert sum(one.idle or one.two_sided for one in real) <= 2


def test_what_lies_beyond_the_dial_is_not_told_as_a_level_of_it():
    levels = np.repeat(np.linspace(0.0, 1.0, 11), 3)
    for edge in (levels < 0.99, (levels < 0.99) | (np.arange(33) == 31)):  # of three at the end three fail, or two
        said = in_words(fit(levels, edge).summary(), Dial("share", 0.0, 1.0))
        assert said.startswith("half fail at 0.9") and said.endswith("to above 1), more above")
    few = in_words(fit([0.0, 0.5, 1.0], [True] * 3).summary(), Dial("share", 0.0, 1.0))
    assert few.startswith("does not break from 0 to 1 (chance of a threshold between: ")


def test_an_interval_between_seeds_holds_the_threshold_where_a_seed_fails_everywhere_beyond_its_own_level():
    rng, held, as_if_independent = np.random.default_rng(2), 0, 0
    levels, seeds = np.tile(np.linspace(0, 1, 16), 10), np.repeat(np.arange(10), 16)
    for _ in range(30):
        truth, slope = rng.uniform(0.25, 0.75), np.exp(rng.uniform(np.log(0.03), np.log(0.12)))
        own = truth + slope * np.log(1 / rng.random(10) - 1)  # a logistic spread: half of the seeds fail at the truth
        succeeded = levels < np.repeat(own, 16)
        low, high = between_seeds(levels, succeeded, seeds)
        plain = fit(levels, succeeded).summary()
        held += low <= truth <= high
        as_if_independent += plain.low <= truth <= plain.high
    assert held >= 26 > as_if_independent
    assert np.isnan(between_seeds(levels[:48], succeeded[:48], seeds[:48])).all()  # three seeds


def test_half_succeed_at_the_threshold_of_every_curve():
    known = Posterior()
    curve = known.success(known._threshold[:50])
    assert np.diag(curve[:, :50]) == pytest.approx(0.5)


def test_no_run_yet_says_nothing_and_the_order_of_outcomes_does_not_matter():
    assert Posterior().summary().high - Posterior().summary().low > 1.0
    tried = [(0.2, True), (0.5, True), (0.6, False), (0.9, False)]
    one, other = fit(*zip(*tried, strict=True)).summary(), fit(*zip(*tried[::-1], strict=True)).summary()
    assert one.middle == pytest.approx(other.middle) and 0.5 < one.middle < 0.6 and one.direction == 1


def test_a_dial_on_which_nothing_fails_is_said_not_to_break():
    levels = list(np.linspace(0.0, 1.0, 20))
    dial = Dial("sensor.image_sigma", 0.0, 40.0)
    assert in_words(fit(levels, [True] * 20).summary(), dial) == "does not break from 0 to 40"
    assert in_words(fit(levels, [False] * 20).summary(), dial) == "fails nearly everywhere from 0 to 40"


@pytest.mark.parametrize("dial", [Dial("a", 2.0, 10.0), Dial("a", 1.0, 1000.0, True), Dial("a", 1.0, 100.0, False, True)])
def test_levels_and_values_are_one_another_back(dial):
    assert (dial.value(0.0), dial.value(1.0)) == (dial.low, dial.high)
    assert dial.level(dial.value(0.37)) == pytest.approx(0.37, abs=0.006)


def test_ends_far_apart_are_taken_on_the_logarithm():
    assert dial_between("a", 1.0, 100.0).value(0.5) == pytest.approx(10.0)
    assert dial_between("a", 0.0, 100.0).value(0.5) == 50.0


def test_a_plain_sweep_tells_its_break_point():
    values = np.repeat([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 4)
    table = pd.DataFrame({"planner": "prm", "sensor.image_sigma": values, "seed": range(24)})
    table["success"] = (values < 3.5).astype(float)
    (line,) = thresholds(table)
    assert line.startswith("sensor.image_sigma: half fail at 3.") and line.endswith("more above (24 runs)")
    (line,) = thresholds(table.assign(seed=np.tile(range(4), 6)))
    assert line.startswith("sensor.image_sigma: half fail at 3.") and line.endswith("), more above (24 runs of 4 seeds)")
    (line,) = thresholds(table.assign(seed=0))
    assert "(" not in line.partition("more above")[0]
    assert line.endswith("more above (24 runs of 1 seed, too few for an interval)")
    assert thresholds(table.assign(success=1.0)) == [] and thresholds(table[table["sensor.image_sigma"] < 4]) == []


def test_a_level_is_told_in_three_digits_without_a_power_of_ten_where_it_can_be():
    dial = Dial("iterations", 20.0, 4000.0)
    assert [dial.text(level) for level in (0.30151, 1.0, 1.1)] == ["1220", "4000", "above 4000"]
    assert Dial("share", 0.0, 1.0).text(0.01234) == "0.0123"
