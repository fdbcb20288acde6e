"""Errors of relations between scans, by cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rhs.api.geometry import se2
from rhs.api.trajectory import Trajectory, write_tum
from rhs.base.errors import RecordingError
from rhs.cli.evaluate import main
from rhs.metrics.relations import read_relations, relation_values

# The robot believes it drove 1 m east, turned left by a right angle and drove 2 m north, and was there again 40 s later.
WAY = Trajectory(np.array([10.0, 11.0, 12.0, 51.0]), np.array([se2(0, 0, 0), se2(1, 0, np.pi / 2), se2(1, 2, np.pi / 2),
                                                               se2(1, 0.3, np.pi / 2)]))
# True: 1.1 m east (0.1 m wrong); 2 m ahead, 0.2 rad to the left (0.2 rad wrong); the revisit 0.3 m wrong; one scan unknown.
FILE = f"""10 11 1.1 0 0 0 0 {np.pi / 2}
11 12 2 0 0 0 0 0.2
11 51 0 0 0 0 0 0
# a comment
11 99 0 0 0 0 0 0
"""


def written(tmp_path, text=FILE):
    path = tmp_path / "walk.relations"
    path.write_text(text)
    return path


def test_errors_of_three_relations_computed_by_hand(tmp_path):
    values = relation_values(WAY, read_relations(written(tmp_path)))
    assert values["relations_trans_m"] == pytest.approx((0.1 + 0.0 + 0.3) / 3)
    assert values["relations_trans_max_m"] == pytest.approx(0.3)
    assert values["relations_rot_deg"] == pytest.approx(np.degrees(0.2) / 3, abs=1e-5)
    assert values["relations_share"] == pytest.approx(3 / 4)
    assert values["revisits"] == 1 and values["revisits_trans_m"] == pytest.approx(0.3)


def test_the_command_prints_them(tmp_path, capsys):
    write_tum(tmp_path / "est.tum", WAY)
    assert main([str(tmp_path / "est.tum"), "--relations", str(written(tmp_path))]) == 0
    lines = dict(line.split() for line in capsys.readouterr().out.splitlines())
    assert float(lines["relations_trans_m"]) == pytest.approx(0.4 / 3, rel=1e-5)


def test_relations_of_another_recording_are_said_to_be_none_of_this_one(tmp_path, capsys):
    write_tum(tmp_path / "est.tum", WAY)
    assert main([str(tmp_path / "est.tum"), "--relations", str(written(tmp_path, "900 901 1 0 0 0 0 0\n"))]) == 3
    assert "0.0% of the relations" in capsys.readouterr().err


def test_a_line_that_is_no_relation_is_refused_with_its_place(tmp_path):
    with pytest.raises(RecordingError, match=r"walk\.relations:1: found '1 2 three'"):
        read_relations(written(tmp_path, "1 2 three\n"))


def test_windows_line_ends_a_mark_before_the_text_and_commas_are_no_fault(tmp_path, capsys):
    plain = read_relations(written(tmp_path))
    (tmp_path / "walk.relations").write_bytes(b"\xef\xbb\xbf" + FILE.replace(" ", ", ").replace("\n", "\r\n").encode())
    assert np.array_equal(read_relations(tmp_path / "walk.relations").first_from_second, plain.first_from_second)
    write_tum(tmp_path / "est.tum", WAY)
    assert main([str(tmp_path / "est.tum"), "--relations", str(written(tmp_path, "1 2 three\n"))]) == 2
    assert "walk.relations:1: found '1 2 three'" in capsys.readouterr().err


# As above by the numbers of the poses: 1.1 m east; 2 m ahead, 0.2 rad to the left; pose 41 again where 1 is.
EDGES = f"EDGE_SE2 0 1 1.1 0 {np.pi / 2} 1 0 0 1 0 1\nEDGE_SE2 1 2 2 0 0.2 1 0 0 1 0 1\nEDGE_SE2 1 41 0 0 0 1 0 0 1 0 1\n"
TRUE = "VERTEX2 0 0 0 0\nVERTEX2 1 1.1 0 1.5708\nVERTEX2 2 1.1 2 1.7708\nVERTEX2 41 1.1 0 1.5708\n"
VERTICES = "".join(f"VERTEX_SE2 {k} {p[0, 3]} {p[1, 3]} {np.arctan2(p[1, 0], p[0, 0])}\n"
                   for k, p in zip((0, 1, 2, 41), WAY.poses, strict=True))


def in_space(line):
    """An edge of the plane as one of g2o's in space."""
    _, first, second, x, y, turn, *_ = line.split()
    half = 0.5 * float(turn)
    return f"EDGE_SE3:QUAT {first} {second} {x} {y} 0 0 0 {np.sin(half)} {np.cos(half)}{' 1' * 21}\n"


@pytest.mark.parametrize("text", [
    EDGES, TRUE + EDGES.replace("EDGE_SE2", "EDGE2"), "".join(map(in_space, EDGES.splitlines())),
    TRUE + "EDGE2 1 0 1.1 0 1.5707963267948966 1 0 1 1 0 0\nEDGE2 2 1 2 0 0.2 1 0 1 1 0 0\nEDGE2 41 1 0 0 0 1 0 1 1 0 0\n"],
    ids=["g2o", "toro", "g2o in space", "toro, the observed one first"])
def test_edges_of_a_graph_are_relations_of_numbered_poses(tmp_path, text, capsys):
    (tmp_path / "way.g2o").write_text(VERTICES)
    assert main([str(tmp_path / "way.g2o"), "--relations", str(written(tmp_path, text))]) == 0
    values = {line.split()[0]: float(line.split()[1]) for line in capsys.readouterr().out.splitlines()}
    assert values["relations_trans_m"] == pytest.approx((0.1 + 0.0 + 0.3) / 3, abs=1e-5) and values["relations_share"] == 1
    assert values["revisits"] == 1 and values["revisits_trans_m"] == pytest.approx(0.3)


@pytest.mark.parametrize(("text", "said"), [
    ("EDGE_SE2 0 1 a 0 0\n", "expected 5 finite numbers of an edge"), ("EDGE2 1 0 1 0 0\n", "EDGE2 without vertices"),
    ("FIX 0\n", "found 'FIX'; expected lines of stamp1")])
def test_broken_graphs_of_relations_are_refused_in_one_line(tmp_path, text, said):
    with pytest.raises(RecordingError, match=said) as caught:
        read_relations(written(tmp_path, text))
    assert "\n" not in str(caught.value)
