"""`engine=dask`: Dask's workers, on this machine, in a cluster that is running, or as jobs of a batch system."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from rhs.api.contracts import PartSettings
from rhs.api.engine import Engine, EngineContext
from rhs.api.errors import ConfigError, check_choice, within

CLUSTERS = ("", "slurm", "pbs", "htcondor", "lsf", "sge", "oar")


@dataclass
class Dask(PartSettings):
    """Dask's workers: on this machine, in a running cluster (address), or as jobs of a batch system (cluster)."""

    address: str = ""
    """scheduler of a running cluster, tcp://head:8786; empty: a cluster of our own, --jobs workers"""
    cluster: str = ""
    """batch system whose jobs are the workers, by dask-jobqueue: slurm, pbs, htcondor, lsf, sge, oar; empty: this machine"""
    queue: str = ""
    """queue or partition of the batch system; empty: its default"""
    walltime: str = "02:00:00"
    """how long one job of the batch system may hold its worker, HH:MM:SS"""
    memory: str = "2GB"
    """memory asked of the batch system for a worker"""
    interface: str = ""
    """network interface by which workers reach the scheduler, for instance ib0; empty: the default one"""
    chunk_s: float = within(30.0, 0.1, 86400.0)
    """seconds of work sent at once"""

    requires: ClassVar[tuple[str, ...]] = ("distributed:'rhs[dask]'",)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_choice("", "cluster", self.cluster, CLUSTERS)
        if self.address and self.cluster:
            raise ConfigError(f"address={self.address}: a running cluster is joined, cluster={self.cluster} starts one; "
                              f"give one of them")

    def build(self, context: EngineContext) -> Engine:
        """Imports distributed; starts nothing yet."""
        from .dask_engine import DaskEngine

        return DaskEngine(self, context)
