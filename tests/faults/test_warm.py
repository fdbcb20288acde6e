"""The process that forks is heard whatever comes of it at once."""

import os
from types import SimpleNamespace

from faults.warm import Warm


def test_two_answers_that_come_at_once_are_both_heard():
    reader, writer = os.pipe()
    warm = object.__new__(Warm)
    warm.process, warm._heard = SimpleNamespace(stdout=os.fdopen(reader)), b""
    os.write(writer, b'{"pid": 7}\n{"code": 0}\n')
    assert [warm._hear(0.5), warm._hear(0.5)] == [{"pid": 7}, {"code": 0}]
