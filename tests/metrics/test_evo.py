"""Errors equal those of evo (https://github.com/MichaelGrupp/evo), run apart: it is no dependency of rhs."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from rhs.api.geometry import exp_se3
from rhs.api.trajectory import Trajectory, read_tum, write_tum
from rhs.metrics.survey import trajectory_values

EVO = r"""
import json, sys
from evo.core import metrics, sync
from evo.core.units import Unit
from evo.tools import file_interface
truth, estimate = (file_interface.read_tum_trajectory_file(p) for p in sys.argv[1:3])
truth, estimate = sync.associate_trajectories(truth, estimate, max_diff=0.02)
out = {"pairs": truth.num_poses}
def ape(trajectory):
    e = metrics.APE(metrics.PoseRelation.translation_part)
    e.process_data((truth, trajectory))
    return e.get_all_statistics()
def rpe(relation, delta, unit, of=None):
    e = metrics.RPE(relation, delta, unit, pairs_from_reference=True)
    e.process_data((truth, of or estimate))
    return e.get_all_statistics()
import copy
for name, scale in (("se3", False), ("sim3", True)):
    moved = copy.deepcopy(estimate); moved.align(truth, correct_scale=scale)
    s = ape(moved)
    out[name] = {f"ate_{word}_m": s[word] for word in ("rmse", "mean", "median", "max")}
    out[name]["rpe_trans_m"] = rpe(metrics.PoseRelation.translation_part, 1, Unit.frames, moved)["rmse"]
moved = copy.deepcopy(estimate); moved.align_origin(truth)
out["origin"] = {"ate_rmse_m": ape(moved)["rmse"]}
out["none"] = {"ate_rmse_m": ape(estimate)["rmse"]}
R = metrics.PoseRelation
out["se3"] |= {
    "rpe_rot_rad": rpe(R.rotation_angle_rad, 1, Unit.frames)["rmse"],
    "rpe_trans_per_metre_m": rpe(R.translation_part, 1.0, Unit.meters)["rmse"],
    "rpe_rot_per_metre_rad": rpe(R.rotation_angle_rad, 1.0, Unit.meters)["rmse"]}
print(json.dumps(out))
"""


def evo_python() -> str:
    """A Python that has evo: this one, or the one RHS_EVO_PYTHON names."""
    for python in (os.environ.get("RHS_EVO_PYTHON"), sys.executable):
        look = [python, "-c", "import importlib.util as u, sys; sys.exit(not u.find_spec('evo'))"]
        if python and not subprocess.run(look, timeout=60).returncode:
            return python
    pytest.skip("evo is not installed; pip install -e '.[test]', or point RHS_EVO_PYTHON at a Python that has it")


@pytest.mark.slow
def test_errors_are_those_of_evo(tmp_path):
    rng = np.random.default_rng(5)
    poses = [np.eye(4)]
    for _ in range(299):
        poses.append(poses[-1] @ exp_se3(np.array([0.2, 0, 0, 0, 0, 0.05]) + rng.normal(0, 0.03, 6)))
    truth = Trajectory(1.3e9 + np.arange(300) * 0.1, np.array(poses))
    noise = np.array([exp_se3(rng.normal(0, 0.01, 6)) for _ in range(300)])
    moved = exp_se3(np.array([3, -2, 1, 0.4, 0.2, -1.0])) @ truth.poses @ noise
    moved[:, :3, 3] *= 0.8
    keep = np.delete(np.arange(280), [4, 5, 60])
    write_tum(tmp_path / "truth.tum", truth)
    late = truth.stamps_s[keep] + rng.uniform(-0.015, 0.015, len(keep))
    write_tum(tmp_path / "estimate.tum", Trajectory(late, moved[keep]))
    files = [tmp_path / "truth.tum", tmp_path / "estimate.tum"]
    done = subprocess.run([evo_python(), "-c", EVO, *map(str, files)], capture_output=True, text=True, timeout=120,
                          env=os.environ | {"HOME": str(tmp_path)})
    assert done.returncode == 0, done.stderr
    theirs = json.loads(done.stdout)
    true, estimate = (read_tum(file) for file in files)
    assert theirs["pairs"] == 277
    for alignment in ("se3", "sim3", "origin", "none"):
        ours = trajectory_values(estimate, true, alignment=alignment)
        assert ours["ate_alignment"] == alignment
        for name, value in theirs[alignment].items():
            assert ours[name] == pytest.approx(value, abs=1e-6), (alignment, name)
    assert theirs["se3"]["ate_rmse_m"] > 0.5  # the scale is wrong: SE(3) cannot hide it, Sim(3) does
    assert theirs["sim3"]["ate_rmse_m"] < 0.1
