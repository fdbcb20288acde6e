"""What changed between two pictures: hand-made pairs of a wall 3 m ahead."""

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, se2
from rhs.estimation.views.changes import DIFFERENT, GONE, NEW, Sight, compare
from rhs.estimation.views.depth_alignment import aligned
from rhs.estimation.views.references import small

CAMERA = camera_from_fov(160, 120, 57.0, height_m=1.0)
ROWS, COLUMNS = slice(50, 70), slice(70, 95)  # a thing: 20 by 25 pixels, at 2 m 0.27 m high and 0.34 m wide
RNG = np.random.default_rng(3)
PATTERN = np.clip(150 + 8 * RNG.standard_normal((120, 160, 3)), 0, 255)


def wall(*, thing: bool = False, factor: float = 1.0, image: np.ndarray = PATTERN) -> Sight:
    """A wall square to the camera, 3 m ahead, with a brown box at 2 m before it or not."""
    depth = np.full((120, 160), 3.0, np.float32)
    image = image.copy()
    if thing:
        depth[ROWS, COLUMNS] = 2.0
        image[ROWS, COLUMNS] = (120, 80, 40)
    return Sight(np.clip(np.rint(image * factor), 0, 255).astype(np.uint8), depth, CAMERA, np.eye(4))


def test_nothing_is_marked_between_equal_pictures():
    assert compare(wall(), [wall()]) == []


@pytest.mark.parametrize(("now", "before", "verdict"), [(True, False, NEW), (False, True, GONE)])
def test_a_box_put_in_or_taken_away_is_marked_within_its_outline(now, before, verdict):
    found = compare(wall(thing=now), [wall(thing=before)])
    assert [change.verdict for change in found] == [verdict]
    outline = found[0].outline(wall())
    assert outline.min(axis=0) == pytest.approx([COLUMNS.start, ROWS.start], abs=1.0)
    assert outline.max(axis=0) == pytest.approx([COLUMNS.stop - 1, ROWS.stop - 1], abs=1.0)
    pixel_m = 2.0 / CAMERA.fx
    assert found[0].width_m == pytest.approx(25 * pixel_m, rel=0.1)
    assert found[0].height_m == pytest.approx(20 * pixel_m, rel=0.1)
    assert found[0].at_m == pytest.approx([2.0, -3.0 * pixel_m, 1.0], abs=0.02)  # 2 m ahead, 3 pixels right of the middle


def test_other_light_marks_nothing_but_does_not_hide_a_box():
    assert compare(wall(factor=0.6), [wall()]) == []
    assert compare(wall(factor=1.3), [wall()]) == []
    offset = replace(wall(), image=(wall().image * 0.7 + 20).astype(np.uint8))
    assert compare(offset, [wall()]) == []
    assert [change.verdict for change in compare(wall(thing=True, factor=0.6), [wall()])] == [NEW]


@pytest.mark.parametrize("shift", [(0, 1), (1, 0), (-1, 1)])
def test_an_error_of_a_pixel_marks_nothing(shift):
    before = wall(thing=True)
    image, depth = (np.roll(array, shift, axis=(0, 1)) for array in (before.image, before.depth))
    assert compare(replace(before, image=image, depth=depth), [before]) == []


def test_a_picture_that_hangs_on_the_same_wall_now_looks_different():
    image = PATTERN.copy()
    image[40:70, 50:90] = (40, 60, 170)
    found = compare(wall(image=image), [wall()])
    assert [change.verdict for change in found] == [DIFFERENT]
    outline = found[0].outline(wall())
    assert np.all(np.abs(outline.min(axis=0) - (50, 40)) <= 3) and np.all(np.abs(outline.max(axis=0) - (89, 69)) <= 3)


def test_what_was_never_seen_is_not_called_new():
    before = wall()
    blind = before.depth.copy()
    blind[:, 60:110] = np.nan
    assert compare(wall(thing=True), [replace(before, depth=blind)]) == []


def test_what_another_earlier_picture_shows_too_is_not_new():
    """One reference lies wrong; the surfaces of the other stand."""
    assert compare(wall(thing=True), [wall(), wall(thing=True)]) == []


def test_depth_lays_a_corner_of_a_room_back_on_itself():
    """A wall 3 m ahead and one 1 m to the left, seen from a pose believed 6 cm and 2 degrees off: all is found again."""
    def corner(pose):
        rows, columns = np.indices((120, 160))
        rays = CAMERA.rays(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(float))
        direction = rays @ CAMERA.body_from_camera[:3, :3].T @ pose[:3, :3].T
        with np.errstate(divide="ignore", invalid="ignore"):
            ahead, left = (3.0 - pose[0, 3]) / direction[:, 0], (1.0 - pose[1, 3]) / direction[:, 1]
        depth = np.fmin(np.where(ahead > 0, ahead, np.inf), np.where(left > 0, left, np.inf)).reshape(120, 160)
        return depth.astype(np.float32)

    true = se2(0.1, -0.2, 0.05)
    fixed = Sight(wall().image, corner(np.eye(4)), CAMERA, np.eye(4))
    moved = Sight(wall().image, corner(true), CAMERA, se2(0.15, -0.17, 0.05 + np.radians(2)))
    assert np.abs(aligned(moved, fixed).map_from_body - true).max() < 0.01


def test_a_small_picture_shows_the_same_points():
    camera = camera_from_fov(320, 240, 57.0, height_m=1.0)
    one = small(np.full((240, 320, 3), 9, np.uint8), np.full((240, 320), 3.0, np.float32), camera=camera,
                map_from_body=np.eye(4))
    assert one.image.shape == (120, 160, 3) and one.depth.shape == (120, 160)
    half = np.tan(np.radians(57.0 / 2)) * 3.0 * 159 / 160  # the middles of the outermost pixels
    assert one.points_m[:, 1].max() == pytest.approx(half) and one.points_m[:, 0] == pytest.approx(3.0)
