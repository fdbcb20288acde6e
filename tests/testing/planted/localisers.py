"""Localisers that believe the odometry, right and wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.belief import moved
from rhs.api.geometry import inverse, planar, se2
from rhs.api.records import Belief, BeliefStatus, Tracking

from . import settings

WIDE = np.diag([4.0, 4.0, 0.01, 0.01, 0.01, 4.0])


class Honest:
    """Believes the odometry from where it was told to start."""

    def __init__(self, context):
        self.context = context

    def learn(self, views, grid):
        self.views = views

    def start(self, belief):
        self.belief = belief or Belief(np.eye(4), WIDE, BeliefStatus.LOST, 0.0)

    def update(self, observation, motion):
        self.belief = self.after(motion)
        return self.belief

    def after(self, motion):
        return moved(self.belief, motion)


class IgnoresMotion(Honest):
    """Stays where it started."""
    says = "the motions lead to"

    def after(self, motion):
        return self.belief


class InverseMotion(Honest):
    """Goes backwards."""
    says = "the motions lead to"

    def after(self, motion):
        return moved(self.belief, replace(motion, previous_from_body=inverse(motion.previous_from_body)))


class MirroredMotion(Honest):
    """Turns to the other side."""
    says = "the motions lead to"

    def after(self, motion):
        return moved(self.belief, replace(motion, previous_from_body=se2(*planar(motion.previous_from_body) * [1, -1, -1])))


class WorldFrame(Honest):
    """Applies the motion in the frame of the map."""
    says = "the motions lead to"

    def after(self, motion):
        return replace(moved(self.belief, motion), map_from_body=motion.previous_from_body @ self.belief.map_from_body)


class Twice(Honest):
    """Moves twice as far."""
    says = "the motions lead to"

    def after(self, motion):
        return moved(moved(self.belief, motion), motion)


class Late(Honest):
    """Hands out the belief of the view before."""
    says = "the motions lead to"

    def update(self, observation, motion):
        before = self.belief
        super().update(observation, motion)
        return before


class NoTurning(Honest):
    """Moves, but never turns."""
    says = "the motions lead to"

    def after(self, motion):
        x, y, _ = planar(motion.previous_from_body)
        return moved(self.belief, replace(motion, previous_from_body=se2(x, y, 0.0)))


class BeginsAtOrigin(Honest):
    """Does not listen where it starts."""
    says = "the motions lead to"

    def start(self, belief):
        super().start(None if belief is None else replace(belief, map_from_body=np.eye(4)))


class BeginsWithoutHeading(Honest):
    """Takes the place of the start, not its heading."""
    says = "the motions lead to"

    def start(self, belief):
        super().start(belief)
        self.belief = replace(self.belief, map_from_body=se2(*planar(self.belief.map_from_body)[:2], 0.0))


class StartsOnce(Honest):
    """A second start is not heard."""
    says = "told to start at"
    begun = False

    def start(self, belief):
        if not self.begun:
            super().start(belief)
        self.begun = True


class NoAdjoint(Honest):
    """Adds covariances of two frames."""
    says = "compose_covariance"

    def after(self, motion):
        return replace(moved(self.belief, motion), covariance=self.belief.covariance + motion.covariance)


class Certain(Honest):
    """Always as sure as at the start."""
    says = "compose_covariance"

    def after(self, motion):
        return replace(moved(self.belief, motion), covariance=self.belief.covariance)


class Hair(Honest):
    """Shrinks the covariance with every view, whatever it saw."""
    says = "compose_covariance"

    def after(self, motion):
        return replace(moved(self.belief, motion), covariance=0.3 * self.belief.covariance)


class Optimist(Honest):
    """Tracks although it knows nothing."""
    says = "it claims to track"

    def after(self, motion):
        return replace(moved(self.belief, motion), status=BeliefStatus.TRACKING)


class Pessimist(Honest):
    """Never tracks."""
    says = "it tracks in only"

    def after(self, motion):
        return replace(moved(self.belief, motion), status=BeliefStatus.CONVERGING)


class Overlikely(Honest):
    """A chance of 7."""
    says = "a chance in [0, 1]"

    def after(self, motion):
        return replace(moved(self.belief, motion), probability=7.0)


class NotANumber(Honest):
    """NaN after a lost motion."""
    says = "not finite"

    def after(self, motion):
        after = moved(self.belief, motion)
        return after if motion.status is Tracking.OK else replace(after, map_from_body=np.full((4, 4), np.nan))


class Wordy(Honest):
    """A status that nobody knows."""
    says = "a BeliefStatus"

    def after(self, motion):
        return replace(moved(self.belief, motion), status="tracking")


class NeedsAStart(Honest):
    """Cannot begin from nothing."""
    says = "AttributeError"

    def start(self, belief):
        self.belief = replace(belief, map_from_body=belief.map_from_body.copy())


class Tuple(Honest):
    """Returns a pose."""
    says = "expected a Belief"

    def update(self, observation, motion):
        return super().update(observation, motion).map_from_body


class Shared(Honest):
    """Draws from numpy's global generator."""
    says = "numpy's global generator"

    def after(self, motion):
        np.random.standard_normal()  # noqa: NPY002
        return super().after(motion)


class Communal(Honest):
    """All of them have one belief."""
    says = "share what they know"
    one = {}

    def start(self, belief):
        super().start(belief)
        Communal.one["belief"] = self.belief

    def after(self, motion):
        Communal.one["belief"] = moved(Communal.one["belief"], motion)
        return Communal.one["belief"]


class Drunk(Honest):
    """Different at every run."""
    says = "two builds with one seed differ"

    def after(self, motion):
        after = super().after(motion)
        return replace(after, map_from_body=after.map_from_body @ se2(*(1e-4 * np.random.default_rng().standard_normal(3))))


class Vandal(Honest):
    """Writes to the survey."""
    says = "it wrote to an array it was given"

    def learn(self, views, grid):
        pose = views[2].map_from_body
        pose.setflags(write=True)
        pose[0, 3] += 1e-6


class Snapping(Honest):
    """Believes to be at the nearest surveyed view, turned round."""
    says = "says it tracks at"

    def update(self, observation, motion):
        super().update(observation, motion)
        if np.isfinite(observation.depth).any() if observation.depth is not None else False:
            here = self.belief.map_from_body[:2, 3]
            near = min(self.views, key=lambda view: float(np.hypot(*(view.map_from_body[:2, 3] - here))))
            self.belief = replace(self.belief, map_from_body=near.map_from_body @ se2(0.0, 0.0, np.pi))
        return self.belief


HONEST = {"Honest": settings(Honest, "image depth")}
PLANTED = {part.__name__: (settings(part, "image depth"), part.says) for part in Honest.__subclasses__()}
