"""What a robot does whose way is blocked, policy by policy, in a ring of corridors without pictures."""

import numpy as np
import pytest
from flatland import Flatland, Oracle, Through, parts, ring

from rhs.api.contracts import Blocked
from rhs.api.errors import ContractError
from rhs.patrol.loop import steps
from rhs.patrol.mission import MissionSettings
from rhs.patrol.sentinel import Sentinel
from rhs_replan import Ask, GoRound, NewMission, SkipAndReturn, Wait

PLACES = (("a", 4.0, 1.0), ("home", 1.0, 3.0))


class Leaves(Flatland):
    """What is hidden goes away after so many commands; None: never."""

    views = None

    def drive(self, command):
        if self.views is not None and self.index == self.views:
            self.occupied &= ~self.hidden
        return super().drive(command)


def barrier(*columns: tuple[int, int]) -> np.ndarray:
    hidden = np.zeros((80, 80), bool)
    hidden[1:20, 25:28] = True
    for low, high in columns:
        hidden[60:79, low:high] = True
    return hidden


def patrol(replan, *, hidden=None, leaves=None, places=PLACES):
    world = Leaves(ring(), (1.0, 1.0, 0.0), places, hidden=barrier() if hidden is None else hidden)
    world.views = leaves
    oracle = Oracle(world)
    given = parts(oracle)
    given.planner.corners = False
    given.replan = replan
    sentinel = Sentinel(given, world.grid(), (), places=places, radius_m=world.radius, settings=MissionSettings())
    out = []
    for step in steps(world, Through(world.camera), oracle, sentinel):
        out.append(step)
        assert len(out) < 2000, "the patrol does not end"
    assert not any(step.collided for step in out)
    return sentinel.book.missions, [event for step in out for event in step.events]


def told(missions):
    return [(mission.place, str(mission.status)) for mission in missions]


def test_go_round_keeps_its_mission():
    missions, _ = patrol(GoRound())
    assert told(missions) == [(place, "arrived") for place in ("a", "home")]
    assert missions[0].replans >= 1


def test_wait_stands_until_the_way_is_free():
    """Twelve views without progress are no reason to give up while it waits for twenty."""
    missions, events = patrol(Wait(40), leaves=25)
    assert told(missions) == [(place, "arrived") for place in ("a", "home")]
    assert events.count("wait") > 12 and "blocked" not in events


def test_wait_goes_round_what_stays():
    missions, events = patrol(Wait(5))
    assert told(missions)[:2] == [("a", "aborted"), ("a", "arrived")]
    assert 5 <= events.count("wait") <= 15


def test_skip_and_return_visits_the_others_first():
    missions, events = patrol(SkipAndReturn())
    order = [place for place, status in told(missions) if status == "arrived"]
    assert told(missions)[0] == ("a", "skipped") and sorted(order) == ["a", "home"] and order[0] != "a"
    assert "skipped" in events


def test_a_place_that_stays_blocked_is_put_off_so_often_and_then_given_up():
    """Both ways to a are closed for good: it ends, and says so."""
    missions, _ = patrol(SkipAndReturn(tries=2, views=3), hidden=barrier((25, 28)))
    statuses = [status for place, status in told(missions) if place == "a"]
    assert statuses[-1] == "gave_up" and 1 <= statuses.count("skipped") <= 2
    assert ("home", "arrived") in told(missions)


def test_a_place_with_no_way_past_what_was_seen_is_tried_once_more_when_the_others_are_done():
    """Both ways to a are closed until the robot is on its way home; or for good."""
    order = [one for one in told(patrol(NewMission(), hidden=barrier((25, 28)), leaves=100)[0]) if one[1] != "aborted"]
    assert order == [("a", "skipped"), ("home", "arrived"), ("a", "arrived")]
    order = [one for one in told(patrol(NewMission(), hidden=barrier((25, 28)))[0]) if one[1] != "aborted"]
    assert order == [("a", "skipped"), ("home", "arrived"), ("a", "gave_up")]


def test_what_barred_a_way_is_looked_at_again_before_the_last_place_is_given_up():
    """Both ways to the only place are closed; both open while the robot is under way between them, or never."""
    assert told(patrol(NewMission(), hidden=barrier((25, 28)), leaves=70, places=PLACES[:1])[0])[-1] == ("a", "arrived")
    assert told(patrol(NewMission(), hidden=barrier((25, 28)), places=PLACES[:1])[0])[-1] == ("a", "gave_up")


def test_without_a_way_round_go_round_waits():
    missions, events = patrol(GoRound(views=60), hidden=barrier((25, 28)), leaves=90, places=(("a", 4.0, 1.0),))
    assert told(missions) == [("a", "arrived")] and "wait" in events


def test_ask_does_what_it_is_told(tmp_path):
    answer = tmp_path / "answer.txt"
    answer.write_text("give_up\n")
    missions, _ = patrol(Ask(str(answer)))
    assert told(missions)[0] == ("a", "gave_up")


def test_ask_goes_on_where_nobody_answers(tmp_path):
    missions, events = patrol(Ask(str(tmp_path / "nobody"), views=4))
    assert told(missions)[0] == ("a", "skipped") and events.count("ask") >= 4
    assert sorted(place for place, status in told(missions) if status == "arrived") == ["a", "home"]


class Always:
    """Answers the same whatever it is told."""

    def __init__(self, answer):
        self.answer = answer

    def blocked(self, blockage):
        return self.answer


def test_a_part_that_skips_for_ever_does_not_keep_the_patrol():
    missions, _ = patrol(Always(Blocked.SKIP), hidden=barrier((25, 28)))
    assert told(missions)[-1][1] in ("gave_up", "arrived")
    assert sum(status == "skipped" for _, status in told(missions)) <= MissionSettings().tries


def test_an_answer_that_is_none_is_refused_by_name():
    with pytest.raises(ContractError, match="replan Always: what it returned is of type str; expected a Blocked"):
        patrol(Always("wait"))
