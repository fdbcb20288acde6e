"""`engine=slurm`: jobs of Slurm by submitit, each with minutes of work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.engine import Engine, EngineContext
from rhs.api.errors import within


@dataclass
class Slurm(PartSettings):
    """Jobs of Slurm, each with a chunk of runs. Needs no open port, but a disk that head and nodes share."""

    partition: str = ""
    """where to queue; empty: the default partition"""
    account: str = ""
    """whom to charge; empty: the default account"""
    cpus: int = within(1, 1, 1024)
    """cores of a Slurm job, and runs at a time in it"""
    time_min: int = within(120, 1, 525600)
    """minutes that a Slurm job may take"""
    memory_mb: int = within(0, 0, 10_000_000)
    """memory asked for, MB; 0: as the partition gives"""
    chunk_s: float = within(900.0, 0.1, 864000.0)
    """seconds of work in a Slurm job; clusters dislike short ones"""
    poll_s: float = within(2.0, 0.1, 3600.0)
    """how often to look for answers, and to ask Slurm for its queue"""

    requires: ClassVar[tuple[str, ...]] = ("submitit:'rhs[slurm]'",)

    def build(self, context: EngineContext) -> Engine:
        """Imports submitit; submits nothing yet."""
        from .slurm_engine import SlurmEngine

        return SlurmEngine(self, context)
