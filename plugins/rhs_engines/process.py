"""`engine=process`: the sweep's own process forks each job on this machine, --jobs at a time. The default."""

from __future__ import annotations

from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.engine import HERE, Engine, EngineContext


@dataclass
class Process(PartSettings):
    """Processes of this machine, forked by the sweep itself."""

    provides: ClassVar[frozenset[str]] = frozenset({HERE})

    def build(self, context: EngineContext) -> Engine:
        """Nothing is sent anywhere: `width` is all there is to know."""
        return Here(context.jobs)


class Here(Engine):
    """Stands for this machine."""

    def __init__(self, width: int) -> None:
        self.width = width
        self.threads = ThreadPoolExecutor(width)

    def open(self) -> Executor:
        """Threads that wait for job servers: what a sweep would send, were it not to start its jobs itself."""
        return self.threads

    def close(self, now: bool) -> None:
        """Nothing more is begun."""
        self.threads.shutdown(wait=not now, cancel_futures=True)
