"""Shapley shares by hand and by their axioms; the sentence; where a patrol went off; what complained first."""

from itertools import permutations

import numpy as np
import pytest

from rhs.metrics.blame import losses_of, off_since, shapley, shapley_of_orders, subsets, verdict, worst_link
from rhs.metrics.cause import first_complaints


def losses(**named):
    """`ab=1` is the loss with a and b true; `none` with nothing."""
    return {frozenset("" if name == "none" else name): value for name, value in named.items()}


def test_two_links_by_hand():
    shares = shapley(losses(none=3.0, a=1.0, b=2.0, ab=0.0), ["a", "b"])
    assert shares == {"a": 0.5 * ((3 - 1) + (2 - 0)), "b": 0.5 * ((3 - 2) + (1 - 0))}


def test_links_that_are_needed_together_share_alike():
    assert shapley(losses(none=1.0, a=1.0, b=1.0, ab=0.0), ["a", "b"]) == {"a": 0.5, "b": 0.5}


def test_a_truth_that_makes_it_worse_has_a_negative_share():
    assert shapley(losses(none=1.0, a=2.0, b=0.0, ab=0.0), ["a", "b"])["a"] < 0


@pytest.mark.parametrize("seed", range(5))
def test_the_axioms(seed):
    """Efficiency: the shares sum to what all links together take off. Dummy: a link that never matters has none."""
    rng, links = np.random.default_rng(seed), ["a", "b", "c", "d"]
    known = {chosen: float(rng.random()) for chosen in subsets(links)}
    known |= {chosen | {"e"}: value for chosen, value in known.items()}
    shares = shapley(known, [*links, "e"])
    assert sum(shares.values()) == pytest.approx(known[frozenset()] - known[frozenset([*links, "e"])])
    assert shares["e"] == pytest.approx(0.0, abs=1e-12)


def test_all_orders_give_the_exact_shares():
    rng, links = np.random.default_rng(1), ["a", "b", "c"]
    known = {chosen: float(rng.random()) for chosen in subsets(links)}
    sampled = shapley_of_orders(known, list(permutations(links)))
    assert {link: share for link, (share, _) in sampled.items()} == pytest.approx(shapley(known, links))


def test_sampled_shares_hold_the_exact_ones_within_three_standard_errors():
    rng, links = np.random.default_rng(2), list("abcdefg")
    known = {chosen: float(rng.random()) for chosen in subsets(links)}
    orders = [[links[k] for k in rng.permutation(7)] for _ in range(200)]
    exact = shapley(known, links)
    off = [abs(share - exact[link]) / error for link, (share, error) in shapley_of_orders(known, orders).items()]
    assert max(off) < 3.0


def step(index, error_m=0.0, phase="patrol", **told):
    return {"index": str(index), "phase": phase, "x_m": str(1.0 + error_m), "true_x_m": "1.0", "y_m": "2.0",
            "true_y_m": "2.0", "mission": "1", "event": "", "motion_status": "ok", "motion_reason": "",
            "belief_status": "tracking", "collided": "0"} | told


@pytest.mark.parametrize(("errors", "since"), [
    ([0.0, 0.1, 0.2], -1), ([0.0, 0.6, 0.1], -1), ([0.0, 0.6, 0.1, 0.7, 0.9], 3), ([0.9, 0.9], 0), ([], -1)])
def test_off_since_is_the_first_view_from_which_the_belief_did_not_come_back(errors, since):
    assert off_since([step(k, error) for k, error in enumerate(errors)]) == since


def test_the_survey_counts_for_nothing_there():
    assert off_since([step(0, 5.0, phase="survey")]) == -1


def test_the_sentence_names_links_by_what_they_cost():
    shares = {"places": {"map": 0.02, "localise": 2.0, "odometry": 0.98}, "belief": {}}
    told = verdict(shares, {"places": {frozenset(): 3.0}, "belief": {frozenset(): 1.0}}, since=12)
    assert told == ("of 3 missed places localise cost 2, odometry cost 0.98; from view 12 on the belief was more than 0.5 m "
                    "off")
    assert worst_link(shares["places"]) == "localise" and worst_link({"map": -0.1}) == ""


def test_a_patrol_that_missed_nothing_is_told_by_its_belief():
    shares = {"places": {"map": 0.0}, "belief": {"map": 0.15}}
    told = verdict(shares, {"places": {frozenset(): 0.0}, "belief": {frozenset(): 0.2}}, since=-1)
    assert told == "every place was visited; of 0.2 m error of belief map cost 0.15 m, 0.05 m no link that was tried"


def test_losses_are_unknown_where_the_row_does_not_know():
    found = losses_of({"places_total": 4, "places_visited": 0, "path_length_m": 3.0, "patrol_rmse_m": float("nan")})
    assert losses_of({"path_length_m": 12.5, "path_optimal_informed_m": 10.0})["way"] == 2.5
    assert found["places"] == 4 and np.isnan(found["way"]) and np.isnan(found["belief"])


def test_complaints_come_in_the_order_in_which_they_began():
    lost, path = {"motion_status": "lost", "motion_reason": "no features"}, {"event": "lost+no_plan"}
    views = [step(4, mission="0", **lost), step(5, **lost), step(6, belief_status="lost", **path), step(7, **lost)]
    assert first_complaints(views, views[1:]) == [  # of the view before, too
        (4, "odometry lost (no features)"), (6, "localiser lost"), (6, "the robot looks for itself"), (6, "plan: no path")]
