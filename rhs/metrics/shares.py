"""Shapley shares of a loss among links, exactly, from samples, or from as many patrols as they need.

A loss is known for sets of links that were given the truth; L() is that of the run as it is. The share of a link is what
giving it the truth takes off the loss, averaged over the orders in which links can be given it (Shapley, "A value for
n-person games", 1953). Shares sum to L() - L(all links); what is left over with every link true is nobody's. A negative
share: truth there makes it worse, because another link had got used to the error.

As many patrols as they need: one truth more is taken to make nothing worse (where it was seen to, both ends count). What a
set of links lost then lies between what its supersets and what its subsets lost, and where both are the same nobody needs to
drive it. What was not driven counts with the middle of its bounds, so that shares sum to the loss whatever was left out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from statistics import fmean

import numpy as np

Losses = Mapping[frozenset[str], float]
Bounds = Mapping[frozenset[str], tuple[float, float]]


def subsets(links: Sequence[str]) -> list[frozenset[str]]:
    """All sets of links, the empty one first."""
    return [frozenset(chosen) for size in range(len(links) + 1) for chosen in combinations(links, size)]


def weight(size: int, links: int) -> float:
    """Share of the orders of all links in which one link comes right after a certain set of this size."""
    return math.factorial(size) * math.factorial(links - size - 1) / math.factorial(links)


def shapley(losses: Losses, links: Sequence[str]) -> dict[str, float]:
    """Link -> its share of the loss, exactly; every set of links must be in `losses`."""
    n = len(links)
    shares = {}
    for link in links:
        others = [other for other in links if other != link]
        shares[link] = sum((losses[known] - losses[known | {link}]) * weight(len(known), n) for known in subsets(others))
    return shares


def shapley_of_orders(losses: Losses, orders: Sequence[Sequence[str]]) -> dict[str, tuple[float, float]]:
    """Link -> (share, half of its 95 % interval by Student's t) from the orders that were tried (Castro, Gomez and Tejada,
    "Polynomial calculation of the Shapley value based on sampling", 2009). A link that mattered alike in every order has an
    interval without width, though it may matter in others."""
    taken: dict[str, list[float]] = {link: [] for link in orders[0]}
    for order in orders:
        for place, link in enumerate(order):
            taken[link].append(losses[frozenset(order[:place])] - losses[frozenset(order[:place + 1])])
    return {link: (fmean(found), half_width(found)) for link, found in taken.items()}


def half_width(values: Sequence[float] | np.ndarray) -> float:
    """Of Student's 95 % interval of the mean of two values or more."""
    from scipy.special import stdtrit

    return float(stdtrit(len(values) - 1, 0.975) * np.std(values, ddof=1)) / math.sqrt(len(values))


def bounds(known: Losses, links: Sequence[str]) -> dict[frozenset[str], tuple[float, float]]:
    """Set of links -> between what its loss must lie; of sets that are known, twice the same. Those with no and with every
    truth must be known; where one that is known is NaN, all others are."""
    odd = any(math.isnan(loss) for loss in known.values())
    found = {}
    for one in subsets(links):
        ends = ((known[one],) if one in known else (math.nan,) if odd else
                (max(loss for other, loss in known.items() if other > one),
                 min(loss for other, loss in known.items() if other < one)))
        found[one] = min(ends), max(ends)
    return found


def middle(known: Losses, links: Sequence[str]) -> dict[frozenset[str], float]:
    """The losses, those not known in the middle of their bounds."""
    return {one: known.get(one, 0.5 * (low + high)) for one, (low, high) in bounds(known, links).items()}


def off_by(between: Bounds, links: Sequence[str]) -> dict[str, float]:
    """Link -> by how much its share may be off."""
    width = {one: high - low for one, (low, high) in between.items()}
    return {link: sum(0.5 * weight(len(one), len(links)) * (width[one] + width[one | {link}])
                      for one in width if link not in one) for link in links}


def next_patrols(known: Losses, links: Sequence[str], *, worth: float, alone: float) -> list[frozenset[str]]:
    """Up to two sets of links to be given the truth next, those that leave the bounds narrowest; none: it is known of every
    share within half of `worth`, and of every link whether its truth alone saves the share `alone` of what all save."""
    between = bounds(known, links)
    unknown = [one for one, (low, high) in between.items() if high > low]
    if max(off_by(between, links).values()) <= 0.5 * worth:
        nothing, everything = known[frozenset()], known[frozenset(links)]
        saved = nothing - alone * (nothing - everything)
        unknown = [one for one in unknown if len(one) == 1 and between[one][0] <= saved < between[one][1]]

    def left(one: frozenset[str]) -> float:
        """How wide the bounds would be with this patrol: mean over both ends of what it may lose."""
        return round(sum(sum(off_by(bounds({**known, one: end}, links), links).values()) for end in between[one]), 9)

    order = sorted(unknown, key=lambda one: (left(one), len(one), sorted(one)))
    return order[:1] + [one for one in order[1:] if not (one < order[0] or one > order[0])][:1]
