"""Shared features: computed once, lifted to where the scene really is, and calm about views that show nothing."""

from __future__ import annotations

import weakref
from dataclasses import replace

import numpy as np
from painted_room import observe, paintings

from rhs.api.geometry import camera_from_fov, inverse, se2, transform
from rhs.api.records import Features, FeatureSettings, Observation
from rhs.api.spare import grant
from rhs.estimation.views import features as vision
from rhs.estimation.views.packed import held_bytes, packed

CAMERA = camera_from_fov(320, 240, 57.0, height_m=1.0)
SETTINGS = FeatureSettings()


def view(pose=None):
    return observe(CAMERA, se2(0.0, 0.0, 0.3) if pose is None else pose, paintings())


def test_features_are_computed_once_per_observation_and_settings():
    observation = view()
    first = vision.features(observation, SETTINGS)
    assert vision.features(observation, SETTINGS) is first
    assert vision.features(observation, FeatureSettings(count=50)) is not first
    assert not first.points.flags.writeable


def test_key_points_asked_of_every_view_are_foreseen_and_the_same():
    views = [replace(view(), index=i) for i in range(4)]
    alone = vision.features(replace(views[3]), SETTINGS)
    grant(True)
    try:
        for i in (0, 1):
            vision.foresee(views[i])
            assert views[i] not in vision._shared  # nothing was asked of two views in a row before
            vision.features(views[i], SETTINGS)
        vision.foresee(views[3])
        assert list(vision._shared[views[3]]) == [SETTINGS]
        foreseen = vision.features(views[3], SETTINGS)
    finally:
        grant(False)
    assert vision.features(views[3], SETTINGS) is foreseen
    assert len(alone.pixels) > 50
    assert np.array_equal(alone.pixels, foreseen.pixels) and np.array_equal(alone.descriptors, foreseen.descriptors)


def test_key_points_asked_of_every_third_view_are_not_foreseen():
    grant(True)
    try:
        for i in (10, 13, 16):
            vision.features(replace(view(), index=i), SETTINGS)
        later = replace(view(), index=17)
        vision.foresee(later)
        assert later not in vision._shared
    finally:
        grant(False)


def test_a_view_that_is_forgotten_takes_its_foreseen_key_points_along():
    for i in (20, 21):
        vision.features(replace(view(), index=i), SETTINGS)
    seen = replace(view(), index=22)
    grant(True)
    try:
        vision.foresee(seen)
        vision.features(seen, SETTINGS)
    finally:
        grant(False)
    gone = weakref.ref(seen)
    del seen
    assert gone() is None


def test_packed_key_points_are_the_same_to_the_bit_in_a_third_of_the_memory():
    found = vision.features(view(), SETTINGS)
    kept = packed(replace(found, thumbnail=None))
    assert np.array_equal(kept.descriptors, found.descriptors) and np.allclose((kept.descriptors**2).sum(axis=1), 1.0)
    assert 3 * held_bytes(kept) < held_bytes(replace(found, thumbnail=None, sift=None))
    moved = replace(kept, points=kept.points + 1.0)
    assert np.array_equal(moved.descriptors, found.descriptors) and held_bytes(moved) == held_bytes(kept)
    theirs = Features(found.pixels, found.descriptors, found.points)  # a stranger's, of whom nobody knows such bytes
    assert packed(theirs) is theirs


def test_descriptors_have_unit_length():
    features = vision.features(view(), SETTINGS)
    assert features.descriptors.dtype == np.float32
    assert np.allclose(np.linalg.norm(features.descriptors, axis=1), 1.0, atol=1e-5)


def test_count_grows_with_the_image():
    large = camera_from_fov(640, 480, 57.0, height_m=1.0)
    settings = FeatureSettings(count=50)
    small_count = len(vision.features(view(), settings).pixels)
    large_count = len(vision.features(observe(large, se2(0, 0, 0.3), paintings()), settings).pixels)
    assert 50 <= small_count <= 55  # OpenCV keeps ties
    assert 200 <= large_count <= 210


def test_a_large_picture_is_looked_at_made_smaller():
    """Every pixel four times over: the same key-points, where they are in the large picture."""
    seen = view()
    camera = replace(CAMERA, width=640, height=480, fx=2 * CAMERA.fx, fy=2 * CAMERA.fy, cx=2 * CAMERA.cx + 0.5,
                     cy=2 * CAMERA.cy + 0.5)
    large = replace(seen, camera=camera, image=seen.image.repeat(2, axis=0).repeat(2, axis=1),
                    depth=seen.depth.repeat(2, axis=0).repeat(2, axis=1))
    ours, theirs = vision.features(seen, FeatureSettings(count=400)), vision.features(large, FeatureSettings(count=100))
    assert len(ours.pixels) > 100 and np.array_equal(ours.sift, theirs.sift)
    assert np.allclose(theirs.pixels + 0.5, 2.0 * (ours.pixels + 0.5), atol=1e-4)
    known = np.isfinite(ours.points[:, 2]) & np.isfinite(theirs.points[:, 2])
    assert known.sum() > 50 and np.abs(ours.points - theirs.points)[known].max() < 0.05


def test_a_view_without_key_points_has_none():
    grey = np.full((240, 320, 3), 128, np.uint8)
    depth = np.full((240, 320), 2.0, np.float32)
    for observation in (Observation(0, 0.0, CAMERA, grey, depth), Observation(0, 0.0, CAMERA)):
        for found in (vision.features(observation, SETTINGS), vision.orb_features(observation)):
            assert found.pixels.shape == (0, 2)
            assert found.points.shape == (0, 3)
            assert vision.match(found, found, 0.8).shape == (0, 2)


def test_unknown_depth_gives_unknown_points():
    observation = view()
    blind = Observation(0, 0.0, CAMERA, observation.image, np.full((240, 320), np.nan, np.float32))
    assert np.isnan(vision.features(blind, SETTINGS).points).all()
    assert np.isnan(vision.features(Observation(0, 0.0, CAMERA, observation.image), SETTINGS).points).all()


def test_matched_points_of_two_views_are_the_same_places():
    """Lifted with their depth and moved by the true motion, matched key-points coincide to a couple of centimetres."""
    a_pose, b_pose = se2(0.0, 0.0, 0.3), se2(0.2, 0.05, 0.4)
    for extract in (lambda o: vision.features(o, SETTINGS), vision.orb_features):
        a, b = extract(view(a_pose)), extract(view(b_pose))
        rows = vision.match(a, b, 0.8)
        extrinsics = CAMERA.body_from_camera
        moved = transform(inverse(a_pose @ extrinsics) @ b_pose @ extrinsics, b.points[rows[:, 1]].astype(float))
        error = np.linalg.norm(moved - a.points[rows[:, 0]], axis=1)
        assert len(rows) > 60
        assert np.nanmedian(error) < 0.02
        assert np.nanmean(error < 0.05) > 0.9


def test_matching_follows_the_ratio_and_mutual_rules():
    """Three descriptors of two dimensions, distances computed by hand."""
    unit = lambda degrees: np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))], np.float32)  # noqa: E731
    a = Features(np.zeros((2, 2)), np.stack([unit(0), unit(2)]), np.zeros((2, 3)))
    b = Features(np.zeros((2, 2)), np.stack([unit(1.9), unit(60)]), np.zeros((2, 3)))
    assert vision.match(a, b, 0.8).tolist() == [[1, 0]]  # a0 also likes b0 best, but b0 is nearer to a1
    assert vision.match(a, b, 0.8, mutual=False).tolist() == [[0, 0], [1, 0]]
    assert vision.match(a, b, 0.001).tolist() == []  # 0.1 degrees is not a thousand times nearer than 58


def test_orb_distance_counts_differing_bits():
    a = np.array([[0b1010_0000], [0]], np.uint8)
    b = np.array([[0b1000_0001]], np.uint8)
    assert vision._distances(a, b).tolist() == [[2.0], [2.0]]


def test_depth_is_exact_between_pixels_of_a_slanted_plane():
    """Inverse depth 0.2 + 0.001 u + 0.0005 v is a plane; a sub-pixel position reads it exactly."""
    v, u = np.mgrid[0:60, 0:80]
    depth = (1.0 / (0.2 + 0.001 * u + 0.0005 * v)).astype(np.float32)
    pixels = np.array([[20.3, 30.7], [60.5, 10.1], [0.2, 0.4]])
    expected = 1.0 / (0.2 + 0.001 * pixels[:, 0] + 0.0005 * pixels[:, 1])
    assert np.allclose(vision.depth_at(depth, pixels)[:2], expected[:2], rtol=1e-5)
    assert np.isnan(vision.depth_at(depth, pixels)[2])  # too much of its window lies outside the image


def test_occlusion_edges_are_found_and_slanted_walls_are_none():
    """A box 2 m away before a wall at 4 m: pixels away from its edge count their distance to it."""
    depth = np.full((40, 60), 4.0, np.float32)
    depth[:, 30:] = 2.0
    distance = vision.occlusion_distance(depth)
    assert abs(distance[20, 10] - 19.0) < 0.5  # both sides of the edge belong to it: columns 29 and 30
    assert distance[20, 30] == 0.0
    wall = (1.0 / (0.125 + 0.003 * np.arange(60)) * np.ones((40, 1))).astype(np.float32)  # from 8 m to 3.3 m
    assert np.isinf(vision.occlusion_distance(wall)).all()
    assert np.isinf(vision.occlusion_distance(np.full((40, 60), np.nan, np.float32))).all()


def test_few_key_points_over_edges_lose_their_depth_many_keep_it():
    """A board in front of the right of the painted wall: those near its edge go. A fence of 13 boards: all stay."""
    observation = view()
    for boards, lost in (([(220, 320)], True), ([(left, left + 12) for left in range(10, 310, 24)], False)):
        depth = observation.depth.copy()
        for left, right in boards:
            depth[:, left:right] *= 0.5
        features = vision.features(Observation(0, 0.0, CAMERA, observation.image, depth), SETTINGS)
        readable = np.isfinite(vision.depth_at(depth, features.pixels.astype(float)))
        assert readable.sum() > 100
        assert np.isnan(features.points[readable, 2]).any() == lost


def test_depth_at_an_edge_is_unknown():
    depth = np.full((40, 40), 2.0, np.float32)
    depth[:, 20:] = 4.0
    found = vision.depth_at(depth, np.array([[20.0, 20.0], [10.0, 20.0], [30.0, 20.0]]))
    assert np.isnan(found[0])
    assert np.allclose(found[1:], [2.0, 4.0])


def test_orb_sees_the_same_points_in_a_mirror():
    """OpenCV scales coarse key-points from the corner of the image, which moves them a pixel to the left and up; mirrored
    the other way. Put right, both agree (compared at the coarse levels, 60 pixels of diameter and more)."""
    seen = view()
    mirrored = Observation(1, 0.1, CAMERA, np.ascontiguousarray(seen.image[:, ::-1]), seen.depth)
    found = []
    for observation in (seen, mirrored):
        detector = vision._detector("orb", 500, 0.0)
        pixels, sizes, _ = vision._detect(observation, detector, np.empty((0, 32), np.uint8), ratio=vision.ORB_RATIO)
        found.append((pixels.astype(float), sizes))
    (straight, sizes), (other, other_sizes) = found
    other[:, 0] = CAMERA.width - 1 - other[:, 0]
    off = []
    for pixel, size in zip(straight[sizes > 60], sizes[sizes > 60], strict=True):
        away = other[np.abs(other_sizes - size) < 1e-3] - pixel
        nearest = away[np.hypot(*away.T).argmin()]
        if np.hypot(*nearest) < 4:
            off.append(nearest[0])
    assert len(off) > 50 and abs(np.mean(off)) < 0.5
