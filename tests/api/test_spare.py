"""Two pieces of work at once give what they give one after the other, and leave no thread."""

import threading

import pytest

from rhs.api import spare


@pytest.fixture(params=[False, True], ids=["in turn", "at once"])
def granted(request):
    spare.grant(request.param)
    yield request.param
    spare.grant(False)


def test_both_give_what_they_return_and_no_thread_is_left(granted):
    before = threading.active_count()
    threads = spare.both(threading.current_thread, threading.current_thread)
    assert (threads[0] is threads[1]) == (not granted)
    assert spare.both(lambda: 1, lambda: "a") == (1, "a") and threading.active_count() == before


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
