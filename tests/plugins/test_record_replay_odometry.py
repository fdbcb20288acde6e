"""Record, then replay: every odometry gives the same motions, bit for bit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.synthetic_run import FACTS, make_steps
from painted_room import observe, paintings

from rhs.api.contracts import Context, FeatureSettings
from rhs.api.geometry import camera_from_fov, se2
from rhs.api.randomness import generator
from rhs.config import registry
from rhs.recording.writer import Recorder
from rhs_sources.replay_config import Replay

CAMERA = camera_from_fov(160, 120, 60.0, height_m=1.0)
STARTS = [se2(1.2 + 0.04 * k, 0.3, 0.6 + 0.03 * k) for k in range(6)]


def context(part, camera):
    return Context(generator(0, part), camera, FACTS, None, FeatureSettings())


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """The observations of six views of a painted room with wheels, and the file they were recorded to."""
    textures, wheel = paintings(), np.array([0.04, 0.001, 0.03])
    seen = [replace(observe(CAMERA, pose, textures, k), wheel=wheel) for k, pose in enumerate(STARTS)]
    path = tmp_path_factory.mktemp("record") / "run.mcap"
    recorder = Recorder(path, "full", CAMERA, FACTS)
    for step, observation in zip(make_steps(6, camera=CAMERA), seen, strict=True):
        recorder.step(replace(step, stamp_s=observation.stamp_s, observation=observation))
    recorder.close()
    return seen, path


@pytest.mark.parametrize("name", ["procrustes", "orb", "keyframe", "gicp", "kiss_icp", "wheel"])
def test_replayed_views_give_the_same_motions(recorded, name):
    seen, path = recorded
    source = Replay(path=str(path)).build(None)
    sensor = registry.load("sensor", "rgbd")().build(context("sensor", source.camera))
    first, again = (registry.load("odometry", name)().build(context("odometry", CAMERA)) for _ in range(2))
    moved = 0.0
    for observation in seen:
        once, twice = first.update(observation), again.update(sensor.sense(source.lead()))
        np.testing.assert_array_equal(once.previous_from_body, twice.previous_from_body)
        np.testing.assert_array_equal(once.covariance, twice.covariance)
        assert once.status is twice.status
        moved += once.previous_from_body[0, 3]
    source.close()
    assert moved > 0.1
