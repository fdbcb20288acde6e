"""Two pieces of work at once give what they give one after the other; no thread outlives the grant."""

import os
import threading
import time

import pytest

from rhs.api import spare


@pytest.fixture(params=[False, True], ids=["in turn", "at once"])
def granted(request):
    spare.grant(request.param)
    yield request.param
    spare.grant(False)


def test_both_give_what_they_return(granted):
    begun = threading.Event()
    threads = spare.both(lambda: (begun.wait(5.0 if granted else 0.0), threading.current_thread())[1],
                         lambda: (begun.set(), threading.current_thread())[1])
    assert (threads[0] is threads[1]) == (not granted)
    assert spare.both(lambda: 1, lambda: "a") == (1, "a")


def test_what_nobody_has_time_for_is_not_waited_for():
    busy = threading.Event()
    spare.grant(True)
    try:
        for _ in range(spare.MOST):
            spare.later(busy.wait)
        assert spare.both(int, threading.current_thread) == (0, threading.current_thread())
    finally:
        busy.set()
        spare.grant(False)


def test_what_is_under_way_ends_and_no_thread_is_left_when_nothing_is_granted_any_more():
    before, done = threading.active_count(), []
    spare.grant(True)
    spare.later(lambda: (time.sleep(0.05), done.append(1)))
    spare.grant(False)
    assert done == [1] and threading.active_count() == before


def test_work_may_wait_for_work_that_was_begun_before_it(granted):
    last = spare.later(lambda: 0)
    for _ in range(5 * spare.MOST):
        last = spare.later(lambda before=last: before() + 1)
    assert last() == 5 * spare.MOST


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_a_forked_process_works_in_turn(granted):
    spare.later(int)()
    child = os.fork()
    if child == 0:
        os._exit(0 if spare.both(int, int) == (0, 0) and not spare.granted() else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_what_either_raises_comes_out_the_first_ones_first(granted):
    def fail(word):
        raise ValueError(word)

    for first, second, word in ((lambda: fail("one"), lambda: fail("two"), "one"), (int, lambda: fail("two"), "two")):
        with pytest.raises(ValueError, match=word):
            spare.both(first, second)


def test_later_gives_the_value_or_raises_each_time_it_is_asked(granted):
    value = spare.later(lambda: [1])
    assert value() is value() and value() == [1]

    def refused():
        raise ValueError("no")

    def asked():
        spare.later(refused)()

    with pytest.raises(ValueError, match="no"):
        asked()


def test_nothing_is_granted_unless_somebody_says_so():
    assert not spare.granted()
