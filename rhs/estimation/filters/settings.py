"""Thresholds of the filters, light to import: plugins nest these classes in their `advanced` settings."""

from __future__ import annotations

from dataclasses import dataclass

from rhs.api.errors import Bounded, within


@dataclass(frozen=True)
class ClusterSettings(Bounded):
    """Rival clusters of particles and how evidence counts between them. Maps and memories are a little wrong in the same way
    view after view, so a cluster is not made less likely by being a little worse than the best."""

    margin: float = within(1.0, 0.0, 1000.0)
    """a cluster worse than the best by less than this (a logarithm) loses nothing"""
    share: float = within(0.3, 0.0, 1.0)
    """beyond that only this share of the difference counts; within a cluster evidence counts in full"""
    lightest: float = within(1e-5, 0.0, 0.5)
    """clusters below this weight are dropped"""
    most: int = within(12, 1, 10_000)
    """heavier ones that are kept alive whatever their weight"""
    least_particles: int = within(60, 1, 1_000_000)
    """of each cluster that is kept"""
    cell_m: float = within(0.5, 0.01, 100.0)
    """states in touching bins of this side are of one cluster, metres"""
    headings: int = within(12, 3, 3600)
    """bins of a whole turn"""


@dataclass(frozen=True)
class Effort(Bounded):
    """How long the pose graph is solved for."""

    iterations: int = within(30, 1, 100_000)
    """steps at most"""
    settled: float = within(1e-9, 0.0, 0.1)
    """a step that lowers the cost by less than this share of it is the last"""
