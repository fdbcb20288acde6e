"""Which earlier pictures show what a picture shows, and how they lie to it: by pose, then by key-points and depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rhs.api.geometry import Camera, inverse, planar, wrap

from .change_settings import ChangeSettings
from .changes import USUAL, Sight, rays_end
from .depth_alignment import aligned
from .settings import SightingSettings
from .view_pose import Snapshot, sight

NEAR_M, NEAR_RAD = 4.0, np.radians(75.0)  # further off, or turned further away, no picture is tried
NEW_SHARE = 0.05  # another picture is taken as long as it shows this much of the view that none did before
BELIEVED_M, BELIEVED_RAD = 0.6, np.radians(25.0)  # key-points that say something further from the belief are mistaken
CANDIDATES = 10


@dataclass(frozen=True, eq=False)
class Reference:
    """An earlier picture and its key-points, of the picture in full size."""

    sight: Sight
    snapshot: Snapshot


def small(image: np.ndarray, depth: np.ndarray, *, camera: Camera, map_from_body: np.ndarray, width_px: int = 160) -> Sight:
    """A picture made about so many pixels wide: blocks of colour are averaged, of depth the middle pixel is kept."""
    import cv2

    block = max(1, round(image.shape[1] / width_px))
    rows, columns = image.shape[0] // block, image.shape[1] // block
    camera = replace(camera, width=columns, height=rows, fx=camera.fx / block, fy=camera.fy / block,
                     skew=camera.skew / block, cx=(camera.cx - 0.5 * (block - 1)) / block,
                     cy=(camera.cy - 0.5 * (block - 1)) / block)
    colour = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    colour = cv2.resize(colour[: rows * block, : columns * block], (columns, rows), interpolation=cv2.INTER_AREA)
    middle = depth[block // 2 :: block, block // 2 :: block][:rows, :columns]
    return Sight(colour, np.where(middle > 0, middle, np.nan).astype(np.float32), camera, np.asarray(map_from_body))


def registered(now: Sight, features: Snapshot, references: Sequence[Reference], *, rng: np.random.Generator,
               settings: ChangeSettings = USUAL) -> list[Sight]:
    """The earlier pictures that show most of this one, each moved to where its key-points, or else the beliefs, and then its
    depth put it beside `now`. Those that agree with it nowhere are left out."""
    chosen: list[Sight] = []
    seen = np.zeros(now.depth.shape, bool)
    for reference in _by_nearness(now, references)[:CANDIDATES]:
        if len(chosen) == settings.references:
            break
        placed, same = _placed(now, features, reference, rng, settings)
        if (same & ~seen).mean() >= NEW_SHARE:
            chosen.append(placed)
            seen |= same
    return chosen


def _by_nearness(now: Sight, references: Sequence[Reference]) -> list[Reference]:
    """Those near enough, the likeliest to show the same first: a metre counts as much as half a radian."""
    scored = []
    for number, reference in enumerate(references):
        dx, dy, turn = planar(inverse(now.map_from_body) @ reference.sight.map_from_body)
        away_m, turn = float(np.hypot(dx, dy)), abs(float(wrap(turn)))
        if away_m <= NEAR_M and turn <= NEAR_RAD:
            scored.append((0.5 * away_m + turn, number))
    return [references[number] for _, number in sorted(scored)]


def _placed(now: Sight, features: Snapshot, reference: Reference, rng: np.random.Generator, settings: ChangeSettings,
            ) -> tuple[Sight, np.ndarray]:
    """The earlier picture where most of its surfaces are those of `now`, and which those are."""
    believed = replace(reference.sight)  # what is worked out of it goes with it, the reference stays
    tries = [believed]
    found = sight(reference.snapshot, features, settings=SightingSettings(), rng=rng)
    if found is not None:
        pose = now.map_from_body @ inverse(found.stored_from_query)
        dx, dy, turn = planar(inverse(believed.map_from_body) @ pose)
        if np.hypot(dx, dy) <= BELIEVED_M and abs(float(wrap(turn))) <= BELIEVED_RAD:
            tries.append(replace(believed, map_from_body=pose))
    tries = [aligned(one, now) for one in tries]
    marks = [rays_end(now, one, settings)[1] for one in tries]
    best = max(range(len(tries)), key=lambda k: (int(marks[k].sum()) + (0.02 * marks[k].size if k else 0)))
    return tries[best], marks[best]
