"""Cards of mappers and loop closers: right ones, and planted wrong ones that must be found."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from rhs.api.geometry import inverse, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.records import Closure, LoopEdge
from rhs.card import loop_closers, mappers
from rhs.card.card import card_of
from rhs.card.forked import ForkResult
from rhs.card.page import page_of
from rhs.config import registry


def test_a_beam_to_somebody_ends_at_his_front():
    """He stands 2 m ahead and is a quarter of a metre wide to each side."""
    reach = mappers.to_disc(se2(0.0, 0.0, 0.0), np.array([0.0, 0.3, np.pi]), np.array([2.0, 0.0]))
    assert reach[0] == pytest.approx(1.75) and np.isinf(reach[1:]).all()


def test_the_truth_is_a_faultless_map_and_its_mirror_image_is_not():
    views = mappers.shown("furnished room")
    grid = OccupancyGrid(np.full((70, 90), 0.02, np.float32), 0.1, (-4.5, -3.5))
    ends = np.concatenate([one.ends_m for one in views])
    true = np.array(grid.probability)
    true[tuple(grid.cells(ends).T)] = 0.98
    found = mappers.judged(OccupancyGrid(true, 0.1, grid.origin_m), views)
    assert found["walls_share"] == 1.0 and found["false_walls_share"] == 0.0 and found["free_share"] > 0.98
    assert found["ece"] == pytest.approx(0.02, abs=0.01)
    mirrored = mappers.judged(OccupancyGrid(true[:, ::-1].copy(), 0.1, grid.origin_m), views)
    assert mirrored["false_walls_share"] > 0.05 and mirrored["walls_share"] < 0.95


@dataclass
class Forgetful:
    """A mapper that draws what it sees, whoever it was, and never takes it back."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context):
        settings = registry.load("mapper", "occupancy")()
        part = settings.build(context)
        update = part.update
        seen = []

        def keep(pose, scan):
            update(pose, scan)
            x, y, yaw = pose[0, 3], pose[1, 3], np.arctan2(pose[1, 0], pose[0, 0])
            reach = scan.ranges_m
            angles = yaw + scan.bearings_rad
            seen.append(np.stack([x + reach * np.cos(angles), y + reach * np.sin(angles)], 1))

        drawn = part.grid

        def grid():
            plain = drawn()
            probability = np.array(plain.probability)
            points = np.concatenate(seen)
            probability[tuple(plain.cells(points[plain.inside(points)]).T)] = 0.98
            return replace(plain, probability=probability)

        part.update, part.grid = keep, grid
        return part


def test_who_passed_by_stays_in_the_map_of_a_mapper_that_takes_nothing_back():
    ours, theirs = ({one.room: one.figures for one in mappers.work(settings)}
                    for settings in (registry.load("mapper", "occupancy")(), Forgetful()))
    assert ours["somebody passes by"]["false_walls_share"] < 0.02 < theirs["somebody passes by"]["false_walls_share"]
    assert theirs["room"]["false_walls_share"] < 0.02


def closed(title: str, closure) -> loop_closers.Closed:
    views, truth = loop_closers.survey(title)
    return loop_closers.judged(title, views, truth, closure(views, truth), 1.0)


def untouched(views, truth):
    return Closure(np.array([view.map_from_body for view in views]))


def test_shares_of_the_error_by_hand():
    """The truth leaves nothing, no closing everything, also where there is no loop."""
    loop, none = "two laps that bend", "no loop: a corridor"
    right = loop_closers.figures(ForkResult([closed(loop, lambda views, truth: Closure(truth)), closed(none, untouched)]))
    assert right["left_pct"] == pytest.approx(0.0, abs=1e-9) and right["harm_pct"] == pytest.approx(100.0)
    assert right["before_m"] > 0.1 and np.isnan(right["false_share"])


def test_a_loop_half_a_metre_off_is_false_and_one_refused_is_not_counted():
    def believed(views, truth):
        true = inverse(truth[2]) @ truth[66]
        edges = [LoopEdge(2, 66, true @ se2(x, 0.0, 0.0), np.eye(6), 30, accepted) for x, accepted in
                 ((0.0, True), (0.5, True), (0.5, False))]
        return replace(untouched(views, truth), edges=tuple(edges))

    found = loop_closers.figures(ForkResult([closed("two laps that bend", believed)]))
    assert found["accepted"] == 2 and found["false_share"] == 0.5


@pytest.mark.parametrize(("kind", "name", "columns"), [
    ("mapper", "occupancy", {"walls_share": (0.9, 1.0), "false_walls_share": (0.0, 0.02), "free_share": (0.98, 1.0)}),
    ("loop_closer", "none", {"left_pct": (100.0, 100.0), "harm_pct": (100.0, 100.0), "accepted": (0, 0)}),
    ("loop_closer", "pose_graph", {"left_pct": (0.0, 15.0), "accepted": (50, 400), "false_share": (0.0, 0.0)})])
def test_the_cards_of_ours(kind, name, columns, monkeypatch):
    monkeypatch.setattr("rhs.card.card.references", lambda kind, but: {})
    card = card_of(kind, name, registry.load(kind, name)())
    content = card.content
    assert "data:image" in page_of(card)
    figures = content["figures"][f"{kind}={name}"]
    assert content["passes"] and len(content["rooms"]) >= 4
    for column, (low, high) in columns.items():
        assert low <= figures[column] <= high, (column, figures[column])
