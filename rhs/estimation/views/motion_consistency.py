"""Does a view go on from the last one? A robot that was carried off sees a break, even where no place is known."""

from __future__ import annotations

from enum import StrEnum

import numpy as np

from rhs.api.geometry import Camera, inverse, transform
from rhs.api.records import Features, Scan

from .explainability import in_view
from .settings import ContinuitySettings, scaled_px

USUAL = ContinuitySettings()


class Continuity(StrEnum):
    """Of a view with the one before, by the motion between them."""

    GOES_ON = "goes on"
    BROKEN = "broken"  # hardly any key-point is where it ought to be
    UNKNOWN = "unknown"  # no view before, too few key-points, or none with depth


def continuity(
    last: Features | None, seen: Features, camera: Camera, previous_from_body: np.ndarray, s: ContinuitySettings = USUAL
) -> Continuity:
    """Whether a view can have been taken one motion (4x4, body) after the last: key-points with depth of the last view are
    drawn into this one and looked for."""
    if last is None or len(seen.pixels) < s.telling_pairs:
        return Continuity.UNKNOWN
    known = np.isfinite(last.points).all(axis=1)
    seen_from_last = inverse(previous_from_body @ camera.body_from_camera) @ camera.body_from_camera
    drawn = transform(seen_from_last, last.points[known].astype(float))
    pixels, inside = in_view(drawn, camera)
    drawn, pixels, theirs = drawn[inside], pixels[inside], last.descriptors[known][inside]
    if len(drawn) < s.few_found:
        return Continuity.UNKNOWN
    from .keypoint_kernels import found_again

    limits = scaled_px(s.pixels_px, camera.width), s.depth_share, s.depth_m, s.likeness
    found = found_again(np.column_stack([pixels, drawn[:, 2]]), theirs, seen.pixels.astype(float),
                        seen.points[:, 2].astype(float), seen.descriptors, limits)
    if len(drawn) < s.telling_pairs:
        return Continuity.GOES_ON if found >= s.few_found else Continuity.UNKNOWN
    return Continuity.BROKEN if found < s.goes_on_share * len(drawn) else Continuity.GOES_ON


def scan_continuity(
    last: Scan | None, seen: Scan | None, previous_from_body: np.ndarray, s: ContinuitySettings = USUAL
) -> Continuity:
    """Whether a scan can have been taken one motion (4x4, body) after the last, whose ends are drawn into this one."""
    share = scan_share(last, seen, previous_from_body, s)
    if np.isnan(share):
        return Continuity.UNKNOWN
    if share < s.scan_broken_share:
        return Continuity.BROKEN
    return Continuity.GOES_ON if share >= s.scan_goes_on_share else Continuity.UNKNOWN


def scan_share(
    last: Scan | None, seen: Scan | None, previous_from_body: np.ndarray, s: ContinuitySettings = USUAL, *,
    fine: bool = False
) -> float:
    """Share of the ends of the last scan that this one sees again after a motion (4x4, body), of those that both views hold;
    NaN where they are too few to tell. fine: by the narrow limits."""
    again = ends_again(last, seen, previous_from_body, s, fine=fine)
    told = np.isfinite(again)
    return float(again[told].mean()) if told.any() else float("nan")


def ends_again(
    last: Scan | None, seen: Scan | None, previous_from_body: np.ndarray, s: ContinuitySettings = USUAL, *,
    fine: bool = False
) -> np.ndarray:
    """(N,) of each beam of the last scan 1 if this one sees its end again after a motion, 0 if not, NaN where it holds none
    or looks elsewhere; NaN in all where they are too few to tell."""
    none = np.full(0 if last is None else len(last.ranges_m), np.nan)
    if last is None or seen is None:
        return none
    known = np.flatnonzero(np.isfinite(last.ranges_m) & (last.ranges_m < last.max_range_m))
    reach, bearing = last.ranges_m[known, None].astype(float), last.bearings_rad[known].astype(float)
    ends = reach * np.stack([np.cos(bearing), np.sin(bearing)], axis=1) + last.origin_xy_m
    body_from_previous = inverse(previous_from_body)
    drawn = ends @ body_from_previous[:2, :2].T + body_from_previous[:2, 3] - seen.origin_xy_m
    bearing = np.arctan2(drawn[:, 1], drawn[:, 0])
    inside = (bearing >= seen.bearings_rad.min(initial=0.0)) & (bearing <= seen.bearings_rad.max(initial=0.0))
    beside = np.searchsorted(seen.bearings_rad, bearing)[:, None] + np.arange(-2, 2)  # edges: one of the beams there
    if inside.sum() < s.telling_beams:
        return none
    there = seen.ranges_m[np.clip(beside, 0, len(seen.bearings_rad) - 1)]
    told = inside & np.isfinite(there).all(axis=1)
    if told.sum() < s.telling_beams:
        return none
    there, reach = there[told], np.hypot(drawn[told, 0], drawn[told, 1])
    slack = s.fine_beam_m + s.fine_beam_share * reach if fine else s.beam_m + s.beam_share * reach
    none[known[told]] = (reach > there.min(axis=1) - slack) & (reach < there.max(axis=1) + slack)
    return none
