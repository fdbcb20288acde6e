"""The single-image protocol: outcomes by definition, shares that add up, curves that fall."""

import numpy as np
import pytest
from painted_survey import CAMERA, FEATURES, look, ring, survey

from rhs.api.geometry import se2
from rhs.cli.say import of_places
from rhs.estimation.views.features import features
from rhs.estimation.views.place_memory import memory_of
from rhs_tasks.places.task import write_tables
from rhs_tasks.places.trial import (
    ABSTAINED,
    CORRECT,
    NEAR,
    WRONG,
    Answered,
    Query,
    judge_pose,
    judge_view,
    precision_recall,
    shares,
    trial,
)


@pytest.fixture(scope="module")
def memory():
    return memory_of(survey(ring(24), every=2))


def test_a_pose_is_judged_by_its_distance_and_angle():
    truth = se2(3.0, 1.0, 0.5)
    assert judge_pose(truth @ se2(0.2, 0.1, 0.05), truth) == CORRECT
    assert judge_pose(truth @ se2(0.3, 0.0, 0.0), truth) == NEAR
    assert judge_pose(truth @ se2(0.0, 0.0, 0.2), truth) == NEAR
    assert judge_pose(truth @ se2(1.1, 0.0, 0.0), truth) == WRONG
    assert judge_pose(None, truth) == ABSTAINED


def test_a_named_view_is_judged_by_the_view_nearest_to_the_truth(memory):
    truth = memory.poses[4] @ se2(0.1, 0.05, 0.02)
    assert judge_view(memory, 4, truth) == CORRECT
    assert judge_view(memory, 10, truth) == WRONG  # the other side of the room
    assert judge_view(memory, None, truth) == ABSTAINED


def test_in_a_room_of_different_paintings_every_method_is_right(memory):
    poses = [se2(1.4 * np.cos(a), 1.4 * np.sin(a), a + 1.6) for a in (0.4, 2.0, 3.6, 5.0)]
    queries = [Query(features(look(pose), FEATURES), CAMERA, pose) for pose in poses]
    answers = trial(memory, queries, checks=4)
    assert set(answers) == {"votes", "votes+check", "kd_tree", "kd_tree+check", "vlad", "vlad+check"}
    for given in answers.values():
        assert shares(given)[CORRECT] >= 0.75
        assert sum(shares(given).values()) == pytest.approx(1.0)
        assert shares(given)[WRONG] == 0.0


def test_the_curve_has_precision_and_recall_one_would_count_by_hand():
    answers = [Answered(CORRECT, 9.0), Answered(WRONG, 5.0), Answered(CORRECT, 3.0), Answered(ABSTAINED, 0.0)]
    np.testing.assert_allclose(precision_recall(answers), [[9, 1, 0.25], [5, 0.5, 0.25], [3, 2 / 3, 0.5]])


def test_the_table_of_a_run_shows_the_thesis_beside_every_method(tmp_path):
    write_tables(tmp_path, {"votes": [Answered(CORRECT, 1.0), Answered(WRONG, 2.0)], "sequence": [Answered(ABSTAINED, 0.0)]})
    lines = of_places(tmp_path).splitlines()
    assert lines[1].split()[2:] == ["-", "0.80", "0.08", "0.12", "-", "-"]
    assert lines[2].split() == ["votes", "2", "0.5000", "0.0000", "0.5000", "0.0000", "0.5000"]
    assert lines[3].split() == ["sequence", "1", "0.0000", "0.0000", "0.0000", "1.0000", "nan"]
