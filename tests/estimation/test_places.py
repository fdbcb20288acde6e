"""The place database in a room rendered exactly: right poses, honest abstention, files without pickle."""

from dataclasses import replace

import numpy as np
import pytest
from painted_room import observe, paintings
from painted_survey import CAMERA, FEATURES, look, ring, survey

from rhs.api.errors import RecordingError
from rhs.api.geometry import inverse, log_se3, se2
from rhs.api.records import Features
from rhs.estimation.views.explainability import expected
from rhs.estimation.views.features import features
from rhs.estimation.views.place_database import PlaceDatabase, PlaceSettings, shares
from rhs.estimation.views.place_files import load, save
from rhs.estimation.views.place_memory import memory_of, packed, unpacked
from rhs.estimation.views.view_pose import SightingSettings, Snapshot, sight


@pytest.fixture(scope="module")
def memory():
    return memory_of(survey(ring(24)))


def _error(found, truth):
    gap = log_se3(inverse(truth) @ found)
    return np.linalg.norm(gap[:3]), np.linalg.norm(gap[3:])


@pytest.mark.parametrize("retrieval", ["votes", "kd_tree", "vlad"])
def test_a_view_between_the_stored_ones_is_located_to_centimetres(memory, retrieval):
    database = PlaceDatabase(memory, PlaceSettings(retrieval), np.random.default_rng(0))
    for pose in (se2(1.3, 0.3, 1.9), se2(-1.4, -0.6, -1.0)):
        answer = database.ask(features(look(pose), FEATURES), CAMERA)
        distance_m, angle_rad = _error(answer.best.map_from_body, pose)
        assert distance_m < 0.03 and angle_rad < 0.01
        sigma = np.sqrt(np.diag(answer.best.covariance))
        assert np.all(sigma > 0) and sigma[0] < 0.2


@pytest.mark.parametrize("retrieval", ["votes", "kd_tree", "vlad"])
def test_a_stored_view_asked_again_names_itself_first(memory, retrieval):
    database = PlaceDatabase(memory, PlaceSettings(retrieval), np.random.default_rng(0))
    for place in (0, 5, 11):
        assert database.ask(memory.features(place), CAMERA).ranked[0] in (place, (place + 24) % 48)


def test_a_room_never_seen_is_not_recognised(memory):
    database = PlaceDatabase(memory, PlaceSettings(), np.random.default_rng(0))
    elsewhere = observe(CAMERA, se2(0.5, 0.5, 0.7), paintings(seed=99))
    answer = database.ask(features(elsewhere, FEATURES), CAMERA)
    assert answer.abstained and answer.reason


def test_a_blank_view_and_an_empty_memory_abstain(memory):
    nothing = Features(np.empty((0, 2), np.float32), np.empty((0, 128), np.float32), np.empty((0, 3), np.float32))
    database = PlaceDatabase(memory, PlaceSettings(), np.random.default_rng(0))
    assert database.ask(nothing, CAMERA).abstained
    empty = PlaceDatabase(memory_of([]), PlaceSettings(), np.random.default_rng(0))
    assert empty.ask(features(look(se2(0.5, 0.5, 0.7)), FEATURES), CAMERA).reason == "nothing stored"


def test_two_rooms_hung_with_the_same_paintings_make_it_abstain():
    views = survey(ring(24))
    twins = views + [replace(v, map_from_body=se2(20.0, 0.0, 0.0) @ v.map_from_body) for v in views]
    database = PlaceDatabase(memory_of(twins), PlaceSettings(checks=6), np.random.default_rng(0))
    answer = database.ask(features(look(se2(1.3, 0.3, 1.9)), FEATURES), CAMERA)
    assert answer.abstained and answer.reason == "two places look alike"
    assert len(answer.distinct) == 2
    np.testing.assert_allclose(shares(answer.distinct), 0.5)


def test_without_depth_in_the_query_the_pose_comes_from_pnp():
    stored, query = features(look(se2(1.5, 0.0, 1.6)), FEATURES), features(look(se2(1.4, 0.3, 1.8)), FEATURES)
    flat = Features(query.pixels, query.descriptors, np.full_like(query.points, np.nan))
    rng = np.random.default_rng(0)
    truth = inverse(se2(1.5, 0.0, 1.6)) @ se2(1.4, 0.3, 1.8)
    settings = SightingSettings(min_inliers=12)
    for a, b in ((stored, flat), (Features(stored.pixels, stored.descriptors, np.full_like(stored.points, np.nan)), query)):
        seen = sight(Snapshot(a, CAMERA), Snapshot(b, CAMERA), settings=settings, rng=rng)
        distance_m, angle_rad = _error(seen.stored_from_query, truth)
        assert distance_m < 0.04 and angle_rad < 0.015
    nobody = Features(stored.pixels, stored.descriptors, np.full_like(stored.points, np.nan))
    assert sight(Snapshot(nobody, CAMERA), Snapshot(flat, CAMERA), settings=settings, rng=rng) is None


def test_key_points_that_crowd_on_two_spots_fix_no_pose():
    spots = np.array([[0.3, 0.1, 2.0], [-0.4, 0.2, 3.0]])
    here, there = [0, 0, 1, 1, 0, 0, 0, 0, 1, 1], [0, 0, 1, 1, 0, 1, 1, 1, 1, 0]
    words = np.zeros((10, 128), np.float32)
    stored = Features(CAMERA.project(spots[here]), words, spots[here])
    query = Features(CAMERA.project(spots[there]), words, np.full((10, 3), np.nan))
    pairs, settings = np.tile(np.arange(10)[:, None], 2), SightingSettings(min_inliers=6)
    rng = np.random.default_rng(0)
    assert sight(Snapshot(stored, CAMERA), Snapshot(query, CAMERA), settings=settings, rng=rng, pairs=pairs) is None


def test_coverage_is_high_at_the_same_place():
    stored, query = features(look(se2(1.5, 0.0, 1.6)), FEATURES), features(look(se2(1.5, 0.1, 1.6)), FEATURES)
    rng = np.random.default_rng(0)
    seen = sight(Snapshot(stored, CAMERA), Snapshot(query, CAMERA), settings=SightingSettings(), rng=rng)
    assert seen.coverage > 0.3


def test_bytes_keep_rootsift_to_one_percent():
    rows = features(look(se2(1.5, 0.0, 1.6)), FEATURES).descriptors
    assert np.abs((unpacked(packed(rows)) * rows).sum(axis=1) - 1.0).max() < 0.01


def test_a_memory_is_written_and_read_back_the_same(memory, tmp_path):
    path = tmp_path / "places.npz"
    save(memory, path)
    back = load(path)
    np.testing.assert_array_equal(back.poses, memory.poses)
    np.testing.assert_array_equal(back.descriptors, memory.descriptors)
    np.testing.assert_array_equal(back.camera.matrix, memory.camera.matrix)
    np.testing.assert_array_equal(back.greys, memory.greys)
    assert memory.greys.shape == (len(memory), 60, 80)
    assert [p.name for p in tmp_path.iterdir()] == ["places.npz"]


def test_a_memory_of_before_views_were_kept_at_a_glance_is_still_read(memory, tmp_path):
    save(memory, tmp_path / "new.npz")
    with np.load(tmp_path / "new.npz") as file:
        np.savez(tmp_path / "old.npz", **{name: file[name] for name in file.files if name != "greys"})
    old = PlaceDatabase(load(tmp_path / "old.npz"), PlaceSettings(), np.random.default_rng(0))
    answer = old.ask(features(look(se2(1.3, 0.3, 1.9)), FEATURES), CAMERA)
    assert answer.best.fit is None and _error(answer.best.map_from_body, se2(1.3, 0.3, 1.9))[0] < 0.03


def test_pickles_and_rubbish_are_refused_by_name(memory, tmp_path):
    rubbish = tmp_path / "rubbish.npz"
    rubbish.write_bytes(b"not a zip")
    with pytest.raises(RecordingError, match="rubbish.npz"):
        load(rubbish)
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, format=np.array(1), poses=np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordingError, match="pickled.npz"):
        load(pickled)
    with pytest.raises(RecordingError, match="absent.npz"):
        load(tmp_path / "absent.npz")


def test_a_view_that_lies_further_than_depth_is_measured_is_not_expected_to_be_recognised(memory):
    """A pose is found by points alone: in the middle of a hall most key-points of a stored view are none."""
    pose, query = memory.poses[3], memory.features(3)
    assert expected(memory, query, pose)
    points = memory.points.copy()
    points[np.arange(len(points)) % 10 > 0] = np.nan
    assert not expected(replace(memory, points=points), query, pose)
    one_eye = replace(memory, points=np.full_like(points, np.nan))
    assert expected(one_eye, query, pose)
