"""An engine for rhs: where the jobs of a sweep run."""

from __future__ import annotations

from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from typing import ClassVar

from rhs.api import Bounded, within
from rhs.api.engine import Engine, EngineContext


@dataclass
class Skeleton(Bounded):
    """Processes of this machine. Give the executor of your cluster in their place: whatever has `submit` will do."""

    chunk_s: float = within(30.0, 1.0, 86_400.0)
    """seconds of work sent at a time"""

    needs: ClassVar[frozenset[str]] = frozenset()
    provides: ClassVar[frozenset[str]] = frozenset()

    def build(self, context: EngineContext) -> Part:
        return Part(context.jobs, self.chunk_s)


class Part(Engine):
    """width: chunks that run at a time."""

    def __init__(self, width: int, chunk_s: float) -> None:
        self.width, self.chunk_s = width, chunk_s

    def open(self) -> Executor:
        """Ready for `submit(function, text)`."""
        self.executor = ProcessPoolExecutor(self.width, mp_context=get_context("spawn"))
        return self.executor

    def close(self, now: bool) -> None:
        """now: wait for nothing."""
        self.executor.shutdown(wait=not now, cancel_futures=True)
