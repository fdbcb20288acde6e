"""The gate's verdicts: how often it is wrong, how soon it is sure, and by hand."""

import numpy as np
import pytest

from rhs.reports.gate import ERROR, error_parts, judge, looks

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
    assert verdict([1.001, 1.002, 1.001, 1.002, 1.001, 1.002]).word == "no worse"


def test_what_strikes_few_runs_may_not_show():
    """Of four pairs none shows it with a chance of (1 - share)^4; 0.05 at a share of 53 %, 0.01 at 68 %."""
    assert verdict([1.0] * 4).unseen == pytest.approx(0.527, abs=1e-3)
    assert verdict([1.0] * 4, level=0.01).unseen == pytest.approx(0.684, abs=1e-3)


def test_equal_runs_are_no_worse_at_the_first_look():
    found = verdict([1.0] * 4)
    assert (found.word, found.change, found.pairs, found.exit_code) == ("no worse", 0.0, 4, 0)


def test_a_sum_in_another_order_is_no_change():
    """A planner without randomness gives one length for every seed, and its interval has no width."""
    assert verdict([1.0 - 1e-15] * 6).word == verdict([1.0 + 1e-15] * 6).word == "no worse"
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
    assert verdict([0.981] * 4, more_is_better=True).word == "no worse"
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
