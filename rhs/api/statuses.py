"""The words that records use for how things stand. Each says what it means; all are in the data dictionary."""

from __future__ import annotations

from enum import StrEnum


class Tracking(StrEnum):
    """How far a Motion can be trusted."""

    OK = "ok"
    """measured"""
    DEGENERATE = "degenerate"
    """some direction is not observed; the covariance says which"""
    LOST = "lost"
    """nothing was measured; the motion is a guess"""


class BeliefStatus(StrEnum):
    """Whether a Belief is a place or a hope."""

    TRACKING = "tracking"
    """a place: the robot is sure of it"""
    DEGRADED = "degraded"
    """a place on the map, by which it drives; but the map is so unsure that this may lie elsewhere in the building"""
    CONVERGING = "converging"
    """a hope: likely, not yet confirmed"""
    LOST = "lost"
    """anywhere"""

    @property
    def on_map(self) -> bool:
        """Whether the robot knows its place on its own map, whatever that map is worth: it can plan and drive by it."""
        return self in (BeliefStatus.TRACKING, BeliefStatus.DEGRADED)


class PlanReason(StrEnum):
    """Why a plan is, or is not, there."""

    OK = "ok"
    """there is a path"""
    START_BLOCKED = "start_blocked"
    """the start is in a blocked cell"""
    GOAL_BLOCKED = "goal_blocked"
    """the goal is in a blocked cell"""
    OUTSIDE = "outside_map"
    """start or goal lies outside the map"""
    DISCONNECTED = "disconnected"
    """no way leads from start to goal: the search was exhaustive"""
    BUDGET_SPENT = "budget_spent"
    """the planner gave up; a larger budget may find a way"""
    NEVER_SEEN = "never_seen"
    """said by the patrol in the place of goal_blocked: nothing is known to stand at the goal, nobody has looked there"""


class Event(StrEnum):
    """What happened in one view of a patrol or of task=localise; steps.csv joins several by `+`."""

    ARRIVED = "arrived"
    """the robot believes itself at the place of its mission"""
    GAVE_UP = "gave_up"
    """the mission ended without; its reason stands in missions.json"""
    PLAN = "plan"
    """a path was planned"""
    NO_PLAN = "no_plan"
    """the planner found none; why stands in plans.json"""
    REPLAN = "replan"
    """the path was left or is blocked by what was seen before: a new one is planned in the same mission"""
    BLOCKED = "blocked"
    """something the map does not know stands on the path: the mission was broken off and begun anew"""
    VENTURE = "venture"
    """no way is left over ground that was seen: one is planned over ground that nobody has looked at, too"""
    WAIT = "wait"
    """the robot stands still before something on its path"""
    ASK = "ask"
    """it stands still and asks what to do about something on its path"""
    SKIPPED = "skipped"
    """the place is put off because its way is blocked; the robot goes on with the next"""
    STOPPED = "stopped"
    """the scan shows no room ahead: the robot stopped and turns"""
    LOOK = "look"
    """it would drive where nobody has looked for a while: it turns there first"""
    CONTACT = "contact"
    """it touched something, or its commands no longer move it: it backs off and marks what it did not see"""
    LOST = "lost"
    """the robot does not know where it is and looks for itself"""
    KIDNAPPED = "kidnapped"
    """it was carried elsewhere without being told (a truth: for the table only)"""
    STARTED = "started"
    """task=localise: the localiser was started here, from nothing or from the pose that was typed"""


class MissionStatus(StrEnum):
    """How a mission stands, as written to missions.json."""

    ACTIVE = "active"
    """under way; at the end of a run: it was cut short"""
    ARRIVED = "arrived"
    """the robot believed itself at the place"""
    ABORTED = "aborted"
    """broken off because the way was blocked; another mission goes to the same place"""
    SKIPPED = "skipped"
    """put off because the way was blocked; another mission goes there when the others are done"""
    GAVE_UP = "gave_up"
    """the place was left out; `reason` says why"""
