"""Which link of the chain cost what: Shapley shares of a loss (shares.py), and the sentence that says so.

Which link is named: the truth in a late link (a localiser that is always right) covers for an error that an early one made,
so that both get a like share. Of links whose truth alone saves nearly all, the earliest in the chain is named that saves
about as much as any of them of everything that was lost; where no link does, the one with the largest share. How the robot
moved, and what its wheels counted, comes before what it sees.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from functools import partial

from rhs.api.metric import RunFiles, columns_of
from rhs.runfolder.row import number_in

from .shares import Losses, middle, shapley
from .success import places_within_reach
from .survey import NAN

CAUSAL = ("drive", "sense", "odometry", "closing", "map", "localise", "plan")  # an error goes on to those after
LINKS = ("sense", "odometry", "closing", "map", "localise", "plan", "drive")
# measure -> (unit, what is lost)
MEASURES = {"places": ("", "places missed"), "belief": ("m", "error of the belief in the patrol"),
            "ate": ("m", "error of the survey's trajectory"), "way": ("m", "way driven beyond the shortest"),
            "time": ("s", "wait of a place beyond the least")}
# what is worth a verdict: half a place; a fifth of the distance within which a place is visited; two steps of the robot; ten
# seconds that the place worst off waits longer than it must
WORTH = {"places": 0.5, "belief": 0.1, "ate": 0.1, "way": 1.0, "time": 10.0}
ALONE = 0.8  # of what all truths together save: a link saves nearly all; of what the best such link saves: about as much
HALF = 0.5  # of the largest share: less, and what a link saves alone is chance
OFF_M = 0.5  # the belief is somewhere else: the distance within which a place counts as visited
SMALL = 0.05  # of the loss: a link that cost less is not named


def losses_of(columns: Mapping[str, object]) -> dict[str, float]:
    """What one patrol lost in each measure, from the columns of its row; NaN where nobody knows. A place that nobody can get
    to is no loss."""
    number = partial(number_in, columns)
    return {"places": places_within_reach(columns) - number("places_visited"), "belief": number("patrol_rmse_m"),
            "ate": number("ate_unaligned_m"), "way": number("path_length_m") - number("path_optimal_informed_m"),
            "time": number("idleness_worst_s") - number("idleness_bound_s")}


def off_since(steps: Sequence[Mapping[str, str]]) -> int:
    """Index of the first view of the patrol after which the belief never came within OFF_M of the truth again; -1: none."""
    since = -1
    for step in steps:
        if step["phase"] != "patrol" or not step["true_x_m"] or not step["x_m"]:
            continue
        off = math.hypot(float(step["x_m"]) - float(step["true_x_m"]), float(step["y_m"]) - float(step["true_y_m"])) > OFF_M
        since = (int(step["index"]) if since < 0 else since) if off else -1
    return since


def judged(losses: Mapping[str, Losses], links: Sequence[str], *, since: int,
           shares: Mapping[str, Mapping[str, float]] | None = None) -> dict[str, str]:
    """measure: what the run is judged by; link: who is named; verdict: a sentence. Nothing worth a verdict: measure and link
    are empty. losses: measure -> of the patrols that were driven. shares: sampled ones, of more links than are tried in
    every combination."""
    if shares is None:
        losses = {name: middle(known, links) for name, known in losses.items()}
        shares = {name: shapley(known, links) for name, known in losses.items()}
    measure = measure_of(losses, links)
    link = named_link(shares[measure], losses, measure) if measure else ""
    return {"measure": measure, "link": link, "verdict": verdict(shares, losses, since, measure=measure, link=link)}


def measure_of(losses: Mapping[str, Losses], links: Collection[str]) -> str:
    """Places, if the truth saves any; else that of the others of which it saves most, counted in what is worth a verdict."""
    saved = {name: (known[frozenset()] - known[frozenset(links)]) / WORTH[name] for name, known in losses.items()}
    worth = {name: value for name, value in saved.items() if value >= 1.0}
    return "places" if "places" in worth else max(worth, key=lambda name: worth[name], default="")


def named_link(shares: Mapping[str, float], losses: Mapping[str, Losses], measure: str) -> str:
    """Of the links whose truth alone saves nearly all of the judged measure the earliest that saves about as much as any of
    them in all measures together, counted in what is worth a verdict (where a place was missed by chance, any truth saves
    it; the fault's truth saves the rest too). If there is none, the link with the largest share; empty where no share is
    positive. shares: of the judged measure."""
    order = sorted(shares, key=CAUSAL.index)
    most, saved = max(shares.values()), sum(shares.values())
    if not most > 0:
        return ""
    nearly = [link for link in order if shares[link] >= HALF * most and alone(losses[measure], link) >= ALONE * saved]
    if not nearly:
        return max(order, key=lambda link: round(shares[link], 9))
    worth = {link: sum(alone(known, link) / WORTH[name] for name, known in losses.items()) for link in nearly}
    best = max(worth.values())
    return next(link for link in nearly if worth[link] >= best - (1.0 - ALONE) * abs(best))


def alone(losses: Losses, link: str) -> float:
    """What the truth of this link alone saves; 0 where nobody knows."""
    nothing = losses.get(frozenset(), NAN)
    saves = nothing - losses.get(frozenset([link]), nothing)
    return 0.0 if math.isnan(saves) else saves


def verdict(shares: Mapping[str, Mapping[str, float]], losses: Mapping[str, Losses], since: int, *, measure: str, link: str,
            ) -> str:
    """One sentence: which link cost how much of what was lost, whose truth adds to it instead, and from which view on the
    robot was somewhere else."""
    missed = losses["places"][frozenset()]
    places = f"of {missed:.0f} missed place{'s' * (missed != 1)} "
    said = places if missed > 0 else "every place was visited; " if missed == 0 else ""
    if not measure:
        return said + _nothing_saved(shares, losses, missed) + _off(since)
    unit, what = MEASURES[measure]
    lost = losses[measure][frozenset()]
    if measure != "places":
        said += f"of {_amount(lost, unit)} {what} "
    order = sorted(shares[measure].items(), key=lambda one: -one[1])
    named = [f"{one} cost {_amount(share, unit)}" for one, share in order if share > SMALL * lost]
    rest = lost - sum(share for _, share in order)
    if rest > SMALL * lost:
        named.append(f"{_amount(rest, unit)} no link that was tried")
    named += _makes_worse(order, unit, SMALL * lost)
    if link and link != order[0][0]:
        why = ("what comes later covers for it" if CAUSAL.index(link) < CAUSAL.index(order[0][0])
               else "and more of all else that was lost")
        named.append(f"and {link} is named: its truth alone saves {_amount(alone(losses[measure], link), unit)}, {why}")
    return said + (", ".join(named) or "no link alone cost much") + _off(since)


def _nothing_saved(shares: Mapping[str, Mapping[str, float]], losses: Mapping[str, Losses], missed: float) -> str:
    """The sentence where all truths together save nothing worth a verdict: what is lost all the same, and what one truth
    saves that another loses again."""
    if missed > 0:
        order = sorted(shares["places"].items(), key=lambda one: -one[1])
        named = [f"{one} cost {_amount(share, '')}" for one, share in order if share >= WORTH["places"]]
        named += _makes_worse(order, "", WORTH["places"])
        return "the truth in the links that were tried saves none" + (f" in all: {', '.join(named)}" if named else "")
    lost = {name: losses[name][frozenset()] for name in ("belief", "ate")}
    known = [f"{MEASURES[name][1]} {loss:.2g} m" for name, loss in lost.items() if not math.isnan(loss)]
    much = any(loss >= WORTH[name] for name, loss in lost.items())
    return (("the truth in all links that were tried saves nothing worth blaming" if much else
             "nothing worth blaming was lost") + (f" ({', '.join(known)})" if known else ""))


def _makes_worse(order: Sequence[tuple[str, float]], unit: str, least: float) -> list[str]:
    """Negative shares in words, the largest first."""
    return [f"the truth in {one} adds {_amount(-share, unit)}" for one, share in reversed(order) if -share > least]


def _amount(value: float, unit: str) -> str:
    """Two digits, and no power of ten, with the unit."""
    return (f"{value:.2g}" if abs(value) < 99.5 else f"{value:.0f}") + (f" {unit}" if unit else "")


def _off(since: int) -> str:
    return f"; from view {since} on the belief was more than {OFF_M:g} m off" if since >= 0 else ""


def blame_values(run: RunFiles) -> dict[str, float | str]:
    """The columns of task=blame from blame.json."""
    blame = run.json("blame") or {}
    errors = blame.get("off_by", {}).get(blame.get("measure", ""), {})
    shares: Mapping[str, Mapping[str, float]] = blame.get("shares", {})
    values: dict[str, float | str] = {"blame": str(blame.get("verdict", "")), "blame_link": str(blame.get("link", "")),
                                      "blame_measure": str(blame.get("measure", "")),
                                      "blame_off_since": float(blame.get("off_since", NAN)),
                                      "blame_runs": float(blame.get("runs", NAN)),
                                      "blame_off_by": max((number_in(errors, link) for link in errors), default=NAN)}
    for measure in MEASURES:
        values |= {column(measure, link): number_in(shares.get(measure, {}), link) for link in LINKS}
        values[column(measure, "rest")] = number_in(blame.get("rest", {}), measure)
    return values


def column(measure: str, link: str) -> str:
    """The column of a link's share of the loss in a measure."""
    unit = MEASURES[measure][0]
    return f"blame_{measure}_{link}" + (f"_{unit}" if unit else "")


def _specs() -> list[tuple[str, str, str, str]]:
    source = "rhs.metrics.blame (Shapley 1953)"
    return [("blame", "", "which link cost what, and since when, in one sentence", source),
            ("blame_link", "", "the link that is named: the earliest whose truth alone saves nearly all that was lost, as "
             "much as any other's; else that which cost most; empty where nothing worth a verdict was lost", source),
            ("blame_measure", "", "what it cost: places where the truth saves any; else belief, ate, way or time, whichever "
             "lost more of what is worth a verdict (0.1 m, 0.1 m, 1 m, 10 s)", source),
            ("blame_off_since", "", "first view of the patrol after which the belief never came back within 0.5 m of the "
             "truth; -1: it did", "steps.csv, truth"),
            ("blame_runs", "", "counterfactual patrols that the shares rest on", source),
            ("blame_off_by", "", "by how much a share in blame_measure may be off, in its unit: half of its bounds, where "
             "fewer patrols were driven than there are combinations, if one truth more makes nothing worse; of its 95 % "
             "interval, where they were sampled", source),
            *((column(measure, link), unit, f"{what}: share that the link {link} cost", source)
              for measure, (unit, what) in MEASURES.items() for link in LINKS),
            *((column(measure, "rest"), unit, f"{what}: left with the truth in every link that was tried", source)
              for measure, (unit, what) in MEASURES.items())]


BLAME = columns_of(blame_values, *_specs(), tasks=("blame",), words=("blame", "blame_link", "blame_measure"))
