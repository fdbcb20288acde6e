"""Views that lie in a file come back as they were, and take no memory while they lie there."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from rhs.api.geometry import camera_from_fov, se2
from rhs.api.records import Features, Motion, Scan, Tracking, View
from rhs.estimation.kept_views import ChangedViews, KeptViews
from rhs.estimation.views.packed import held_bytes, packed, rooted

CAMERA = camera_from_fov(32, 24, 60.0, height_m=1.0)


def view(k: int, beams: int = 160) -> View:
    rng = np.random.default_rng(k)
    scan = Scan(np.linspace(-0.5, 0.5, beams), rng.uniform(0.5, 4.0, beams), 5.0)
    motion = Motion(se2(0.1, 0.0, 0.01 * k), np.eye(6) * rng.random(), Tracking.OK, details={"inliers": 7.0})
    return View(k, 0.1 * k, CAMERA, motion, se2(0.1 * k, 0.0, 0.0), np.eye(6) * k, scan, None, scan)


def features(k: int, count: int = 300) -> Features:
    rng = np.random.default_rng(k)
    sift = rng.integers(0, 255, (count, 128), dtype=np.uint8)
    return packed(Features(rng.random((count, 2), np.float32), rooted(sift), rng.random((count, 3), np.float32), sift=sift))


def test_a_view_comes_back_the_same_to_the_bit_and_cannot_be_written_to(tmp_path):
    kept, given = KeptViews(tmp_path), [view(k) for k in range(5)]
    for each in given:
        kept.append(each)
    kept.keep_features(2, features(2))
    assert len(kept) == 5 and [each.index for each in kept] == [0, 1, 2, 3, 4] == [each.index for each in kept[:]]
    for k, (back, one) in enumerate(zip(kept, given, strict=True)):
        assert back.camera is CAMERA and (back.features is not None) == (k == 2) and back.obstacle is back.scan
        assert back.motion.status is Tracking.OK and back.motion.details == {"inliers": 7.0}
        for a, b in ((back.scan.ranges_m, one.scan.ranges_m), (back.covariance, one.covariance),
                     (back.motion.covariance, one.motion.covariance), (back.map_from_body, one.map_from_body)):
            assert np.array_equal(a, b) and a.dtype == b.dtype and not a.flags.writeable
    seen = kept[2].features
    assert np.array_equal(seen.descriptors, features(2).descriptors) and held_bytes(seen) == held_bytes(features(2))
    assert not seen.sift.flags.writeable and not list(tmp_path.iterdir()), "the file has no name"
    with pytest.raises(IndexError):
        kept[5]


def test_a_thousand_views_with_key_points_take_less_than_a_megabyte(tmp_path):
    """They are 5 MB of scans and 13 MB of key-points; what is given up makes room for others in the file."""
    kept, some, seen = KeptViews(tmp_path), [view(k) for k in range(10)], features(0)
    tracemalloc.start()
    for k in range(1000):
        kept.append(some[k % 10])
        if k % 3 == 0:
            kept.keep_features(k, seen)
    grown, size = tracemalloc.get_traced_memory()[0], kept._end
    tracemalloc.stop()
    assert grown < 1e6 and size > 15e6
    kept.forget_features(3)
    kept.keep_features(4, seen)
    assert kept._end == size and kept[3].features is None and np.array_equal(kept[4].features.pixels, seen.pixels)


def test_what_cannot_be_written_stays_in_memory():
    """A part from elsewhere may hand over any mapping."""
    kept = KeptViews()
    kept.append(replace(view(0), motion=replace(view(0).motion, details=MappingProxyType({"inliers": 3.0}))))
    assert kept[-1].motion.details["inliers"] == 3.0 and kept[0].camera is CAMERA


def test_changed_views_are_made_where_they_are_looked_at():
    asked = []
    moved = ChangedViews([view(0), view(1)], lambda k, each: asked.append(k) or replace(each, stamp_s=9.0 + k))
    assert len(moved) == 2 and not asked
    assert moved[-1].stamp_s == 10.0 and asked == [1]
