"""Which link of the chain cost what: Shapley shares of a loss, and the sentence that says so.

A loss is known for sets of links that were given the truth; L() is that of the run as it is. The share of a link is what
giving it the truth takes off the loss, averaged over the orders in which links can be given it (Shapley, "A value for
n-person games", 1953). Shares sum to L() - L(all links); what is left over with every link true is nobody's. A negative
share: truth there makes it worse, because another link had got used to the error.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from itertools import combinations
from statistics import fmean

from rhs.api.metric import RunFiles, columns_of

LINKS = ("sense", "odometry", "closing", "map", "localise", "plan", "drive")
# measure -> (unit, what is lost)
MEASURES = {"places": ("", "places missed"), "belief": ("m", "error of the belief in the patrol"),
            "ate": ("m", "error of the survey's trajectory"), "way": ("m", "way driven beyond the shortest")}
OFF_M = 0.5  # the belief is somewhere else: the distance within which a place counts as visited
SMALL = 0.05  # of the loss: a link that cost less is not named
NAN = float("nan")
Losses = Mapping[frozenset[str], float]


def losses_of(columns: Mapping[str, object]) -> dict[str, float]:
    """What one patrol lost in each measure, from the columns of its row; NaN where nobody knows."""
    def number(name: str) -> float:
        value = columns.get(name)
        return float(value) if isinstance(value, int | float) else NAN

    return {"places": number("places_total") - number("places_visited"), "belief": number("patrol_rmse_m"),
            "ate": number("ate_unaligned_m"), "way": number("path_length_m") - number("path_optimal_informed_m")}


def subsets(links: Sequence[str]) -> list[frozenset[str]]:
    """All sets of links, the empty one first."""
    return [frozenset(chosen) for size in range(len(links) + 1) for chosen in combinations(links, size)]


def shapley(losses: Losses, links: Sequence[str]) -> dict[str, float]:
    """Link -> its share of the loss, exactly; every set of links must be in `losses`."""
    n = len(links)
    shares = {}
    for link in links:
        others = [other for other in links if other != link]
        shares[link] = sum((losses[known] - losses[known | {link}])
                           * math.factorial(len(known)) * math.factorial(n - len(known) - 1) / math.factorial(n)
                           for known in subsets(others))
    return shares


def shapley_of_orders(losses: Losses, orders: Sequence[Sequence[str]]) -> dict[str, tuple[float, float]]:
    """Link -> (share, its standard error) from the orders that were tried (Castro, Gomez and Tejada, "Polynomial calculation
    of the Shapley value based on sampling", 2009)."""
    taken: dict[str, list[float]] = {link: [] for link in orders[0]}
    for order in orders:
        for place, link in enumerate(order):
            taken[link].append(losses[frozenset(order[:place])] - losses[frozenset(order[:place + 1])])
    return {link: (fmean(found), _standard_error(found)) for link, found in taken.items()}


def _standard_error(values: Sequence[float]) -> float:
    middle = fmean(values)
    return math.sqrt(sum((value - middle) ** 2 for value in values) / max(len(values) - 1, 1) / len(values))


def off_since(steps: Sequence[Mapping[str, str]]) -> int:
    """Index of the first view of the patrol after which the belief never came within OFF_M of the truth again; -1: none."""
    since = -1
    for step in steps:
        if step["phase"] != "patrol" or not step["true_x_m"] or not step["x_m"]:
            continue
        off = math.hypot(float(step["x_m"]) - float(step["true_x_m"]), float(step["y_m"]) - float(step["true_y_m"])) > OFF_M
        since = (int(step["index"]) if since < 0 else since) if off else -1
    return since


def verdict(shares: Mapping[str, Mapping[str, float]], losses: Mapping[str, Losses], since: int) -> str:
    """One sentence: which link cost most of what was lost, and from which view on the robot was somewhere else."""
    nothing: frozenset[str] = frozenset()
    places = losses["places"][nothing]
    measure, lost = ("places", f"{places:.0f} missed places") if places > 0 else (
        "belief", f"{losses['belief'][nothing]:.2g} m error of belief")
    if math.isnan(losses[measure][nothing]):
        return "nothing is known of what was lost"
    if measure == "belief" and losses["belief"][nothing] <= 0.0:
        return "nothing was lost"
    unit = "" if measure == "places" else " m"
    order = sorted(shares[measure].items(), key=lambda one: -one[1])
    named = [f"{link} cost {share:.2g}{unit}" for link, share in order if share > SMALL * losses[measure][nothing]]
    rest = losses[measure][nothing] - sum(share for _, share in order)
    if rest > SMALL * losses[measure][nothing]:
        named.append(f"{rest:.2g}{unit} no link that was tried")
    said = f"of {lost} " if measure == "places" else f"every place was visited; of {lost} "
    where = f"; from view {since} on the belief was more than {OFF_M:g} m off" if since >= 0 else ""
    return said + (", ".join(named) or "no link alone cost much") + where


def worst_link(shares: Mapping[str, float]) -> str:
    """The link with the largest share; empty where no share is positive."""
    link, share = max(shares.items(), key=lambda one: one[1], default=("", 0.0))
    return link if share > 0 else ""


def blame_values(run: RunFiles) -> dict[str, float | str]:
    """The columns of task=blame from blame.json."""
    told = run.json("blame") or {}
    shares: Mapping[str, Mapping[str, float]] = told.get("shares", {})
    values: dict[str, float | str] = {"blame": str(told.get("verdict", "")), "blame_link": str(told.get("link", "")),
                                      "blame_off_since": float(told.get("off_since", NAN)),
                                      "blame_runs": float(told.get("runs", NAN))}
    for measure in MEASURES:
        values |= {column(measure, link): _number(shares.get(measure, {}).get(link)) for link in LINKS}
        values[column(measure, "rest")] = _number(told.get("rest", {}).get(measure))
    return values


def column(measure: str, link: str) -> str:
    """The column of a link's share of the loss in a measure."""
    unit = MEASURES[measure][0]
    return f"blame_{measure}_{link}" + (f"_{unit}" if unit else "")


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else NAN


def _specs(named: Collection[str] = LINKS) -> list[tuple[str, str, str, str]]:
    source = "rhs.metrics.blame (Shapley 1953)"
    return [("blame", "", "which link cost what, and since when, in one sentence", source),
            ("blame_link", "", "the link that cost most places, or where none was missed most error of the belief", source),
            ("blame_off_since", "", "first view of the patrol after which the belief never came back within 0.5 m of the "
             "truth; -1: it did", "steps.csv, truth"),
            ("blame_runs", "", "counterfactual patrols that the shares rest on", source),
            *((column(measure, link), unit, f"{what}: share that the link {link} cost", source)
              for measure, (unit, what) in MEASURES.items() for link in named),
            *((column(measure, "rest"), unit, f"{what}: left with the truth in every link that was tried", source)
              for measure, (unit, what) in MEASURES.items())]


BLAME = columns_of(blame_values, *_specs(), tasks=("blame",), words=("blame", "blame_link"))
