"""Votes for and against a thing in a cell."""

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.records import Scan
from rhs.estimation.scans.settings import VoteSettings
from rhs.estimation.scans.votes import Votes, low_only

BEARINGS = np.linspace(-0.2, 0.2, 41)
HERE = se2(0.5, 2.0, 0.0)


def beams(range_m, blind_m=0.0):
    return Scan(BEARINGS, np.full(41, float(range_m)), 5.0, (0.0, 0.0), blind_m)


def votes_at(votes, x_m, y_m=2.0):
    return float(votes.votes[int(y_m / 0.1), int(x_m / 0.1)])


def look(votes, scan, times=1):
    for _ in range(times):
        votes.look(HERE, scan, hits=np.isfinite(scan.ranges_m), within_m=5.0)


@pytest.fixture
def votes():
    return Votes((40, 80), 0.1, (0.0, 0.0), VoteSettings())


def test_each_view_that_ends_in_a_cell_is_one_vote_however_many_beams_do(votes):
    look(votes, beams(2.03), 3)
    assert votes_at(votes, 2.53) == 3.0 and votes_at(votes, 1.5) == 0.0


def test_beams_through_a_cell_clear_it_and_what_has_stood_for_long_is_gone_after_ten_views(votes):
    look(votes, beams(2.03), 50)
    assert votes_at(votes, 2.53) == 5.0
    look(votes, beams(np.inf), 10)
    assert votes_at(votes, 2.53) == 0.0
    look(votes, beams(2.03), 2)
    look(votes, beams(1.03))
    assert votes_at(votes, 2.53) == 2.0, "something in front says nothing of what is behind it"


def test_what_walks_is_forgotten_in_three_views_through_it_unless_a_beam_ends_beside_it(votes):
    votes.walks[:] = True
    for range_m, left in ((np.inf, 0.0), (2.19, 3.5)):
        look(votes, beams(2.03), 50)
        look(votes, beams(range_m), 3)
        assert votes_at(votes, 2.53) == left


def test_where_a_beam_is_blind_it_clears_nothing(votes):
    look(votes, beams(2.03), 3)
    look(votes, beams(np.inf, blind_m=3.0), 10)
    assert votes_at(votes, 2.53) == 3.0
    look(votes, beams(np.inf, blind_m=1.5), 10)
    assert votes_at(votes, 2.53) == 0.0


def test_unknown_beams_say_nothing_and_the_last_stretch_before_a_hit_speaks_neither_way(votes):
    look(votes, beams(2.03), 3)
    look(votes, beams(np.nan), 10)
    look(votes, beams(2.13), 10)
    assert votes_at(votes, 2.53) == 3.0


def test_low_is_what_the_level_scan_passes_over():
    level = Scan(np.linspace(-0.5, 0.5, 11), np.full(11, 4.0), 8.0)
    ranges = np.full(41, 3.9)
    ranges[:5], ranges[-1] = 2.0, np.inf
    low = low_only(Scan(BEARINGS, ranges, 5.0), level)
    assert low[:5].all() and not low[5:].any()
    assert low_only(Scan(BEARINGS, ranges, 5.0), None).sum() == 40
