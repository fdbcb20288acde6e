"""N01 to N09: covariances that are none, vanishing weights, half trajectories, loops and places that look alike."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
from faults.bench import HOSTILE, LIGHT, Bench, hostile, parts
from faults.catalogue import fault
from faults.files import CAMERA, REPLAY, tum
from painted_room import paintings

from rhs.api.geometry import se2
from rhs.testing.room import CORRIDOR, see

LASER = [
    *HOSTILE,
    *parts(source="hostile", sensor="hostile", planner="astar", mapper="occupancy", localiser="particle_filter_scan"),
    *LIGHT,
    "source.views=16",
    "output=run",
]
ELL = """start: [1.0, 1.0, 0.0]
robot_radius_m: 0.3
camera_height_m: 1.2
route_m: [[1, 1], [4, 1], [4, 3]]
places: {near: [2.2, 1.0]}
walls:
  - name: outer
    points_m: [[0, 0], [5, 0], [5, 5], [3, 5], [3, 2], [0, 2], [0, 0]]
seed: 5
"""


@fault(
    "N01",
    "a covariance that is negative, zero, lopsided, not a number, or without end",
    "1; the contract; never NaN in a table",
)
def no_covariance(bench: Bench) -> None:
    for how, says in (
        ("negative", "expected all above 0"),
        ("zero", "expected all above 0"),
        ("lopsided", "is not symmetric"),
        ("nan", "covariance"),
        ("huge", "at most 1e+12"),
    ):
        answer = bench.ask(*hostile("odometry", f"{how}_covariance"), f"output={how}_run", code=1, says="odometry=hostile")
        row = answer.row(f"{how}_run")
        assert row["status"] == "failed" and says in row["reason"] and np.isfinite(row["end_error_m"])
        assert answer.steps("index", f"{how}_run") == ["0", "1"]


@fault(
    "N02",
    "every weight of a particle filter vanishes: no particle explains the scan",
    "0 or 3; finite beliefs, the patrol ends",
)
def vanishing_weights(bench: Bench) -> None:
    answer = bench.ask(
        *LASER, "mapper=fake", "source.how=none", "sensor.how=near", "mission.views_max=60", code=(0, 3), says=None
    )
    assert answer.row()["belief_wrong_sure_share"] == 0.0
    assert np.isfinite(
        np.array([answer.steps(name) for name in ("x_m", "y_m", "yaw_rad", "sigma_x_m", "belief_probability")], float)
    ).all()


@fault("N03", "lost tracking told by a magic number or a word of one's own", "1; the status is one of three words")
def no_status(bench: Bench) -> None:
    for how, says in (
        ("word", "status is 'fine'; expected a Tracking: ok, degenerate, lost"),
        ("no_word", "expected a Tracking"),
    ):
        bench.ask(*hostile("odometry", how), f"output={how}", code=1, says=("odometry=hostile", says))
    bench.ask(
        *hostile("localiser", "probability"), "output=chance", code=1, says="probability is 7.0; expected a chance in [0, 1]"
    )


def line(stamp: float, x: float, y: float) -> str:
    return f"{stamp:.6f} {x} {y} 0 0 0 0 1\n"


def trajectory(bench: Bench, name: str, write: Callable[[int, float], str]) -> None:
    """500 poses, ten a second; `write` makes the line of each."""
    bench.file(name, "".join(write(number, 0.1 * number) for number in range(500)))


def figures(out: str) -> dict[str, str]:
    return dict(told.split(maxsplit=1) for told in out.splitlines())


@fault("N04", "one pose of 500 is NaN", "0, file, line, share of poses; of an odometry 1; in truth: unknown there, counted")
def nan_pose(bench: Bench) -> None:
    trajectory(bench, "truth.tum", lambda number, s: line(s, s, 0.0))
    trajectory(bench, "nan.tum", lambda number, s: line(s, s, 0.0) if number != 250 else f"{s} {'nan ' * 7}\n")
    bench.ask("nan.tum", "truth.tum", module="rhs.evaluate", code=0,
              says="nan.tum:251: found a stamp and no pose, as in 1 line in all; left out: 99.8 %")
    bench.ask(*hostile("odometry", "nan_pose"), "output=run", code=1, says="previous_from_body is not finite")


@fault("N05", "estimate and truth share 8 % of their stamps", "3, the share in the line and among the figures")
def few_stamps(bench: Bench) -> None:
    trajectory(bench, "truth.tum", lambda number, s: line(s, s, 0.0))
    trajectory(bench, "few.tum", lambda number, s: line(s if number % 12 == 0 else s + 0.05, s, 0.0))
    trajectory(bench, "never.tum", lambda number, s: line(s + 1000.0, s, 0.0))
    for name, share in (("few", "8.4%"), ("never", "0.0%")):
        answer = bench.ask(
            f"{name}.tum", "truth.tum", module="rhs.evaluate", code=3, says=f"only {share} of the poses have a partner"
        )
        assert figures(answer.out)["matched_share"] == {"few": "0.084", "never": "0"}[name]


@fault(
    "N06", "estimate and truth swapped; a similarity taken for a metric method", "0; the alignment stands beside the figures"
)
def swapped_files(bench: Bench) -> None:
    trajectory(bench, "truth.tum", lambda number, s: line(s, s, np.sin(s)))
    trajectory(bench, "estimate.tum", lambda number, s: line(s, 1.05 * s, 1.05 * np.sin(s)))
    told = [
        figures(bench.ask(*words, module="rhs.evaluate", code=0).out)
        for words in (
            ("estimate.tum", "truth.tum"),
            ("truth.tum", "estimate.tum"),
            ("estimate.tum", "truth.tum", "--alignment", "sim3"),
        )
    ]
    assert [one["ate_alignment"] for one in told] == ["se3", "se3", "sim3"]
    assert told[0]["ate_rmse_m"] == told[1]["ate_rmse_m"] and float(told[0]["ate_rmse_m"]) > 0.5
    assert float(told[2]["ate_rmse_m"]) < 1e-6
    bench.ask(
        "estimate.tum",
        "truth.tum",
        "--alignment",
        "best",
        module="rhs.evaluate",
        says="not one of none, origin, yaw, se3, sim3",
    )


@fault("N07", "two places 12.8 m apart that look the same offer a closure", "0; refused with a reason, no pose moves")
def twin_places(bench: Bench) -> None:
    poses = [se2(-3.0 + 0.4 * number, 0.1, 0.05) for number in range(36)]  # the paintings repeat after 12.8 m
    views = [see(CAMERA, pose, paintings(), number, CORRIDOR) for number, pose in enumerate(poses)]
    tum(
        bench.folder / "tum",
        [np.asarray(view.image[:, :, 0]) for view in views],
        [np.asarray(view.depth, float) for view in views],
        poses=poses,
    )
    answer = bench.ask(*REPLAY, "odometry=procrustes", "loop_closer=error_distribution", code=0)
    closure = json.loads((answer.folder / "run" / "closure.json").read_text())
    assert closure["edges"] and not any(edge["accepted"] for edge in closure["edges"]), "the twins were seen"
    assert (
        all("moves the end by 12" in edge["reason"] for edge in closure["edges"]) and closure["details"]["closures"] == 0.0
    )
    assert answer.row()["end_error_m"] == answer.row()["end_error_before_closing_m"] < 0.3


@fault(
    "N08", "a room that looks the same from both ends, and a robot that was carried away", "3; it is never sure of a place"
)
def symmetric_room(bench: Bench) -> None:
    answer = bench.ask(
        *LASER,
        "source.how=scans",
        "sensor.how=laser",
        "mission.kidnap=true",
        "mission.views_max=80",
        code=3,
        says="not achieved: 0 of 2 places",
    )
    row, events, beliefs = answer.row(), answer.steps("event"), answer.steps("belief_status")
    at = next(number for number, event in enumerate(events) if "kidnapped" in event)
    assert row["kidnap_wrong_sure_share"] == 0.0 and row["belief_wrong_sure_share"] == 0.0
    assert "tracking" not in beliefs[at + 10 :]


@fault(
    "N09", "a corner of 90 degrees for the filter that knows of corridors", "0; heading within 3 degrees after the corner"
)
def corner(bench: Bench) -> None:
    bench.file("ell.yaml", ELL)
    answer = bench.ask(
        "task=survey",
        "world=ell.yaml",
        "sensor=mono",
        "odometry=corridor_ekf",
        "source.image_width=240",
        "loop_closer=none",
        *LIGHT,
        "output=run",
        code=0,
    )
    believed, true = (np.unwrap(np.array(answer.steps(name), float)) for name in ("yaw_rad", "true_yaw_rad"))
    assert abs(np.degrees((believed - true)[-5:])).max() < 3.0 and answer.row()["end_error_m"] < 0.2
