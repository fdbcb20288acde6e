"""What sources must do (see rhs.testing). A source that can be driven is held against the walls of a small world; one that
plays back is asked for its first views, if it has any without a file being named."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.contracts import SourceContext, complete
from rhs.api.errors import ConfigError
from rhs.api.floorplan import World
from rhs.api.geometry import inverse, planar, se2
from rhs.api.records import Capture, Twist
from rhs.api.validate import check_capture, check_pose
from rhs.api.validate_source import check_camera, check_clearance, check_facts, check_provides
from rhs.worlds.world import load_world

from .shared_state import same, untouched

WORLD = "square_small"
LEADS = 4
# what it is told to do: forward m/s, left rad/s, seconds
DRIVES = (Twist(0.25, 0.0, 0.4), Twist(0.0, 0.5, 0.4), Twist(0.3, 0.6, 0.5), Twist(0.0, -0.5, 0.2))
NEAR_M, NEAR_RAD = 0.02, 0.02
WORDS = {"image": "image", "depth": "depth", "wheel": "travel", "scan": "scan"}  # provided -> field of a Capture


def _source(settings: Any, folder: Path, seed: int = 0) -> Any:
    """The source, in a small world if it can be driven; None when a recording asks for a file first."""
    world = load_world(WORLD) if _driven(settings) else None
    try:
        return complete("source", settings.build(SourceContext(np.random.default_rng(seed), world, folder)))
    except ConfigError:
        if world is not None:
            raise
        return None


def _driven(settings: Any) -> bool:
    return "driving" in type(settings).provides


def _led(source: Any, count: int = LEADS, after_s: float = -np.inf) -> list[tuple[Capture, Any]]:
    """The next views of the survey with their true poses, each checked; the source may have fewer."""
    out: list[tuple[Capture, Any]] = []
    while len(out) < count and (capture := source.lead()) is not None:
        capture, truth = check_capture(capture, who="lead()", after_s=after_s), source.truth()
        after_s = capture.stamp_s
        out.append((capture, None if truth is None else check_pose(truth, who="truth()", field="world_from_body")))
    return out


def hands_out_views_of_its_camera(settings: Any, folder: Path) -> None:
    with untouched():
        source = _source(settings, folder)
        if source is None:
            return
        with closing(source):
            views = _led(source, 1)
            first = None if not views or views[0][0].image is None else np.array(views[0][0].image)
            views += _led(source, LEADS - 1, views[-1][0].stamp_s if views else -np.inf)
            check_facts(source.facts, who="the source")
            check_clearance(source.clearance_m(), who="the source")
            check_provides(source.provides, who="the source")
            camera, there = check_camera(source.camera, who="the source"), source.provides
    assert views, "lead() gave no view"
    promised = type(settings).provides & (there or type(settings).provides) & set(WORDS)
    for number, (capture, _) in enumerate(views):
        for array in (capture.image, capture.depth):
            size = (camera.height, camera.width)
            assert array is None or array.shape[:2] == size, f"a view of {array.shape[:2]} pixels, the camera has {size}"
        for word in promised - ({"wheel"} if number == 0 else set()):  # nothing was travelled before the first view
            assert getattr(capture, WORDS[word]) is not None, f"provides {word}, but a capture has no {WORDS[word]}"
    kept = views[0][0].image
    assert first is None or kept is None or np.array_equal(first, kept), "the image of the first view changed with the next"


def travel_is_that_of_the_truth(settings: Any, folder: Path) -> None:
    if (source := _source(settings, folder)) is None:
        return
    with closing(source):
        views, start = _led(source), source.facts.start
    if _driven(settings) and views[0][1] is not None:
        off = planar(views[0][1]) - start
        assert np.abs(off[:2]).max() < NEAR_M and abs(_turned(off[2])) < NEAR_RAD, (
            f"the survey begins at {np.round(planar(views[0][1]), 3)}, the facts say {start}")
    for (_, before), (capture, after) in zip(views[:-1], views[1:], strict=True):
        if capture.travel is not None and before is not None:
            _agrees(capture.travel, planar(inverse(before) @ after), "travel of a view")


def _agrees(said: np.ndarray, true: np.ndarray, what: str) -> None:
    off = np.abs([said[0] - true[0], said[1] - true[1], _turned(said[2] - true[2])])
    assert off[:2].max() < NEAR_M and off[2] < NEAR_RAD, (
        f"{what} is {np.round(said, 3)}, by truth() it moved by {np.round(true, 3)} (metres ahead and left, radians left)")


def _turned(angle_rad: float) -> float:
    """The angle brought to [-pi, pi)."""
    return float((angle_rad + np.pi) % (2.0 * np.pi) - np.pi)


def sees_the_walls_of_the_world(settings: Any, folder: Path) -> None:
    if not _driven(settings) or "depth" not in type(settings).provides:
        return
    with closing(_source(settings, folder)) as source:
        views, camera = _led(source, 2), source.camera
    pixels = np.stack([np.arange(camera.width), np.full(camera.width, round(camera.cy))], axis=1).astype(float)
    rays = camera.rays(pixels) @ camera.body_from_camera[:3, :3].T
    for capture, truth in views:
        eye = truth @ camera.body_from_camera[:, 3]
        true = _to_walls(load_world(WORLD), eye[:2], (rays @ truth[:3, :3].T)[:, :2], camera.height_m)
        assert capture.depth is not None and truth is not None, "no depth, or no truth of a source that is driven"
        row = capture.depth[round(camera.cy)]
        known = np.isfinite(row) & np.isfinite(true)
        assert known.sum() > 0.2 * len(row), f"knows the depth of {known.sum()} of {len(row)} pixels of the middle row"
        share = float(np.mean(np.abs(row[known] - true[known]) < 0.05 * true[known] + 0.03))
        assert share > 0.8, (f"{share:.0%} of the depths of the middle row are those of the world's walls from truth(), the "
                             f"median is {np.median(row[known] / true[known]):.3g} of them")


def _to_walls(world: World, eye: np.ndarray, directions: np.ndarray, height_m: float) -> np.ndarray:
    """(N,) lengths, in units of the directions (N, 2), to the nearest wall or box as high as the camera; inf without one."""
    sides = [segment for wall in world.walls if wall.height_m > height_m for segment in wall.segments_m]
    for box in world.boxes:
        if box.bottom_m < height_m < box.bottom_m + box.size_m[2]:
            corners = box.corners_m
            sides += [np.stack(pair) for pair in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
    best = np.full(len(directions), np.inf)
    for start, end in sides:
        along, to = end - start, start - eye
        with np.errstate(divide="ignore", invalid="ignore"):
            across = directions[:, 0] * along[1] - directions[:, 1] * along[0]
            reach = (to[0] * along[1] - to[1] * along[0]) / across
            where = (to[0] * directions[:, 1] - to[1] * directions[:, 0]) / across
        best = np.where((reach > 0) & (where >= 0) & (where <= 1) & (reach < best), reach, best)
    return best


def drives_when_told_and_where_it_is_put(settings: Any, folder: Path) -> None:
    if not _driven(settings):
        return
    with closing(_source(settings, folder)) as source:
        (led, before), = _led(source, 1)
        stamp_s = led.stamp_s
        source.begin_patrol()
        for command in DRIVES:
            capture = check_capture(source.drive(command), who="drive()", after_s=stamp_s)
            assert abs(capture.stamp_s - stamp_s - command.duration_s) < 0.05, (
                f"{command.duration_s} s of driving took {capture.stamp_s - stamp_s:.3f} s by the stamps")
            stamp_s, after = capture.stamp_s, check_pose(source.truth(), who="truth()", field="world_from_body")
            moved = planar(inverse(before) @ after)
            _agrees(moved, command.travel, f"after {command} its motion")
            if capture.travel is not None:
                _agrees(capture.travel, moved, "travel of a driven view")
            clearance, touched = source.clearance_m()
            assert isinstance(touched, bool | np.bool_) and not clearance < -0.5, f"clearance_m() is {clearance}, {touched}"
            before = after
        if "teleport" in type(settings).provides:
            put = before @ se2(-0.1, 0.0, 0.3)
            source.teleport(put)
            source.drive(Twist(0.0, 0.0, 0.05))
            _agrees(planar(source.truth()), planar(put), "after teleport(pose) the pose")


def same_seed_same_views(settings: Any, folder: Path) -> None:
    def views() -> list[tuple[Capture, Any]] | None:
        if (source := _source(settings, folder, seed=2)) is None:
            return None
        with closing(source):
            return _led(source, 2)

    first, second = views(), views()
    for (a, _), (b, _) in zip(first or [], second or [], strict=True):
        assert a.stamp_s == b.stamp_s, "two builds with one seed differ in stamps"
        for name in ("image", "depth", "travel"):
            assert same(getattr(a, name), getattr(b, name)), f"two builds with one seed differ in {name}"


SOURCE = (hands_out_views_of_its_camera, travel_is_that_of_the_truth, sees_the_walls_of_the_world,
          drives_when_told_and_where_it_is_put, same_seed_same_views)
