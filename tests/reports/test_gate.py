"""The gate's verdicts: how often it is wrong, how soon it is sure, and by hand."""

import numpy as np
import pytest

from rhs.reports.gate import ERROR, error_parts, judge, looks, most_lost

NAN = float("nan")


def verdict(ratios, **more):
    old = [1.0] * len(ratios)
    return judge(old, list(ratios), [(True, True)] * len(ratios), **({"margin": 0.02} | more))


def gated(rng, loss, spread, pairs=20):
    """(verdict, pairs needed) of a change that makes the measure worse by `loss`."""
    ratios = (1.0 + loss) * np.exp(spread * rng.standard_normal(pairs))
    for count, level in zip(looks(pairs), error_parts(looks(pairs)), strict=True):
        found = verdict(ratios[:count], level=level)
        if found.word != "needs more runs":
            break
    return found.word, count


def test_looks_end_with_the_last_pair():
    assert looks(20) == [4, 6, 9, 14, 20] and looks(4) == [4]
    assert sum(error_parts(looks(20))) == pytest.approx(ERROR)


@pytest.mark.parametrize("spread", [0.03, 0.1])
def test_a_loss_of_a_tenth_is_found_within_twenty_pairs(spread):
    """Spread: of the logarithm of the ratio between pairs."""
    rng = np.random.default_rng(1)
    words = [gated(rng, 0.10, spread)[0] for _ in range(200)]
    assert words.count("worse") >= 190
    assert "better" not in words


def test_no_change_is_called_worse_or_better_in_one_of_twenty():
    rng = np.random.default_rng(2)
    words = [gated(rng, 0.0, 0.1)[0] for _ in range(400)]
    assert words.count("worse") + words.count("better") <= 0.05 * 400 + 3 * np.sqrt(400 * 0.05 * 0.95)


@pytest.mark.parametrize(("spread", "most"), [(0.01, 0.02), (0.03, 0.15)])
def test_a_loss_within_the_margin_is_seldom_called_worse(spread, most):
    """A loss of 1 % where 2 % are allowed; any sure loss was called worse before: 64 and 21 of 100 such gates."""
    rng = np.random.default_rng(3)
    words = [gated(rng, 0.01, spread)[0] for _ in range(300)]
    assert words.count("worse") <= most * 300
    assert verdict([1.001, 1.002] * 10).word == "no worse"


def test_how_many_successes_may_be_lost_by_hand():
    """Of four pairs none shows it with a chance of (1 - share)^4: 0.025 at a share of 60 %, 0.005 at 73 %."""
    assert verdict([1.0] * 4).lost_at_most == pytest.approx(0.602, abs=1e-3)
    assert verdict([1.0] * 4, level=0.01).lost_at_most == pytest.approx(0.734, abs=1e-3)
    assert most_lost(3, 2, 40, 0.05) == pytest.approx(0.2039 - 0.0061, abs=1e-4)  # the two-sided 95 % tables of 3, 2 of 40


def test_equal_runs_are_no_worse_once_so_many_successes_cannot_be_lost():
    """A loss of a tenth of all runs is missed by four pairs with a chance of two thirds, by twenty with an eighth."""
    few = verdict([1.0] * 4)
    assert (few.word, few.change, few.pairs, few.exit_code) == ("needs more runs", 0.0, 4, 3)
    assert verdict([1.0] * few.needed).word == "no worse" != verdict([1.0] * (few.needed - 1)).word
    assert verdict([1.0] * 4, lost_margin=0.61).word == "no worse" and verdict([1.0] * 20).exit_code == 0


@pytest.mark.parametrize("success", [1.0, 0.7, 0.4])
def test_a_loss_of_more_successes_than_allowed_is_seldom_called_no_worse(success):
    """Of the old successes; nothing else changes."""
    rng, words = np.random.default_rng(4), []
    for _ in range(300):
        old = rng.random(20) < success
        new = old & (rng.random(20) < 1.0 - 0.2 / success)
        words.append(judge(np.where(old, 1.0, NAN), np.where(new, 1.0, NAN), list(zip(old, new, strict=True)),
                           margin=0.02).word)
    assert words.count("no worse") <= 0.05 * 300


def test_a_sum_in_another_order_is_no_change():
    """A planner without randomness gives one length for every seed, and its interval has no width."""
    assert verdict([1.0 - 1e-15] * 20).word == verdict([1.0 + 1e-15] * 20).word == "no worse"
    assert verdict([np.inf, 1.0, 1.0, 1.0, 1.0]).pairs == 4


def test_four_ratios_by_hand():
    """Mean log 0.1, standard error 0, so worse by exp(0.1) - 1."""
    found = verdict([np.exp(0.1)] * 4)
    assert found.word == "worse" and found.change == pytest.approx(0.10517, abs=1e-5) and found.exit_code == 1


def test_of_some_figures_more_is_better():
    """A tenth less of what is good is a loss, a tenth more is none; a fall by 1.9 % is within the margin of 2."""
    fallen = verdict([0.9] * 4, more_is_better=True)
    assert fallen.word == "worse" and fallen.change == pytest.approx(-0.1)
    spread = verdict([0.9, 0.88, 0.92, 0.9, 0.9], more_is_better=True)
    assert spread.low < spread.change < spread.high < 0.0
    assert verdict([1.1] * 4, more_is_better=True).word == "better"
    assert verdict([0.981] * 20, more_is_better=True).word == "no worse"
    assert verdict([0.97] * 4, more_is_better=True).word == "worse"


def test_lost_successes_count_whatever_the_measure_says():
    old, new = [1.0] * 12, [0.5] * 4 + [NAN] * 8
    found = judge(old, new, [(True, True)] * 4 + [(True, False)] * 8, margin=0.02)
    assert (found.word, found.lost, found.won) == ("worse", 8, 0)  # 8 of 8: p = 1/256
    few = judge(old, new, [(True, True)] * 9 + [(True, False)] * 3, margin=0.02)
    assert few.word == "needs more runs" and few.exit_code == 3


def test_an_open_question_says_how_many_pairs_would_settle_it():
    found = verdict([0.8, 1.25, 0.9, 1.1, 1.02])
    assert found.word == "needs more runs" and found.needed > 5


def test_pairs_that_would_settle_it_are_those_that_are_driven():
    """All four broke off: one more, not the first that has a measure."""
    assert judge([1.0] * 4, [NAN] * 4, [(True, False)] * 4, margin=0.02).needed == 5
    ratios = [0.8, 1.25, 0.9, 1.1, 1.02]
    half_known = judge([1.0] * 5 + [NAN] * 5, [*ratios, *[NAN] * 5], [(True, True)] * 5 + [(False, False)] * 5, margin=0.02)
    assert half_known.needed == pytest.approx(2 * verdict(ratios).needed, abs=1)
