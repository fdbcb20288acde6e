"""What a source tells every other part is looked at before anything runs."""

from dataclasses import replace

import numpy as np
import pytest

from rhs.api.errors import ContractError
from rhs.api.geometry import camera_from_fov
from rhs.api.records import WorldFacts
from rhs.api.validate_source import check_camera, check_facts

CAMERA = camera_from_fov(320, 240, 60.0, height_m=1.0)
FACTS = WorldFacts("room", (0.0, 0.0, 0.0), (("desk", 1.0, 2.0),), (-1.0, -1.0, 3.0, 3.0), 0.2)


def test_what_is_right_passes():
    assert check_camera(CAMERA, who="source=x") is CAMERA
    assert check_facts(FACTS, who="source=x") is FACTS


@pytest.mark.parametrize("wrong", [
    {"width": 320.0}, {"height": 0}, {"fx": -300.0}, {"fy": float("nan")}, {"cx": "159"}, {"skew": np.eye(4)},
    {"distortion": (0.1,)}, {"distortion": np.zeros(5)}, {"body_from_camera": np.zeros((4, 4))}, {"readout_s": -1.0}])
def test_a_camera_that_none_can_be_is_refused(wrong):
    (field, _), = wrong.items()
    with pytest.raises(ContractError, match=f"source=x: camera.{field} is .*expected") as refused:
        check_camera(replace(CAMERA, **wrong), who="source=x")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("wrong", [
    {"start": (0.0, 0.0)}, {"places": (("desk", 1.0),)}, {"places": ((1.0, 1.0, 2.0),)},
    {"bounds_m": (3.0, -1.0, -1.0, 3.0)}, {"bounds_m": (0.0, 0.0, np.inf, 1.0)}, {"robot_radius_m": -0.1}])
def test_facts_that_none_can_be_are_refused(wrong):
    (field, _), = wrong.items()
    with pytest.raises(ContractError, match=f"source=x: facts.{field} is .*expected"):
        check_facts(replace(FACTS, **wrong), who="source=x")
