"""Thresholds of the filters, light to import: plugins nest these classes in their `advanced` settings."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import check_ranges


@dataclass(frozen=True)
class ClusterSettings:
    """Rival clusters of particles and how evidence counts between them. Maps and memories are a little wrong in the same way
    view after view, so a cluster is not made less likely by being a little worse than the best."""

    margin: float = 1.0
    """a cluster worse than the best by less than this (a logarithm) loses nothing"""
    share: float = 0.3
    """beyond that only this share of the difference counts; within a cluster evidence counts in full"""
    lightest: float = 1e-5
    """clusters below this weight are dropped"""
    most: int = 12
    """heavier ones that are kept alive whatever their weight"""
    least_particles: int = 60
    """of each cluster that is kept"""
    cell_m: float = 0.5
    """states in touching bins of this side are of one cluster, metres"""
    headings: int = 12
    """bins of a whole turn"""

    def __post_init__(self) -> None:
        check_ranges("", self, margin=(0.0, 1000.0), share=(0.0, 1.0), lightest=(0.0, 0.5), most=(1, 10_000),
                     least_particles=(1, 1_000_000), cell_m=(0.01, 100.0), headings=(3, 3600))


@dataclass(frozen=True)
class Effort:
    """How long the pose graph is solved for."""

    iterations: int = 30
    """steps at most"""
    settled: float = 1e-9
    """a step that lowers the cost by less than this share of it is the last"""

    def __post_init__(self) -> None:
        check_ranges("", self, iterations=(1, 100_000), settled=(0.0, 0.1))
