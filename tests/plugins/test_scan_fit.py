"""Does the map explain the scan: shares by hand, chances that grow with the way and fall where the map is wrong."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Motion, Scan, Tracking
from rhs_localisers.advanced import FitSettings, ScanAdvanced
from rhs_localisers.particle_filter import freshness
from rhs_localisers.scan_fit import FitWatch


def room() -> OccupancyGrid:
    """4 m by 4 m, walls one cell thick, one cell of wall at (3.05, 2.05)."""
    cells = np.zeros((40, 40), np.float32)
    cells[[0, -1]] = cells[:, [0, -1]] = 1.0
    cells[20, 30] = 1.0
    return OccupancyGrid(cells, 0.1, (0.0, 0.0))


def scan(*ranges: float) -> Scan:
    """Beams spread over a right angle to the left of ahead."""
    return Scan(np.linspace(0.0, np.pi / 2, len(ranges)), np.array(ranges), 10.0)


AT, FITS, FITS_NOT = np.array([2.0, 2.5, 0.0]), scan(1.95, 1.45), scan(1.0, 1.0)


def test_ends_on_walls_are_explained_those_in_the_open_and_behind_walls_are_not():
    watch = FitWatch(room(), FitSettings(least_beams=2))
    assert watch.explained(scan(1.95, 1.95), AT) == (0.5, 0.0)  # ahead the wall, to the left 0.5 m too far
    assert watch.explained(FITS, AT) == (1.0, 0.0)
    assert watch.explained(scan(1.0, 1.0), np.array([2.0, 1.0, 0.0])) == (0.0, 0.0)  # in the open
    assert watch.explained(scan(1.95, 1.9), np.array([2.0, 2.05, 0.0])) == (0.5, 0.0)  # ahead through the post at 3.05 m
    assert watch.explained(scan(1.75, 1.45), AT) == (0.5, 0.0)  # two cells before the wall


def test_ends_where_nothing_is_mapped_are_counted_apart():
    grid = room()
    cells = grid.probability.copy()
    cells[22:, 15:25] = 0.5  # nobody was there, nor saw the wall behind
    watch = FitWatch(OccupancyGrid(cells, grid.resolution_m, grid.origin_m), FitSettings(least_beams=1))
    assert watch.explained(scan(1.95, 1.0), AT) == (1.0, 0.5)  # the wall ahead; to the left an end in the unknown
    assert watch.explained(scan(1.0, 1.0), AT) == (0.0, 0.5)  # ahead in the open


def test_too_few_beams_say_nothing():
    watch = FitWatch(room(), FitSettings())
    before = watch.evidence
    watch.look(scan(1.0, np.inf, np.nan), np.array([2.0, 2.0, 0.0]), 1.0, 0.1)
    assert np.isnan(watch.share) and watch.evidence == before == FitSettings().bias
    assert np.isnan(watch.explained(None, np.zeros(3))).all()


def test_the_chance_goes_with_the_mean_margin_over_the_rival_and_with_the_particles():
    settings = FitSettings(least_beams=2, bias=-1.0, particles=0.5, margin=10.0, least_scans=1.0, unrivalled=0.6)
    watch = FitWatch(room(), settings)
    watch.look(FITS, AT, 0.0, 0.0)
    assert watch.evidence == -1.0  # nothing new
    watch.look(FITS, AT, 1.0, 0.0)
    assert watch.evidence == pytest.approx(-1.0 + 10.0 * 0.4 / 2.0)  # one scan 0.4 above the rival, one that told nothing
    assert watch.chance(0.9) == pytest.approx(1.0 / (1.0 + np.exp(-1.0) / 3.0))  # odds 9, to the power of a half: 3
    for _ in range(1000):
        watch.look(FITS, AT, 1.0, 0.0)
    assert watch.evidence == pytest.approx(3.0, abs=0.01)  # a thousand scans tell what their mean tells
    assert watch.chance(1.0) == watch.chance(settings.most)
    for _ in range(100):
        watch.look(FITS_NOT, AT, 1.0, 1.0)
    assert watch.evidence < -5.0  # what was seen a hundred metres ago is forgotten


def test_ends_off_the_map_speak_against_the_belief():
    cells = np.full((40, 40), 0.5, np.float32)
    cells[15:35, 10:30] = 0.0
    watch = FitWatch(OccupancyGrid(cells, 0.1, (0.0, 0.0)), FitSettings(least_beams=2, unrivalled=0.0))
    watch.look(scan(1.95, 1.9), AT, 1.0, 0.1)
    s = FitSettings()
    assert watch.evidence == pytest.approx(s.bias - (s.unmapped + s.unexplained * s.expected) / (1.0 + s.least_scans))


def test_a_belief_that_leaps_off_its_motion_begins_anew():
    watch = FitWatch(room(), FitSettings(least_beams=2))
    watch.start(0.99)
    watch.look(FITS, AT, 1.0, 0.0)
    sure = watch.evidence
    watch.follow(np.array([1.0, 1.0, 0.0]), np.array([1.2, 1.0, 0.1]))
    assert watch.evidence == sure > 5.0
    watch.follow(np.array([1.0, 1.0, 0.0]), np.array([2.0, 1.0, 0.0]))
    assert watch.evidence == FitSettings().bias


def test_a_known_start_is_forgotten_over_the_way():
    watch = FitWatch(room(), FitSettings(least_beams=2, given=8.0, bias=-1.0, over_m=5.0))
    watch.start(1.0)
    assert watch.evidence == pytest.approx(7.0)
    watch.look(None, AT, 1.0, 5.0)
    assert watch.evidence == pytest.approx(8.0 / np.e - 1.0)


def test_a_rival_that_explains_as_much_takes_the_worth_of_a_scan():
    watch = FitWatch(room(), FitSettings(least_beams=2, rivals_m=1.0))
    twin, wrong = (2.0, 2.5, 0.0), (2.0, 1.0, 0.0)
    assert watch.rivals_due(0.0)  # none is known yet
    watch.compare(FITS, np.array([twin, wrong]))
    assert watch.rival == 1.0 and not watch.rivals_due(0.9) and watch.rivals_due(0.1)
    watch.look(FITS, AT, 1.0, 0.1)
    assert watch.evidence == FitSettings().bias
    watch.start()
    assert watch.rival == FitSettings().unrivalled and watch.rivals_due(0.0)  # a new start knows no rival
    watch.compare(FITS, np.empty((0, 3)))
    assert watch.rival == FitSettings().unrivalled


def test_what_is_new_in_a_scan_goes_with_the_way():
    def after(*travel: float) -> float:
        return freshness(Motion(se2(*travel), np.eye(6), Tracking.OK), ScanAdvanced(fresh_m=0.3))

    assert after(0.0, 0.0, 0.0) == 0.0 and after(0.3, 0.0, 0.0) == pytest.approx(1.0) and after(5.0, 0.0, 0.0) == 1.0
    assert after(0.03, 0.0, 0.0) == pytest.approx(0.1) and after(0.0, 0.0, 0.15) == pytest.approx(0.5)
