"""Odometries that count the wheels, right and wrong."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np

from rhs.api.contracts import Odometry
from rhs.api.geometry import BODY_FROM_OPTICAL, inverse, planar, rotation_z, se2, se3
from rhs.api.records import Motion, Revision, Tracking

from . import settings

LOST = Motion(np.eye(4), np.diag([0.2] * 6), Tracking.LOST, "no wheel")


class Honest(Odometry):
    """Counts the wheels and knows how well they count."""

    def __init__(self, context):
        self.context, self.views = context, 0

    def update(self, observation):
        self.views += 1
        if self.views == 1:
            return Motion(np.eye(4), 1e-6 * np.eye(6), Tracking.OK)
        if observation.wheel is None:
            return LOST
        return self.motion(observation)

    def motion(self, observation):
        sigma = 0.002 + 0.03 * np.abs(observation.wheel)
        spread = np.diag([sigma[0], sigma[1], 1e-4, 1e-4, 1e-4, sigma[2]]) ** 2
        return Motion(se2(*self.travel(observation.wheel)), spread, Tracking.OK)

    def travel(self, wheel):
        return wheel


class NoBase:
    """Derives from nothing; the wheels are counted by another class."""

    def __init__(self, context):
        self.inner = Honest(context)

    def update(self, observation):
        return self.inner.update(observation)

    def revise(self):
        return None


class Inverted(Honest):
    """body_from_previous instead of previous_from_body."""
    says = "it were inverted"

    def motion(self, observation):
        motion = super().motion(observation)
        return replace(motion, previous_from_body=inverse(motion.previous_from_body))


class Mirrored(Honest):
    """Right is left."""
    says = "left and right were exchanged"

    def travel(self, wheel):
        return wheel * [1, -1, -1]


class Centimetres(Honest):
    """Counts in centimetres."""
    says = "it were in centimetres"

    def travel(self, wheel):
        return wheel * [100, 100, 1]


class Millimetres(Honest):
    """Counts in millimetres."""
    says = "it were in millimetres"

    def travel(self, wheel):
        return wheel * [1000, 1000, 1]


class Feet(Honest):
    """Metres taken for feet."""
    says = "the way ends at"

    def travel(self, wheel):
        return wheel * [0.3048, 0.3048, 1]


class Identity(Honest):
    """Never moves and is sure of it."""
    says = "the way ends at"

    def travel(self, wheel):
        return np.zeros(3)


class NoTurning(Honest):
    """Forgets the heading."""
    says = "the way ends at"

    def travel(self, wheel):
        return wheel * [1, 1, 0]


class Degrees(Honest):
    """Turns in degrees."""
    says = "the way ends at"

    def travel(self, wheel):
        return wheel * [1, 1, 57.3]


class Sideways(Honest):
    """x and y exchanged."""
    says = "the way ends at"

    def travel(self, wheel):
        return wheel[[1, 0, 2]]


class CameraAxes(Honest):
    """In the axes of the camera: x right, y down, z forward."""
    says = "the way ends at"

    def motion(self, observation):
        motion, axes = super().motion(observation), se3(BODY_FROM_OPTICAL, np.zeros(3))
        return replace(motion, previous_from_body=inverse(axes) @ motion.previous_from_body @ axes)


class Absolute(Honest):
    """The pose since the start instead of since the previous view."""
    says = "the way ends at"
    sum = np.eye(4)

    def motion(self, observation):
        motion = super().motion(observation)
        self.sum = self.sum @ motion.previous_from_body
        return replace(motion, previous_from_body=self.sum)


class AtOnce(Honest):
    """The sum of the last two motions."""
    says = "the way ends at"
    last = np.zeros(3)

    def travel(self, wheel):
        both, self.last = self.last + wheel, wheel
        return both


class Certain(Honest):
    """A covariance of 1e-12."""
    says = "sigmas of the covariance"

    def motion(self, observation):
        return replace(super().motion(observation), covariance=1e-12 * np.eye(6))


class Squared(Honest):
    """Variances squared once too often."""
    says = "sigmas of the covariance"

    def motion(self, observation):
        motion = super().motion(observation)
        return replace(motion, covariance=motion.covariance @ motion.covariance)


class RotationFirst(Honest):
    """The covariance in the order (rx, ry, rz, x, y, z), with turns counted to a hair."""
    says = "sigmas of the covariance"

    def motion(self, observation):
        spread = np.diag([2e-5, 2e-5, 2e-5, 5e-3, 5e-3, 2e-3]) ** 2
        return replace(super().motion(observation), covariance=spread)


class NeverSure(Honest):
    """Ok, with a sigma of ten metres."""
    says = "say degenerate"

    def motion(self, observation):
        return replace(super().motion(observation), covariance=100.0 * np.eye(6))


class Negative(Honest):
    """A negative covariance."""
    says = "covariance"

    def motion(self, observation):
        return replace(super().motion(observation), covariance=-np.eye(6))


class Lopsided(Honest):
    """A covariance that is not symmetric."""
    says = "not symmetric"

    def motion(self, observation):
        return replace(super().motion(observation), covariance=np.eye(6) + np.triu(np.full((6, 6), 0.1), 1))


class Singular(Honest):
    """Nothing is known of z, roll and pitch, so their variance is 0."""
    says = "covariance"

    def motion(self, observation):
        return replace(super().motion(observation), covariance=np.diag([1e-4, 1e-4, 0, 0, 0, 1e-4]))


class BadLastRow(Honest):
    """The last row says something else."""
    says = "last row"

    def motion(self, observation):
        pose = se2(*observation.wheel)
        pose[3] = [1, 2, 3, 4]
        return replace(super().motion(observation), previous_from_body=pose)


class Stretched(Honest):
    """A rotation that scales."""
    says = "no rotation"

    def motion(self, observation):
        return replace(super().motion(observation), previous_from_body=se3(1.001 * np.eye(3), np.zeros(3)))


class Reflected(Honest):
    """A rotation of determinant -1."""
    says = "reflection"

    def motion(self, observation):
        return replace(super().motion(observation), previous_from_body=np.diag([1.0, -1.0, 1.0, 1.0]))


class NotFinite(Honest):
    """NaN where nothing is seen."""
    says = "not finite"

    def update(self, observation):
        motion = super().update(observation)
        return replace(motion, previous_from_body=motion.previous_from_body * np.nan) if motion is LOST else motion


class Wordy(Honest):
    """A status of its own."""
    says = "a Tracking"

    def motion(self, observation):
        return replace(super().motion(observation), status="fine")


class Blindfold(Honest):
    """Sure of what it does not see."""
    says = "nothing could be seen"

    def update(self, observation):
        motion = super().update(observation)
        return replace(motion, status=Tracking.OK)


class Silent(Honest):
    """Lost without a word."""
    says = "say in `reason`"

    def update(self, observation):
        return replace(super().update(observation), reason="")


class Verbose(Honest):
    """A reason as long as a book."""
    says = "a text of at most"

    def update(self, observation):
        motion = super().update(observation)
        return replace(motion, reason="no wheel " * 10_000) if motion is LOST else motion


class MovedAtOnce(Honest):
    """The first motion is where the robot stands in the map."""
    says = "the first motion must be the identity"

    def update(self, observation):
        motion = super().update(observation)
        return motion if self.views > 1 else replace(motion, previous_from_body=se2(*self.context.world.start))


class LostAtFirst(Honest):
    """Has nothing to say of the first view."""
    says = "the first motion is lost"

    def update(self, observation):
        motion = super().update(observation)
        return motion if self.views > 1 else LOST


class Startled(Honest):
    """Does not bear a blind start."""
    says = "IndexError"

    def update(self, observation):
        if self.views == 0:
            np.nonzero(np.isfinite(observation.depth))[0][0]
        return super().update(observation)


class Tuple(Honest):
    """A pose and a covariance instead of a Motion."""
    says = "expected a Motion"

    def update(self, observation):
        motion = super().update(observation)
        return motion.previous_from_body, motion.covariance


class Shared(Honest):
    """Noise from numpy's global generator."""
    says = "numpy's global generator"

    def travel(self, wheel):
        return wheel + 1e-4 * np.random.standard_normal(3)  # noqa: NPY002


class Dice(Honest):
    """Noise from Python's global generator."""
    says = "Python's global generator"

    def travel(self, wheel):
        return wheel + 1e-4 * random.random()


class Seeds(Honest):
    """Seeds everybody's generator."""
    says = "numpy's global generator"

    def travel(self, wheel):
        np.random.seed(0)  # noqa: NPY002
        return wheel


class Clock(Honest):
    """Different at every run."""
    says = "two builds with one seed differ"

    def __init__(self, context):
        super().__init__(context)
        self.rng = np.random.default_rng()

    def travel(self, wheel):
        return wheel + 1e-4 * self.rng.standard_normal(3)


class Communal(Honest):
    """What it smooths it keeps in its class."""
    says = "share what they know"
    last = {"wheel": np.zeros(3)}

    def travel(self, wheel):
        old, Communal.last["wheel"] = Communal.last["wheel"], wheel
        return 0.8 * wheel + 0.2 * old if self.views > 2 else wheel


class Vandal(Honest):
    """Writes to the wheel it was given."""
    says = "it wrote to an array it was given"

    def travel(self, wheel):
        wheel.setflags(write=True)
        wheel *= 0.999
        return wheel


class Forgetful(Honest):
    """Its last word leaves the first view out."""
    says = "revise().scans"

    def revise(self):
        return Revision(np.stack([np.eye(4)] * (self.views - 1)), (None,) * (self.views - 1))


class Diverging(Honest):
    """A pose at 1e7 m."""
    says = "diverged"

    def travel(self, wheel):
        return wheel + [1e7, 0, 0]


class Tilted(Honest):
    """Rolls over on its way."""
    says = "the way ends at"

    def motion(self, observation):
        motion = super().motion(observation)
        roll = se3(rotation_z(0.08)[np.ix_([2, 0, 1], [2, 0, 1])], np.zeros(3))
        return replace(motion, previous_from_body=motion.previous_from_body @ roll)


class Diligent(Honest):
    """Numbers as texts."""
    says = "a number by a name"

    def motion(self, observation):
        return replace(super().motion(observation), details={"inliers": "12"})


class Drunk(Honest):
    """Errors of half the step, with the covariance of a good day."""
    says = "sigmas of the covariance"

    def __init__(self, context):
        super().__init__(context)
        self.rng = np.random.default_rng(3)

    def travel(self, wheel):
        return planar(se2(*wheel)) + [*(0.05 * self.rng.standard_normal(2)), 0.04 * self.rng.standard_normal()]


HONEST = {part.__name__: settings(part, "image depth wheel") for part in (Honest, NoBase)}
PLANTED = {part.__name__: (settings(part, "image depth wheel"), part.says) for part in Honest.__subclasses__()}
