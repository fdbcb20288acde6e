"""Shares from fewer patrols than there are combinations: how many, how far off, and that they still sum to the loss."""

import numpy as np
import pytest

from rhs.metrics.shares import bounds, middle, next_patrols, off_by, shapley, subsets

LINKS = ["odometry", "closing", "map", "localise"]
NOTHING = frozenset()


def driven(game, *, worth=0.5):
    """What is known in the end of a game: set of links -> loss."""
    known = {one: game[one] for one in (NOTHING, frozenset(LINKS))}
    while wanted := next_patrols(known, LINKS, worth=worth, alone=0.8):
        assert not set(wanted) & set(known)
        known |= {one: game[one] for one in wanted}
    return known


def lost_unless(*savers, places=3.0):
    """All places are missed unless one of these links is given the truth."""
    return {one: 0.0 if one & set(savers) else places for one in subsets(LINKS)}


def check(known, game):
    between = bounds(known, LINKS)
    told, exact, error = shapley(middle(known, LINKS), LINKS), shapley(game, LINKS), off_by(between, LINKS)
    assert sum(told.values()) == pytest.approx(game[NOTHING] - game[frozenset(LINKS)])
    assert all(low <= game[one] <= high for one, (low, high) in between.items())
    assert all(abs(told[link] - exact[link]) <= error[link] + 1e-9 for link in LINKS)
    assert max(error.values()) <= 0.25


@pytest.mark.parametrize("savers", [("localise",), ("map",), ("odometry", "localise"), ("closing", "odometry", "localise")])
def test_one_fault_takes_half_of_the_patrols(savers):
    game = lost_unless(*savers)
    known = driven(game)
    assert len(known) <= 8
    check(known, game)


def test_where_nothing_was_lost_two_patrols_say_so():
    assert len(driven(dict.fromkeys(subsets(LINKS), 0.0))) == 2


def test_where_every_link_costs_a_little_the_bounds_hold():
    rng = np.random.default_rng(3)
    for _ in range(20):
        cost = dict(zip(LINKS, rng.integers(0, 3, 4), strict=True))
        game = {one: float(sum(cost[link] for link in LINKS if link not in one)) for one in subsets(LINKS)}
        check(driven(game), game)


def test_a_truth_seen_to_make_it_worse_narrows_nothing():
    known = {NOTHING: 1.0, frozenset(["map"]): 3.0, frozenset(LINKS): 0.0}
    between = bounds(known, LINKS)
    assert between[frozenset(["map", "closing"])] == (0.0, 1.0) and between[frozenset(["map"])] == (3.0, 3.0)


def test_a_loss_nobody_knows_leaves_the_others_unknown():
    known = {NOTHING: float("nan"), frozenset(LINKS): 0.0}
    assert np.isnan(middle(known, LINKS)[frozenset(["map"])])
