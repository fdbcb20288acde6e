"""Intervals against scipy and statsmodels, by hand, and by how often they hold the truth."""

import numpy as np
import pytest
import statsmodels.api as statsmodels
from scipy import stats

from rhs.reports.intervals import (
    holm,
    interval_rank,
    least_p,
    mean_interval,
    mean_text,
    median_interval,
    median_text,
    share_interval,
    share_text,
    signed_rank_p,
    units,
)

DRAWS = 3000
LEAST_COVERAGE = 0.93
SOURCES = {  # name -> (draws of a generator, true mean)
    "normal": (lambda rng, n: rng.normal(0.0, 1.0, n), 0.0),
    "normal, far from zero": (lambda rng, n: rng.normal(5.0, 1.0, n), 5.0),
    "lognormal, times that spread by 1.35": (lambda rng, n: rng.lognormal(0.0, 0.3, n), np.exp(0.045)),
    "lognormal, times that spread by 1.65": (lambda rng, n: rng.lognormal(0.0, 0.5, n), np.exp(0.125)),
    "lognormal, times that spread by 2.2": (lambda rng, n: rng.lognormal(0.0, 0.8, n), np.exp(0.32)),
    "exponential": (lambda rng, n: rng.exponential(1.0, n), 1.0),
    "uniform": (lambda rng, n: rng.random(n), 0.5),
}


def coverage(intervals, truth: float) -> float:
    return float(np.mean([low <= truth <= high for low, high in intervals]))


@pytest.mark.parametrize("count", [3, 5, 10, 30])
@pytest.mark.parametrize("name", SOURCES)
def test_an_interval_of_a_mean_holds_it_as_often_as_it_says(name, count):
    draw, truth = SOURCES[name]
    rng = np.random.default_rng(1)
    found = coverage((mean_interval(draw(rng, count)) for _ in range(DRAWS)), truth)
    assert found >= LEAST_COVERAGE, found


@pytest.mark.parametrize("worlds", [3, 5, 10])
def test_seeds_on_the_same_worlds_are_not_new_worlds(worlds):
    """Ten seeds a world, worlds twice as different as seeds: pooled runs hold the mean over worlds far too seldom."""
    rng = np.random.default_rng(2)
    label = np.repeat(np.arange(worlds), 10)
    clustered, pooled = [], []
    for _ in range(DRAWS):
        values = rng.normal(0.0, 1.0, worlds)[label] + rng.normal(0.0, 0.5, len(label))
        clustered.append(mean_interval(units(values, label)))
        pooled.append(mean_interval(values))
    assert coverage(clustered, 0.0) >= LEAST_COVERAGE and coverage(pooled, 0.0) < 0.7


@pytest.mark.parametrize("count", [3, 5, 10, 30, 100])
@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5, 0.8, 0.97])
def test_an_interval_of_a_share_holds_it_for_every_share(share, count):
    """Exact, by the probability of every outcome; Wilson's falls to 86 % at 3 runs and a share of 5 %."""
    wins = np.arange(count + 1)
    intervals = [share_interval(np.arange(count) < k) for k in wins]
    held = [low <= share <= high for low, high in intervals]
    assert stats.binom.pmf(wins, count, share)[held].sum() >= 0.95


@pytest.mark.parametrize("worlds", [5, 10, 20])
def test_an_interval_of_a_share_over_worlds_of_unlike_difficulty(worlds):
    rng = np.random.default_rng(3)
    label = np.repeat(np.arange(worlds), 10)
    clustered, pooled = [], []
    for _ in range(1000):
        done = rng.random(len(label)) < rng.beta(2.0, 1.0, worlds)[label]
        clustered.append(share_interval(done, label))
        pooled.append(share_interval(done))
    assert coverage(clustered, 2 / 3) >= LEAST_COVERAGE > 0.85 > coverage(pooled, 2 / 3)


def test_the_t_interval_is_scipys():
    values = np.array([-1.0, 0.5, 2.0, 3.5])
    wanted = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert mean_interval(values) == pytest.approx((wanted.low, wanted.high), rel=1e-12)


def test_positive_values_have_the_hull_of_t_and_cox():
    values = np.array([10.0, 12.0, 30.0])
    logs, reach = np.log(values), stats.t.ppf(0.975, 2)
    variance = logs.var(ddof=1)
    half = reach * np.sqrt(variance / 3 + variance**2 / 8)
    low, high = mean_interval(values)
    assert high == pytest.approx(np.exp(logs.mean() + variance / 2 + half))
    assert low == pytest.approx(stats.ttest_1samp(values, 0.0).confidence_interval(0.95).low)
    beside_zero = np.array([1e-9, 5.0, 6.0])  # logarithms say nothing of these
    assert mean_interval(beside_zero)[1] == pytest.approx(stats.ttest_1samp(beside_zero, 0.0).confidence_interval(0.95).high)


@pytest.mark.parametrize("sizes", [(1, 1, 1, 10), (2, 3, 5, 10, 20), (1, 1, 1, 1, 1, 30)])
def test_worlds_of_which_unlike_numbers_of_runs_are_known_count_alike(sizes):
    """Weighed by their runs, with the cluster-robust variance (CR1) of statsmodels, such intervals hold the mean over worlds
    in 70, 86 and 27 of 100 draws."""
    rng, label, ours, weighed = np.random.default_rng(4), np.repeat(np.arange(len(sizes)), sizes), [], []
    for draw in range(DRAWS):
        values = rng.normal(0.0, 1.0, len(sizes))[label] + rng.normal(0.0, 0.5, len(label))
        ours.append(mean_interval(units(values, label)))
        if draw < 300:
            plain = statsmodels.OLS(values, np.ones(len(values)))
            weighed.append(plain.fit(cov_type="cluster", use_t=True, cov_kwds={"groups": label}).conf_int()[0])
    assert coverage(ours, 0.0) >= LEAST_COVERAGE > 0.9 > coverage(weighed, 0.0)


def test_a_share_over_worlds_is_the_mean_of_their_shares():
    done, label = np.array([0.0, *[1.0] * 9]), np.array([0, *[1] * 9])
    assert share_text(done, label) == "0.50" and share_text(done).startswith("0.90 [")


def test_clusters_give_their_means():
    np.testing.assert_allclose(units(np.array([1.0, 3.0, 10.0, 20.0]), np.array(["a", "a", "b", "b"])), [2.0, 15.0])
    np.testing.assert_allclose(units(np.array([1.0, 3.0, 10.0]), np.array(["a", "a", "b"])), [2.0, 10.0])


@pytest.mark.parametrize(("wins", "count"), [(0, 3), (3, 3), (2, 3), (5, 10), (10, 10), (29, 30)])
def test_the_share_is_clopper_and_pearsons(wins, count):
    from statsmodels.stats.proportion import proportion_confint

    found = share_interval(np.arange(count) < wins)
    assert found == pytest.approx(proportion_confint(wins, count, method="beta"), nan_ok=False)
    exact = stats.binomtest(wins, count).proportion_ci(method="exact")
    assert found == pytest.approx((exact.low, exact.high))


def test_holm_is_statsmodels_and_by_hand():
    from statsmodels.stats.multitest import multipletests

    # sorted 0.01 0.02 0.03 times 3, 2, 1, never falling
    np.testing.assert_allclose(holm(np.array([0.03, 0.01, np.nan, 0.02])), [0.04, 0.03, np.nan, 0.04])
    for seed in range(20):
        p = np.random.default_rng(seed).random(7) ** 3
        np.testing.assert_allclose(holm(p), multipletests(p, method="holm")[1])


@pytest.mark.parametrize("count", [2, 3, 5, 6, 10, 12])
def test_the_least_p_is_what_scipy_says_when_all_differences_agree(count):
    assert signed_rank_p(np.arange(1.0, count + 1.0)) == pytest.approx(least_p(count))
    assert stats.binomtest(count, count).pvalue == pytest.approx(least_p(count))
    assert (least_p(count) > 0.05) == (count < 6)


@pytest.mark.parametrize("count", [2, 5, 8, 30])
def test_the_signed_rank_test_is_scipys(count):
    rng = np.random.default_rng(6)
    for _ in range(5):
        ties = rng.integers(-3, 4, count).astype(float)
        for values in (rng.normal(0.3, 1.0, count), *([ties] if count < 10 and (ties != 0).sum() > 1 else [])):
            assert signed_rank_p(values) == pytest.approx(stats.wilcoxon(values[values != 0]).pvalue, abs=1e-12)


def test_the_signed_rank_test_holds_its_level_with_ties():
    """Whole numbers, as places visited; scipy takes a second for each 13 of them."""
    rng = np.random.default_rng(7)
    for count in (13, 20, 60):
        assert np.mean([signed_rank_p(rng.integers(-2, 3, count).astype(float)) < 0.05 for _ in range(500)]) <= 0.07


def test_the_interval_of_a_median_is_the_sign_tests():
    """Known ranks: six values hold it between the least and the largest (1 - 2/64), 30 between the 10th and the 21st."""
    assert [interval_rank(n) for n in (1, 5, 6, 10, 20, 30)] == [None, None, 0, 1, 5, 9]
    rng = np.random.default_rng(5)
    for count in (6, 10, 30):
        assert coverage((median_interval(rng.lognormal(0.0, 1.0, count)) for _ in range(DRAWS)), 1.0) >= 0.94


def test_two_values_have_a_range_and_equal_ones_have_nothing():
    assert mean_text(np.array([1.0, 3.0])) == "2 (1 to 3)"
    assert mean_text(np.array([1.0, 3.0, np.nan])) == "2 (1 to 3)"
    assert mean_text(np.array([4.0] * 30)) == "4"
    assert mean_text(np.array([0.1 + 0.2, 0.3, 0.3])) == "0.3"  # rounding is no spread
    assert mean_text(np.array([np.nan])) == "-"
    assert mean_text(np.array([1.0, 2.0, 3.0])).startswith("2 [")
    assert mean_text(np.array([1.0, 2.0, 5.0, 8.0]), np.array(["a", "a", "b", "b"])) == "4 (1 to 8)"  # two worlds
    assert median_text(np.array([1.0, 2.0, 30.0])) == "2 (1 to 30)"
    assert share_text(np.array([1.0, 0.0])) == "0.50" and share_text(np.array([np.nan])) == "-"
    assert share_text(np.ones(10), factor=100) == "100 [69, 100]"
