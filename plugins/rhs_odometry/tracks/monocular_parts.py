"""Putting a monocular odometry together: the front end that follows points, the filter, and the tracks file if wanted."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from rhs.api.contracts import Context
from rhs.api.geometry import se2

from .klt import KltTracker
from .monocular import MonocularOdometry, TrackFilter
from .settings import KltSettings
from .track_frames import TrackFrame, Tracks, save_tracks

# Metres and degrees between views: nobody tells how far it went, so that points must be looked for where they were.
SHORT_STEPS = (0.125, 6.5)


def monocular_odometry(
    settings: Any, context: Context, core: TrackFilter, scale_from: str, follow: KltSettings
) -> MonocularOdometry:
    """settings: a config with `points` and `save_tracks`. scale_from: what the filter's metres come from, for the row.
    follow: how points are followed."""
    eye = MonocularOdometry(KltTracker(follow, settings.points), core, se2(*context.world.start),
                 few_tracks=settings.advanced.few_tracks)
    eye.scale_from = scale_from
    if getattr(settings, "motion", "none") == "none":
        eye.keeps_moving = SHORT_STEPS
    if settings.save_tracks:
        eye.keep, eye.at_end = [], partial(_save, context)
    return eye


def _save(context: Context, frames: Sequence[TrackFrame]) -> None:
    unknown = np.full((len(frames), 4, 4), np.nan)
    save_tracks(context.folder / "tracks.npz", Tracks(context.camera, np.array(context.world.start), frames, unknown))
