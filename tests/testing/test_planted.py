"""Every mistake planted in a stranger's part is found by rhs.testing, and its author is told which; honest parts pass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
from planted import localisers, loop_closers, mappers, odometry, planners, sensors, sources

from rhs.api.contracts import KINDS, Blocked
from rhs.testing import check_plugin

OF_KIND = {"source": sources, "sensor": sensors, "odometry": odometry, "loop_closer": loop_closers, "mapper": mappers,
           "planner": planners, "localiser": localisers}
HONEST = [pytest.param(kind, part, id=f"{kind}-{name}") for kind, module in OF_KIND.items()
          for name, part in module.HONEST.items()]
PLANTED = [pytest.param(kind, part, says, id=f"{kind}-{name}") for kind, module in OF_KIND.items()
           for name, (part, says) in module.PLANTED.items()]


@pytest.mark.parametrize(("kind", "part"), HONEST)
def test_an_honest_part_passes(kind, part):
    check_plugin(kind, part)


@pytest.mark.parametrize(("kind", "part", "says"), PLANTED)
def test_a_planted_mistake_is_found_and_named(kind, part, says):
    with pytest.raises(AssertionError) as caught:
        check_plugin(kind, part)
    assert says in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_there_are_planted_mistakes_of_every_kind():
    assert set(OF_KIND) == set(KINDS) - {"replan"}
    assert all(len(module.PLANTED) >= 20 for module in OF_KIND.values())


@dataclass
class Answers:
    """A part that answers one thing, whatever is asked."""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()
    answer: ClassVar[object] = Blocked.REPLAN

    def build(self, context):
        return self

    def blocked(self, blockage):
        return self.answer


@pytest.mark.parametrize(("answer", "says"), [(None, "blocked() returned None"), ("replan!", "expected a Blocked"),
                                              (Blocked.WAIT, "still waiting after 10000 views")])
def test_a_planted_mistake_of_a_replan_is_found(answer, says):
    check_plugin("replan", Answers())
    with pytest.raises(AssertionError) as caught:
        check_plugin("replan", type("Wrong", (Answers,), {"answer": answer, "__doc__": "Wrong."})())
    assert says in str(caught.value)
