"""What listens to the steps of a run."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import pytest

from rhs.patrol.observers import Beside


class Slow:
    """A listener that finishes a step when it is told to, and refuses the one numbered `bad`."""

    def __init__(self, bad=None):
        self.may, self.bad, self.heard, self.threads = threading.Semaphore(0), bad, [], set()

    def step(self, step):
        self.may.acquire()
        self.threads.add(threading.current_thread())
        if step.index == self.bad:
            raise OSError("no space left")
        self.heard.append(step.index)

    def map(self, grid, stamp_s):
        self.heard.append("map")

    def close(self, status="ok", reason=""):
        self.heard.append(f"closed: {status}")


def step(number):
    return SimpleNamespace(index=number)


def test_a_step_is_written_while_the_run_goes_on_and_all_in_order():
    slow = Slow()
    beside = Beside(slow)
    beside.step(step(0))
    assert slow.heard == []  # and yet the run went on
    slow.may.release(4)
    for number in (1, 2):
        beside.step(step(number))
    beside.map(None, 0.0)
    beside.step(step(3))
    beside.close("failed")
    assert slow.heard == [0, 1, 2, "map", 3, "closed: failed"]
    assert threading.current_thread() not in slow.threads and not any(thread.is_alive() for thread in slow.threads)


@pytest.mark.parametrize("last", [False, True])
def test_what_the_listener_refuses_comes_out_at_the_next_call_and_it_is_closed_all_the_same(last):
    slow = Slow(bad=1)
    beside = Beside(slow)
    slow.may.release(3)
    beside.step(step(0))
    beside.step(step(1))
    if not last:
        with pytest.raises(OSError, match="no space"):
            beside.step(step(2))
        beside.close("failed")
    else:
        with pytest.raises(OSError, match="no space"):
            beside.close()
    assert slow.heard == [0, f"closed: {'ok' if last else 'failed'}"]
