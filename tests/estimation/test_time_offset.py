"""How late one sensor's stamps are of another's, by the turns of both."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.estimation.filters.time_offset import time_offset_s

HZ = 10.0


def heading(t: np.ndarray) -> np.ndarray:
    """A robot that turns this way and that, and stands still between."""
    return 0.8 * np.sin(0.7 * t) + 0.3 * np.sin(2.3 * t)


def turns(late_s: float, noise_rad: float = 0.002, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps of 20 s, the turns as seen late_s ago and as told now."""
    rng, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 1.0 / HZ)
    seen, told = (np.append(0.0, np.diff(heading(t - late))) + rng.normal(0.0, noise_rad, len(t)) for late in (late_s, 0.0))
    return t + 1.7e9, seen, told


@pytest.mark.parametrize("late_s", [0.05, 0.1, 0.3, 0.75, 2.0, -0.4])
def test_an_offset_is_found_to_a_few_hundredths_of_a_second(late_s):
    assert time_offset_s(*turns(late_s)) == pytest.approx(late_s, abs=0.02)


@pytest.mark.parametrize("seed", range(10))
def test_where_there_is_none_it_is_nothing(seed):
    """Also with noise as large as the turns, and wheels that count a fifth too much."""
    for noise_rad, times in ((0.002, 1.2), (0.05, 1.0)):
        stamps, seen, told = turns(0.0, noise_rad, seed)
        assert time_offset_s(stamps, seen, times * told) == 0.0


def test_a_way_straight_on_or_a_short_one_tells_nothing():
    stamps, seen, told = turns(0.3)
    assert np.isnan(time_offset_s(stamps, 0.01 * seen, 0.01 * told))
    assert np.isnan(time_offset_s(stamps[:15], seen[:15], told[:15]))
    assert np.isnan(time_offset_s(stamps, np.full(len(stamps), np.nan), told))
    assert np.isnan(time_offset_s(np.zeros(len(stamps)), seen, told))  # nobody stamped them


def test_where_only_the_end_was_seen_offsets_beyond_it_do_not_count():
    """30 views of 200; an offset of 3 s leaves none of them within the wheels' time, and no warning."""
    stamps, seen, told = turns(0.3)
    seen[:-30] = np.nan
    assert time_offset_s(stamps, seen, told) == pytest.approx(0.3, abs=0.03)


def test_views_without_an_answer_are_left_out_and_wheels_without_one_stood_still():
    stamps, seen, told = turns(0.3)
    seen[::7] = seen[1] = np.nan
    told[0] = np.nan
    assert time_offset_s(stamps, seen, told) == pytest.approx(0.3, abs=0.02)
