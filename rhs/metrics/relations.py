"""Relations: how a laser log is judged whose true poses nobody knows.

A `.relations` file says of pairs of scans how the second is seen from the first, found by people who laid one scan onto the
other: `stamp1 stamp2 x y z roll pitch yaw`, metres and radians. Graphs of g2o and TORO say it of numbered poses: EDGE_SE2
and EDGE_SE3:QUAT name the first before the second, EDGE2 and EDGE3 either, which their vertices tell. The error of a
pair is the true relation undone by the believed one: its length and its turn. Source: Kuemmerle, Steder, Dornhege, Ruhnke,
Grisetti, Stachniss, Kleiner, On measuring the accuracy of SLAM algorithms, Autonomous Robots 27(4), 2009. Pairs far apart
in time are places seen again (revisits): they alone tell whether loops were closed; the others are mostly the noise of the
relations themselves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rhs.api.geometry import inverse
from rhs.api.metric import RunFiles, columns_of
from rhs.api.trajectory import Trajectory, read_tum
from rhs.base.commands import check_regular
from rhs.base.errors import RecordingError

from .survey import NAN, Values, of_any
from .trajectory_forms import EDGES, edge_of, finite_numbers, read_trajectory

REVISIT_S = 30.0  # pairs further apart in time, or in numbers, are places seen again
TWISTED = ("EDGE2", "EDGE3")  # of TORO, whose words are "observed observing", and whose files have both orders
SAME_S = 1e-3  # stamps of a relation and of a pose that are one scan's: files round them
FILE, LOG_WAY = "truth.relations", "corrected_log"  # of a run folder


@dataclass(frozen=True, eq=False)
class Relations:
    """stamps_s (N, 2) of the two scans; first_from_second (N, 4, 4)."""

    stamps_s: np.ndarray
    first_from_second: np.ndarray


def read_relations(path: Path) -> Relations:
    """Raises RecordingError naming file and line of what is no relation."""
    check_regular(path)
    rows = []
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
        table = [(number, words) for number, line in enumerate(lines, start=1)
                 if (words := line.split("#", 1)[0].replace(",", " ").split())]
        if any(words[0] in EDGES for _, words in table):
            return _of_graph(path, table)
        for number, words in table:
            if words[0][0].isalpha():
                raise RecordingError(f"{path}:{number}: found '{words[0]}'; expected lines of stamp1 stamp2 x y z roll "
                                     f"pitch yaw, or a graph with {', '.join(EDGES)}")
            rows.append(finite_numbers(words, f"{path}:{number}", 8, "stamp1 stamp2 x y z roll pitch yaw"))
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"cannot read {path} as relations: {error}") from error
    values = np.array(rows).reshape(-1, 8)
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    if len(values):
        from scipy.spatial.transform import Rotation

        poses[:, :3, :3] = Rotation.from_euler("xyz", values[:, 5:8]).as_matrix()
    poses[:, :3, 3] = values[:, 2:5]
    return Relations(values[:, :2], poses)


def _of_graph(path: Path, table: list[tuple[int, list[str]]]) -> Relations:
    """The edges of a graph. Raises RecordingError where nothing says which of the two poses of EDGE2 is seen."""
    edges = [(words[0], *edge_of(words, f"{path}:{number}")) for number, words in table if words[0] in EDGES]
    relations = Relations(np.array([numbers for _, numbers, _ in edges]), np.array([pose for _, _, pose in edges]))
    if not any(kind in TWISTED for kind, _, _ in edges):
        return relations
    if not any(words[0].startswith("VERTEX") for _, words in table):
        raise RecordingError(f"{path}: {edges[0][0]} without vertices: nothing says which of the two poses is seen from the "
                             "other; write EDGE_SE2 (or EDGE_SE3:QUAT), the second as the first sees it")
    turned = Relations(relations.stamps_s[:, ::-1], relations.first_from_second)
    own = read_trajectory(path)  # its odometry, or what somebody has solved
    return min((relations, turned), key=lambda one: _typical(own, one))


def _typical(way: Trajectory, relations: Relations) -> float:
    """Median error in metres; infinite where no pair has poses."""
    metres = relation_errors(way, relations)[0]
    return float(np.median(metres)) if len(metres) else np.inf


def relation_errors(estimate: Trajectory, relations: Relations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Metres (M,), radians (M,), and whether it is a revisit (M,), of the relations both of whose scans have a pose.

    estimate: sorted by time."""
    places = [_places(estimate.stamps_s, relations.stamps_s[:, k]) for k in (0, 1)]
    both = (places[0] >= 0) & (places[1] >= 0)
    first, second = estimate.poses[places[0][both]], estimate.poses[places[1][both]]
    wrong = inverse(relations.first_from_second[both]) @ inverse(first) @ second
    turn = np.empty(0)
    if len(wrong):
        from scipy.spatial.transform import Rotation

        turn = Rotation.from_matrix(wrong[:, :3, :3]).magnitude()
    apart_s = np.abs(relations.stamps_s[both, 1] - relations.stamps_s[both, 0])
    return np.linalg.norm(wrong[:, :3, 3], axis=1), turn, apart_s > REVISIT_S


def _places(stamps_s: np.ndarray, asked_s: np.ndarray) -> np.ndarray:
    """Place of the pose with each asked stamp; -1 where there is none."""
    if not len(stamps_s):
        return np.full(len(asked_s), -1)
    right = np.clip(np.searchsorted(stamps_s, asked_s), 1, max(len(stamps_s) - 1, 1))
    near = np.where(np.abs(stamps_s[right - 1] - asked_s) <= np.abs(stamps_s[right % len(stamps_s)] - asked_s), right - 1,
                    right % len(stamps_s))
    return np.where(np.abs(stamps_s[near] - asked_s) <= SAME_S, near, -1)


def relation_values(estimate: Trajectory | None, relations: Relations | None) -> Values:
    """The columns; NaN without relations."""
    if relations is None or not len(relations.stamps_s):
        return {**dict.fromkeys(NAMES, NAN)}
    if estimate is None:
        return {**dict.fromkeys(NAMES, NAN), "relations_share": 0.0}
    metres, radians, again = relation_errors(estimate, relations)
    degrees = np.degrees(radians)
    every, revisits = ([of_any(statistic, errors) for errors in both for statistic in (np.mean, np.std)]
                       for both in ((metres, degrees), (metres[again], degrees[again])))
    figures = [*every, of_any(np.max, metres), len(metres) / len(relations.stamps_s), float(again.sum()), *revisits]
    return dict(zip(NAMES, figures, strict=True))


def _run_values(run: RunFiles) -> Values:
    path = run.folder / FILE
    own, way = run.folder / f"{LOG_WAY}.tum", run.trajectory("corrected")
    return relation_values(read_tum(own) if own.exists() else way, read_relations(path) if path.exists() else None)


_SOURCE = "Kuemmerle et al. 2009"
_COLUMNS = (
    ("relations_trans_m", "m", "error of the published relations between scans, translation, mean", _SOURCE),
    ("relations_trans_sd_m", "m", "the same, standard deviation", _SOURCE),
    ("relations_rot_deg", "degrees", "error of the relations, rotation, mean", _SOURCE),
    ("relations_rot_sd_deg", "degrees", "the same, standard deviation", _SOURCE),
    ("relations_trans_max_m", "m", "the largest error of a relation", _SOURCE),
    ("relations_share", "share", "relations both of whose scans have a pose", _SOURCE),
    ("revisits", "", "relations between scans more than 30 s apart: places seen again", "rhs.metrics.relations"),
    ("revisits_trans_m", "m", "error of these, translation, mean", _SOURCE),
    ("revisits_trans_sd_m", "m", "the same, standard deviation", _SOURCE),
    ("revisits_rot_deg", "degrees", "error of these, rotation, mean", _SOURCE),
    ("revisits_rot_sd_deg", "degrees", "the same, standard deviation", _SOURCE),
)
NAMES = tuple(column[0] for column in _COLUMNS)
RELATIONS = columns_of(_run_values, *_COLUMNS, counts=("revisits",))
