"""Thumbnails of views: block means, what a pose leaves unexplained, when one pose explains more than another."""

from dataclasses import replace

import numpy as np
import pytest
from painted_survey import CAMERA, FEATURES, look, ring, survey

from rhs.api.geometry import se2
from rhs.api.records import Features, Observation, Thumbnail
from rhs.estimation.views.features import features, thumbnail
from rhs.estimation.views.place_database import PlaceDatabase, PlaceRules, PlaceSettings
from rhs.estimation.views.place_memory import memory_of
from rhs.estimation.views.settings import ThumbnailSettings
from rhs.estimation.views.thumbnail_kernels import sampled
from rhs.estimation.views.thumbnails import ThumbnailFit, blocks, fit, outdoes

BESIDE = se2(1.3, 0.3, 1.9)


@pytest.fixture(scope="module")
def memory():
    return memory_of(survey(ring(24)))


def test_a_glance_holds_the_means_of_four_by_four_pixels_and_no_depth_where_one_is_unknown():
    image = np.zeros((240, 320, 3), np.uint8)
    image[:4, :4] = 200
    image[:4, 4:6] = 100
    depth = np.full((240, 320), 2.0, np.float32)
    depth[1, 9] = np.nan
    seen = thumbnail(Observation(0, 0.0, CAMERA, image=image, depth=depth))
    assert seen.grey.shape == seen.depth.shape == (60, 80)
    assert seen.grey[0, :4].tolist() == [200, 50, 0, 0]
    np.testing.assert_array_equal(np.isnan(seen.depth[0, :4]), [False, False, True, False])
    assert np.nanmax(np.abs(seen.depth - 2.0)) == 0.0
    assert thumbnail(Observation(0, 0.0, CAMERA)) is None


def test_a_picture_is_read_between_its_pixels():
    picture = np.array([[0, 10], [20, 30]], np.uint8)
    value, slope = sampled(picture, np.array([[0.5, 0.5], [0.0, 0.25], [1.2, 0.0], [np.nan, 0.0]]))
    np.testing.assert_allclose(value, [15.0, 5.0, np.nan, np.nan])
    np.testing.assert_allclose(slope, [np.hypot(10, 20), np.hypot(10, 20), np.nan, np.nan])


def test_a_stored_view_laid_over_itself_leaves_nothing_unexplained(memory):
    seen = blocks(features(look(ring(24)[3]), FEATURES).thumbnail, CAMERA)
    here = fit(memory, seen, memory.poses[3], ThumbnailSettings(views=1))
    assert here.misfit < 1e-6
    assert fit(memory, seen, memory.poses[3] @ se2(0.0, 0.1, 0.0), ThumbnailSettings(views=1)).misfit > 1.0
    assert outdoes(here, fit(memory, seen, memory.poses[9], ThumbnailSettings(views=1))) > 10.0


def test_a_picture_fits_in_other_light_and_from_beside_the_way(memory):
    seen = features(look(BESIDE), FEATURES).thumbnail
    for light in (1.0, 0.6):
        darker = Thumbnail(np.rint(light * seen.grey).astype(np.uint8), seen.depth)
        right = fit(memory, blocks(darker, CAMERA), BESIDE)
        assert right.misfit < fit(memory, blocks(darker, CAMERA), BESIDE @ se2(0.0, 0.15, 0.0)).misfit


def test_the_evidence_of_one_pose_against_another_is_the_one_computed_by_hand():
    ones, twos = ThumbnailFit(np.ones(1600), np.ones(1600)), ThumbnailFit(np.full(1600, 2.0), np.ones(1600))
    assert outdoes(ones, twos) == pytest.approx(0.5 * np.log(4.0) / np.sqrt(16 / 1600 + ThumbnailSettings().standing**2))
    assert outdoes(twos, ones) == -outdoes(ones, twos)
    assert ones.misfit == 1.0 and twos.misfit == 4.0
    nothing = ThumbnailFit(np.full(1600, np.nan), np.full(1600, np.nan))
    assert np.isnan(nothing.misfit) and np.isnan(outdoes(ones, nothing)) and np.isnan(outdoes(ones, None))


def test_by_chance_one_of_two_equally_right_poses_seldom_outdoes_the_other():
    rng = np.random.default_rng(0)
    # the root of what one mean square exceeds the other by
    worse = np.exp(ThumbnailSettings().standing * rng.standard_normal(2000))
    pairs = [[ThumbnailFit(by * np.repeat(rng.standard_normal(150), 16), np.ones(2400)) for by in (1.0, w)] for w in worse]
    assert np.mean([outdoes(a, b) > 2.33 for a, b in pairs]) == pytest.approx(0.01, abs=0.007)


def test_three_grey_levels_of_plaster_tell_two_rooms_with_the_same_paintings_apart():
    views = survey(ring(24))
    waves = 3.0 * np.sign(np.sin(np.arange(80) / 3.0))[None, :]
    twins = views + [replace(v, map_from_body=se2(20.0, 0.0, 0.0) @ v.map_from_body, features=_plastered(v.features, waves))
                     for v in views]  # fmt: skip
    database = PlaceDatabase(memory_of(twins), PlaceSettings(checks=6), np.random.default_rng(0))
    query = features(look(BESIDE), FEATURES)
    answer = database.ask(query, CAMERA)
    assert not answer.abstained and answer.best.fits(1.5) and len(answer.distinct) == 1
    assert np.linalg.norm(answer.best.map_from_body[:2, 3] - BESIDE[:2, 3]) < 0.03
    assert database.ask(replace(query, thumbnail=None), CAMERA).reason == "two places look alike"


def test_a_few_key_points_are_enough_where_the_picture_fits(memory):
    query = features(look(BESIDE), FEATURES)
    rows = np.arange(0, len(query.pixels), len(query.pixels) // 14)
    faint = Features(query.pixels[rows], query.descriptors[rows], query.points[rows], query.thumbnail)
    rules = (PlaceRules(faint_checks=n) for n in (0, 6))
    once, twice = (PlaceDatabase(memory, PlaceSettings(rules=r), np.random.default_rng(0)) for r in rules)
    assert once.ask(faint, CAMERA).abstained and twice.ask(replace(faint, thumbnail=None), CAMERA).abstained
    answer = twice.ask(faint, CAMERA)
    assert answer.best.sighting.inliers < 15
    assert np.linalg.norm(answer.best.map_from_body[:2, 3] - BESIDE[:2, 3]) < 0.1


def _plastered(known: Features, waves: np.ndarray) -> Features:
    grey = np.clip(known.thumbnail.grey + waves, 0, 255).astype(np.uint8)
    return replace(known, thumbnail=replace(known.thumbnail, grey=grey))


def test_a_place_of_few_key_points_whose_picture_is_another_is_no_answer(memory):
    query = features(look(BESIDE), FEATURES)
    noise = np.random.default_rng(0).integers(0, 255, query.thumbnail.grey.shape).astype(np.uint8)
    other = replace(query, thumbnail=Thumbnail(noise, query.thumbnail.depth))
    strict = PlaceSettings(rules=PlaceRules(misfit_inliers=10_000))
    answer = PlaceDatabase(memory, strict, np.random.default_rng(0)).ask(other, CAMERA)
    assert answer.reason == "the picture does not look like the place"
    assert not PlaceDatabase(memory, PlaceSettings(), np.random.default_rng(0)).ask(other, CAMERA).abstained
