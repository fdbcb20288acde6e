"""Do two trajectories mean the same by a pose? A quaternion with w first is a unit quaternion read with w last, too, and the
pose of the world in the camera is a pose.

Whatever is fixed on one body turns by the same angle about one axis, and goes by the same way: between two moments the
motions of estimate and truth, each seen from its own body, differ by one rotation (hand-eye calibration: Park and Martin,
IEEE Transactions on Robotics and Automation 1994; the lever between the two bodies is left out). What it leaves is small for
poses that were meant so. Where it is not, and is less than half with the one or the other read another way, that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np

from rhs.api.belief import RIGHT_M, RIGHT_RAD
from rhs.api.geometry import inverse, wrap
from rhs.api.trajectory import Trajectory

from .accuracy import Pairing, pair, relative_errors, rmse, rotation_angles

LEAST_STEPS, MOST_STEPS = 20, 500
FEW_STEPS = 6  # tell that axes are turned, where a rotation explains what moved; another reading is not told by so few
TURN_RAD = 0.1  # least median turn between two moments
CONTRADICTS, HALF = 0.5, 0.5  # share of the motions that is left; of that, and of the relative error, with another reading
LEAST_M, SAME_UNIT = 0.01, 0.1  # extent of a way that tells its unit, and by which share it may be off
MOST_SAME, MOVED_M = 0.9, 0.5  # share of beliefs that are moved alike, and how far off their middle one has to be
MIRRORED = 0.3  # of what the best move of the places leaves, that the best mirrored one leaves at most
LEAST_MIRRORED = 0.02  # of the extent of a way, that the best move leaves
AXES_DEG = 20.0  # bodies that are turned by less are taken for one


def pose_fault(estimate: Trajectory, truth: Trajectory, tolerance_s: float) -> str:
    """What is wrong with the poses of two trajectories as they were read, and what to type; empty where nothing is seen."""
    both = pair(estimate, truth, tolerance_s)
    if fault := _unit(both) or _mirrored(both):
        return fault
    steps = _steps(both.truth.poses)
    if not len(steps):
        return ""
    mine, theirs = both.estimate.poses, both.truth.poses
    told, rotation = _fit(mine, theirs, steps)
    if told <= CONTRADICTS:
        return _axes(both, steps, rotation)
    if len(steps) < LEAST_STEPS:
        return ""
    left, said = min(((_fit(read(mine), theirs, steps)[0], said) for read, said in READINGS), key=lambda one: one[0])
    if left > HALF * told:
        return ""
    return f"the poses go together only if one of the two files has {said}"


def _unit(both: Pairing) -> str:
    """That one of the two is in millimetres or centimetres, which its extent shows."""
    mine, theirs = (float(np.linalg.norm(np.std(way.positions_m, axis=0))) if len(way) else 0.0
                    for way in (both.estimate, both.truth))
    for unit, times in (("millimetres", 1000.0), ("centimetres", 100.0)):
        for small, large, name in ((mine, theirs, "truth"), (theirs, mine, "estimate")):
            if small > LEAST_M and abs(large / small / times - 1.0) < SAME_UNIT:
                return (f"the {name} is {large / small:.0f} times as large as the other: in {unit}? divide its places by "
                        f"{times:g}")
    return ""


def _mirrored(both: Pairing) -> str:
    """That the places of one are the mirror image of the other's, as of a left-handed program (Unity, Unreal); of a way on
    the floor no place tells. What the best move and the best mirrored one leave: Umeyama, PAMI 13(4), 1991."""
    if len(both.truth) < LEAST_STEPS:
        return ""
    mine, theirs = (way.positions_m - way.positions_m.mean(axis=0) for way in (both.estimate, both.truth))
    mine, theirs = (places / max(float(np.linalg.norm(places)), 1e-12) for places in (mine, theirs))
    u, s, vt = np.linalg.svd(theirs.T @ mine)
    signed = s[0] + s[1] + np.array([1.0, -1.0]) * np.sign(np.linalg.det(u @ vt)) * s[2]
    moved, mirrored = np.sqrt(np.maximum(1.0 - signed**2, 0.0))  # shares of the extent, each at its best scale
    if moved < LEAST_MIRRORED or mirrored > MIRRORED * moved:
        return ""
    return ("the places of one file are the mirror image of the other's, of left-handed axes (Unreal, Unity)? no figure "
            "means anything as read: negate y, qx and qz (Unity: z, qx and qy)")


def _in_order(order: list[int], poses: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4), the numbers of whose quaternions were read in another order."""
    from scipy.spatial.transform import Rotation

    out = poses.copy()
    out[:, :3, :3] = Rotation.from_quat(Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]).as_matrix()
    return out


# Of either file: misread alike, the two go together.
_QW = ("qw first (of EuRoC's form: last): rpe_* mean nothing; name the columns in its first line: # timestamp tx ty tz qw "
       "qx qy qz")
READINGS: tuple[tuple[Callable[[np.ndarray], np.ndarray], str], ...] = (
    (partial(_in_order, [1, 2, 3, 0]), _QW), (partial(_in_order, [3, 0, 1, 2]), _QW),  # w first, read as last; and w last
    (inverse, "the poses of the world in the body (Tcw): no figure means anything as read; invert them"),
)


def _steps(poses: np.ndarray) -> np.ndarray:
    """(M, 2) of moments between which the body turns; none where it hardly does."""
    for gap in 2 ** np.arange(12):
        first = np.arange(0, len(poses) - gap, max(1, len(poses) // MOST_STEPS))
        if len(first) < FEW_STEPS:
            break
        turned = rotation_angles((inverse(poses[first]) @ poses[first + gap])[:, :3, :3])
        if np.median(turned) >= TURN_RAD:
            return np.stack([first, first + gap], axis=1)
    return np.zeros((0, 2), int)


def _fit(mine: np.ndarray, theirs: np.ndarray, steps: np.ndarray) -> tuple[float, np.ndarray]:
    """(share of the motions (rms) that it leaves, rotation (3, 3) estimate_from_truth between the bodies by their motions,
    turns and ways of equal weight (Kabsch))."""
    a, b = _motions(mine, steps), _motions(theirs, steps)
    weights = 1.0 / np.maximum(np.sqrt(np.mean(a * a, axis=1) * np.mean(b * b, axis=1)).mean(axis=-1), 1e-12)
    u, _, vt = np.linalg.svd(sum(w * x.T @ y for w, x, y in zip(weights, a, b, strict=True)))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    left = [np.mean((x - y @ rotation.T) ** 2) / max(np.mean(x * x), np.mean(y * y), 1e-12)
            for x, y in zip(a, b, strict=True)]
    return float(np.sqrt(np.mean(left))), rotation


def _motions(poses: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """(2, M, 3) rotation vectors and ways between moments, from the body at the first."""
    from scipy.spatial.transform import Rotation

    moved = inverse(poses[steps[:, 0]]) @ poses[steps[:, 1]]
    return np.stack([Rotation.from_matrix(moved[:, :3, :3]).as_rotvec(), moved[:, :3, 3]])


def _axes(both: Pairing, steps: np.ndarray, rotation: np.ndarray) -> str:
    """That the two are bodies turned to each other, where relative errors are mostly that."""
    angle = float(np.degrees(rotation_angles(rotation[None])[0]))
    if angle < AXES_DEG:
        return ""
    turned = both.estimate.poses.copy()
    turned[:, :3, :3] = turned[:, :3, :3] @ rotation
    told, without = ([rmse(errors) for errors in relative_errors(replace(both, estimate=replace(both.estimate, poses=poses)),
                                                                 steps)] for poses in (both.estimate.poses, turned))
    if all(better > HALF * worse for better, worse in zip(without, told, strict=True)):  # of ways, and of turns
        return ""
    return (f"the poses of the two are of axes turned by {angle:.0f} degrees to each other (a camera's beside a robot's?): "
            "rpe_* and end_error_* are mostly that; the ATE is of positions and stands")


def moved_fault(belief: Trajectory, truth: Trajectory) -> str:
    """That a localiser's poses are the true ones moved on the floor, all but a few by the same: truth and map are of two
    frames, or two places look alike. Empty where they agree, or differ otherwise."""
    both = pair(belief, truth, 0.0)
    if len(both.truth) < LEAST_STEPS:
        return ""
    mine, theirs = (np.arctan2(way.poses[:, 1, 0], way.poses[:, 0, 0]) for way in (both.estimate, both.truth))
    turns = wrap(theirs - mine)
    turn = float(np.arctan2(np.median(np.sin(turns)), np.median(np.cos(turns))))
    c, s = np.cos(turn), np.sin(turn)
    moves = both.truth.positions_m[:, :2] - both.estimate.positions_m[:, :2] @ np.array([[c, s], [-s, c]])
    move = np.median(moves, axis=0)
    off = np.hypot(*(both.truth.positions_m - both.estimate.positions_m)[:, :2].T)
    same = (np.hypot(*(moves - move).T) < RIGHT_M) & (np.abs(wrap(turns - turn)) < RIGHT_RAD)
    if same.mean() < MOST_SAME or np.median(off) < MOVED_M:
        return ""
    return (f"the belief is the truth moved by ({-move[0]:.2f}, {-move[1]:.2f}) m and turned by {-np.degrees(turn):.0f} "
            "degrees all along: the truth is of another frame than the map, and figures that hold the two together mean "
            "nothing (of a run's map type map=RUN_FOLDER), or two places look alike")
