"""Loop closers that know the ring of the testing survey closes, right and wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rhs.api.geometry import exp_se3, inverse, log_se3, se2
from rhs.api.records import Closure, LoopEdge

from . import settings


class Nothing:
    """Leaves everything as it is."""

    def __init__(self, context):
        self.context = context

    def close(self, views):
        return Closure(np.stack([view.map_from_body for view in views]))


class Honest(Nothing):
    """The last view of a survey that came back stands where the first did: the error is spread over the way."""

    def close(self, views):
        poses = np.stack([view.map_from_body for view in views])
        if len(views) < 10 or np.linalg.norm(poses[-1][:2, 3] - poses[0][:2, 3]) > 0.7:
            return Closure(poses)
        last = len(views) - 1
        loop = LoopEdge(0, last, self.seen(), 1e-4 * np.eye(6), 50)
        error = log_se3(inverse(poses[-1]) @ poses[0] @ loop.earlier_from_later)
        return Closure(self.spread(poses, error), (loop,))

    def seen(self):
        return np.eye(4)

    def spread(self, poses, error):
        share = np.arange(len(poses)) / (len(poses) - 1)
        return np.stack([pose @ exp_se3(s * error) for pose, s in zip(poses, share, strict=True)])


class OtherWay(Honest):
    """Spreads the error the wrong way round."""
    says = "poses that drift were"

    def spread(self, poses, error):
        return super().spread(poses, -error)


class AllAtOnce(Honest):
    """Moves all views but the first by half the error, to the side of the map."""
    says = "poses that drift were"

    def spread(self, poses, error):
        moved = poses @ se2(0.0, -0.8, 0.0)
        moved[0] = poses[0]
        return moved


class WrongEdge(Honest):
    """Edges that lead elsewhere."""
    says = "edges are earlier_from_later"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, edges=tuple(replace(edge, earlier_from_later=se2(1.0, 0.0, 2.0)) for edge in closure.edges))


class InverseEdge(Nothing):
    """Edges later_from_earlier."""
    says = "edges are earlier_from_later"

    def close(self, views):
        closure = super().close(views)
        if len(views) < 6:
            return closure
        motion = views[1].map_from_body, views[5].map_from_body
        return replace(closure, edges=(LoopEdge(1, 5, inverse(motion[1]) @ motion[0], 1e-4 * np.eye(6), 40),))


class WorldEdge(Nothing):
    """Edges in the frame of the map."""
    says = "edges are earlier_from_later"

    def close(self, views):
        closure = super().close(views)
        if len(views) < 6:
            return closure
        edge = views[5].map_from_body @ inverse(views[1].map_from_body)
        return replace(closure, edges=(LoopEdge(1, 5, edge, 1e-4 * np.eye(6), 40),))


class MovesTheFirst(Honest):
    """Centres the survey."""
    says = "poses[0]"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, poses=se2(0.3, 0.0, 0.0) @ closure.poses)


class OwnFrame(Honest):
    """Begins at the origin."""
    says = "poses[0]"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, poses=inverse(closure.poses[0]) @ closure.poses)


class Anchored(Honest):
    """The last view is where it was believed; all the others move."""
    says = "poses[0]"

    def spread(self, poses, error):
        moved = super().spread(poses, error)
        return poses[-1] @ inverse(moved[-1]) @ moved


class TooFew(Honest):
    """Leaves the last view out."""
    says = "poses is of shape"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, poses=closure.poses[:-1])


class Flat(Honest):
    """x, y and yaw only."""
    says = "poses is of shape"

    def close(self, views):
        return replace(super().close(views), poses=np.zeros((len(views), 3)))


class Scaled(Honest):
    """Rotations that grow."""
    says = "no rotation"

    def spread(self, poses, error):
        moved = super().spread(poses, error)
        moved[1:, :3, :3] *= 2.0
        return moved


class Added(Honest):
    """Spreads the error by adding matrices."""
    says = "no rotation"

    def spread(self, poses, error):
        share = np.arange(len(poses))[:, None, None] / (len(poses) - 1)
        return poses + share * (poses[0] - poses[-1])


class NotFinite(Honest):
    """Divides by the number of loops."""
    says = "not finite"

    def close(self, views):
        closure = super().close(views)
        with np.errstate(invalid="ignore", divide="ignore"):
            weight = np.float64(len(closure.edges)) / len(closure.edges) if closure.edges else np.float64(np.nan)
        return replace(closure, poses=closure.poses * weight)


class Nowhere(Honest):
    """Edges to views that are not there."""
    says = "earlier < later"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, edges=tuple(replace(edge, later=len(views) + 3) for edge in closure.edges))


class Backwards(Honest):
    """The later view first."""
    says = "earlier < later"

    def close(self, views):
        closure = super().close(views)
        return replace(closure, edges=tuple(replace(edge, earlier=edge.later, later=edge.earlier) for edge in closure.edges))


class Shared(Honest):
    """Draws pairs from numpy's global generator."""
    says = "numpy's global generator"

    def close(self, views):
        np.random.permutation(len(views))  # noqa: NPY002
        return super().close(views)


class Drunk(Honest):
    """Different at every run."""
    says = "two builds with one seed differ"

    def seen(self):
        return se2(*(1e-3 * np.random.default_rng().standard_normal(3)))


class Remembers(Honest):
    """Keeps the first survey it ever saw, for all of its kind."""
    says = "poses[0]"
    first = []

    def close(self, views):
        if len(views) > 10:
            Remembers.first.append(views)
            return super().close(Remembers.first[0])
        return super().close(views)


class Vandal(Honest):
    """Corrects the views themselves."""
    says = "it wrote to an array it was given"

    def close(self, views):
        closure = super().close(views)
        for view, pose in zip(views, closure.poses, strict=True):
            view.map_from_body.setflags(write=True)
            view.map_from_body[:] = pose
        return closure


class Poses(Honest):
    """Returns poses without a Closure."""
    says = "expected a Closure"

    def close(self, views):
        return super().close(views).poses


class NeedsFeatures(Honest):
    """Does not bear views without features."""
    says = "AttributeError"

    def close(self, views):
        sum(len(view.features.pixels) for view in views)
        return super().close(views)


class Collapsed(Honest):
    """All views where the first is."""
    says = "poses that drift were"

    def spread(self, poses, error):
        return np.repeat(poses[:1], len(poses), axis=0)


HONEST = {part.__name__: settings(part, "image depth") for part in (Nothing, Honest)}
PLANTED = {part.__name__: (settings(part, "image depth"), part.says)
           for part in (*Honest.__subclasses__(), InverseEdge, WorldEdge)}
