"""What went wrong first, by what the parts themselves said on the way: statuses and events.

Truth decides one thing only, as for places_visited: a robot that says it has arrived and stands elsewhere has failed.
The first mission that did not end at its place is looked at, from its beginning to its end; what was unbroken when it
began is counted as of its beginning. Each link is named once, where it first complained, in the order in which they did.
Where neither odometry nor localiser complained in it of more than the map, what they said in the survey is counted: the map
is of then. A place that was never seen also asks why the exploration ended; a robot that was carried off in an earlier
mission and whose localiser never doubted itself since is said to have been.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rhs.api.metric import RunFiles, columns_of
from rhs.api.statuses import BeliefStatus

from .patrol import arrived_elsewhere, patrol_steps
from .success import late_views

Step = Mapping[str, str]
OF_EVENT = {"no_plan": "plan: no path", "blocked": "something unknown on the path", "stopped": "no room ahead",
            "replan": "a new plan", "kidnapped": "somebody carried the robot off", "lost": "the robot looks for itself",
            "gave_up": "gave up"}
ESTIMATORS = {"odometry", "gate", "localise"}  # links that complain of what they know
OF_THE_MAP = f"localiser {BeliefStatus.DEGRADED}"  # what it complains of was drawn in the survey
MOST_WORDS = 5


def complaints(step: Step) -> list[tuple[str, str]]:
    """(link, what it said) of one view, none when all is well."""
    said = []
    if step["motion_status"] != "ok":
        reason = f" ({step['motion_reason'][:60]})" if step.get("motion_reason") else ""
        said.append(("odometry", f"odometry {step['motion_status']}{reason}"))
    if step.get("motion_replaced") == "1":
        said.append(("gate", "the gate put the wheels in the place of the odometry"))
    if step["belief_status"] != "tracking":
        said.append(("localise", f"localiser {step['belief_status']}"))
    said += [(event, OF_EVENT[event]) for event in step["event"].split("+") if event in OF_EVENT]
    if step.get("collided") == "1":
        said.append(("collided", "touched something"))
    return said


def cause(run: RunFiles) -> str:
    """The sentence; empty where every mission ended at its place."""
    missions = run.json("missions") or []
    survey, patrol = [step for step in run.steps if step["phase"] == "survey"], patrol_steps(run)
    failed = first_failed(missions, patrol)
    if failed is None:
        return ""
    what = f"{failed['place']}: {failed['reason'] or 'the run ended on the way'}"
    sequence = [f"view {view} {words}" for view, words in first_of_failed(patrol, missions)]
    said = [words for step in of_mission(patrol, failed) for link, words in complaints(step) if link in ESTIMATORS]
    if set(said) <= {OF_THE_MAP}:
        sequence = said_in(survey) + sequence
    explored = run.json("explore")
    if explored and str(failed["reason"]).endswith("never_seen"):
        sequence.insert(0, f"the exploration ended after {explored['views']} views ({explored['stop']})")
    if late := late_views(run.json("closure") or {}):
        sequence.insert(0, f"in the survey, {late}")
    return f"{what}; " + (", then ".join(sequence[:MOST_WORDS]) if sequence else "no part complained before")


def said_in(survey: Sequence[Step]) -> list[str]:
    """What the estimators complained of in the survey, how often and since when: one part of the sentence, or none."""
    views: dict[str, list[str]] = {}
    for step in survey:
        for link, words in complaints(step):
            if link in ESTIMATORS:
                views.setdefault(words.partition(" (")[0], []).append(step["index"])
    told = " and ".join(f"{words} (views: {len(at)} of {len(survey)}, first {at[0]})" for words, at in views.items())
    return [f"in the survey {told}"] if views else []


def of_mission(patrol: Sequence[Step], mission: Mapping[str, Any]) -> list[Step]:
    """The views of one mission."""
    return [step for step in patrol if step["mission"] == str(mission["mission"])]


def first_failed(missions: list[dict[str, Any]], patrol: Sequence[Step]) -> dict[str, Any] | None:
    """The first mission that did not end at its place, with the reason."""
    elsewhere = arrived_elsewhere(missions, patrol)
    for mission in missions:
        if (off_m := elsewhere.get(str(mission["mission"]))) is not None:
            return mission | {"reason": f"the robot said that it had arrived, {off_m:.1f} m from it"}
        if mission["status"] not in ("arrived", "aborted", "skipped"):
            return mission
    return None


def first_of_failed(patrol: Sequence[Step], missions: list[dict[str, Any]]) -> list[tuple[int, str]]:
    """(view, what was said) of each link that complained in the first mission that failed, in the order of the views."""
    failed = first_failed(missions, patrol)
    if failed is None:
        return []
    own = of_mission(patrol, failed)
    return carried_off_unnoticed(patrol, own) + first_complaints(patrol, own)


def carried_off_unnoticed(patrol: Sequence[Step], own: Sequence[Step]) -> list[tuple[int, str]]:
    """(view, words) of the last time before the views of a mission that somebody carried the robot off, where its localiser
    called itself nothing but tracking since; else none."""
    begun = int(own[0]["index"]) if own else 0
    for step in reversed([step for step in patrol if int(step["index"]) < begun]):
        if step["belief_status"] != "tracking":
            break
        if "kidnapped" in step["event"].split("+"):
            return [(int(step["index"]), OF_EVENT["kidnapped"])]
    return []


def first_complaints(patrol: Sequence[Step], own: Sequence[Step]) -> list[tuple[int, str]]:
    """(view, words): what each link said first in the views of one mission, in the order of the views."""
    if not own:
        return []
    first: dict[str, tuple[int, str]] = {}
    for step in own:
        for link, words in complaints(step):
            first.setdefault(link, (int(step["index"]), words))
    begun = int(own[0]["index"])
    before = {int(step["index"]): step for step in patrol if int(step["index"]) < begun}
    for link, (view, words) in first.items():
        if view == begun:  # it may have begun earlier
            while (earlier := before.get(view - 1)) is not None and link in dict(complaints(earlier)):
                view -= 1
            first[link] = view, words
    ordered = sorted(first.items(), key=lambda one: (one[1][0], one[0] == "gave_up"))
    return [complaint for link, complaint in ordered if link != "gave_up"]


CAUSE = columns_of(lambda run: {"cause": cause(run)},
                   ("cause", "", "which link complained first in the first mission that failed, and what followed, by what "
                    "the parts said themselves", "steps.csv, missions.json"), words=("cause",))
