"""What happened on the way is marked where it happened, once for as long as it lasts."""

import json

import numpy as np

from rhs.api.grid import OccupancyGrid
from rhs.plots import new_figure
from rhs.reports.drawing import draw_places, title
from rhs.reports.event_marks import draw_happenings, draw_unknown
from rhs.runfolder.run import Run


def _step(index, event="", mission="1", belief="tracking"):
    return {"index": str(index), "phase": "patrol", "mission": mission, "event": event, "true_x_m": str(0.2 * index),
            "true_y_m": "0", "x_m": str(0.2 * index), "y_m": "0.1", "yaw_rad": "0", "true_yaw_rad": "0", "stamp_s": "0",
            "belief_probability": "0.9", "motion_status": "ok", "motion_reason": "", "motion_replaced": "0",
            "belief_status": belief, "collided": "0"}


def _marked(steps, missions=()):
    """Legend label, or `ring` of the large one which has none -> (N, 2) where it was drawn."""
    axes = new_figure(4.0, 3.0).add_subplot()
    draw_happenings(axes, steps, missions)
    return {"ring" if line.get_markersize() == 15 else line.get_label(): line.get_xydata() for line in axes.get_lines()}


def test_a_robot_lost_for_three_views_has_one_mark_where_it_began_to_doubt():
    steps = [_step(k, "lost" if 4 <= k <= 6 else "", belief="lost" if 4 <= k <= 6 else "tracking") for k in range(10)]
    np.testing.assert_allclose(_marked(steps)["does not know where it is"], [[0.8, 0.0]])


def test_trouble_began_where_the_first_part_complained_of_the_mission_that_failed():
    steps = [_step(k, "contact" if k == 7 else "", belief="converging" if k >= 3 else "tracking") for k in range(9)]
    failed = {"mission": 1, "place": "desk", "status": "gave_up", "reason": "no progress"}
    marked = _marked(steps, [failed])
    np.testing.assert_allclose(marked["ring"], [[0.6, 0.0]])
    assert "trouble began, view 3: localiser converging" in marked
    np.testing.assert_allclose(marked["touched something"], [[1.4, 0.0]])
    arrived = {**failed, "status": "arrived", "goal_m": [0.0, 0.0]}
    assert not any(label.startswith("trouble") for label in _marked(steps, [arrived]))


def test_a_kidnap_is_a_line_from_where_to_where():
    steps = [_step(0), _step(1), {**_step(2, "kidnapped"), "true_x_m": "5.0"}]
    np.testing.assert_allclose(_marked(steps)["carried off"], [[0.2, 0.0], [5.0, 0.0]])


def test_bands_show_where_the_belief_was_unsure_doubtful_or_wrong_and_sure():
    """Views 2 and 3 lie on an unsure map, 5 is lost, 7 is 2 m off and sure of itself."""
    said = {2: "degraded", 3: "degraded", 5: "lost"}
    steps = [_step(k, belief=said.get(k, "tracking")) for k in range(9)]
    steps[7]["x_m"] = "3.4"
    marked = _marked(steps)
    ends = {label: xy[np.isfinite(xy).all(axis=1), 0] for label, xy in marked.items()}
    np.testing.assert_allclose(ends["on the map, but the map is unsure"], [0.2, 0.4, 0.4, 0.6])
    np.testing.assert_allclose(ends["in doubt where it is"], [0.8, 1.0])
    np.testing.assert_allclose(ends["wrong, and sure of it"], [1.2, 1.4])
    unknown = [{**step, "true_x_m": "", "true_y_m": "", "true_yaw_rad": ""} for step in steps]
    assert "wrong, and sure of it" not in _marked(unknown)


def test_what_is_new_and_what_is_gone_since_the_survey():
    before, after = np.zeros((4, 4), np.float32), np.zeros((4, 4), np.float32)
    before[1, 1] = after[2, 3] = 1.0
    axes = new_figure(4.0, 3.0).add_subplot()
    draw_unknown(axes, *(OccupancyGrid(grid, 0.1, (0.0, 0.0)) for grid in (before, after)))
    corners = [patch.get_xy()[:4] for patch in axes.patches if len(patch.get_xy()) > 1]
    np.testing.assert_allclose(sorted(np.mean(corners, axis=1).tolist()), [[0.15, 0.15], [0.35, 0.25]])


def test_every_place_shows_what_became_of_it(tmp_path):
    """Reached, only believed to be, behind a gap that the robot does not fit through, and missed; each in its own mark."""
    names = ("desk", "door", "shed", "hall")
    facts = {"robot_radius_m": 0.3, "places": [{"name": name, "x_m": float(k), "y_m": 0.0} for k, name in enumerate(names)]}
    reach = {"unsure_m": 0.014, "places": [{"name": name, "room_m": 0.2 if name == "shed" else 0.8} for name in names]}
    missions = [{"mission": k, "place": name, "goal_m": [float(k - 1), 0.0], "reason": "",
                 "status": "arrived" if k < 3 else "gave_up"} for k, name in enumerate(names, 1)]
    steps = [_step(0, "arrived"), {**_step(1, "arrived"), "true_x_m": "4.0"}]  # at the desk; 3 m from the door
    for name, content in (("facts", facts), ("reach", reach), ("missions", missions)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    lines = [",".join(steps[0]), *(",".join(step.values()) for step in steps)]
    (tmp_path / "steps.csv").write_text("\n".join(lines) + "\n")
    axes = new_figure(4.0, 3.0).add_subplot()
    draw_places(axes, Run(tmp_path))
    drawn = [line for line in axes.get_lines() if len(line.get_xdata())]
    legend = {line.get_label(): line for line in axes.get_lines() if not len(line.get_xdata())}
    labels = ("place reached", "said to be reached, but the robot was elsewhere", "place that cannot be reached",
              "place not reached")
    for place, label in zip(drawn, labels, strict=True):
        style = [(one.get_marker(), one.get_markerfacecolor(), one.get_markeredgecolor()) for one in (place, legend[label])]
        assert style[0] == style[1]
    assert len({(one.get_marker(), one.get_markerfacecolor(), one.get_markeredgecolor()) for one in drawn}) == 4


def test_a_title_counts_the_places_that_are_out_of_reach():
    row = {"status": "ok", "places_visited": 2, "places_total": 4, "places_undecided": 0}
    assert "2/4 places, 2 out of reach" in title({**row, "places_reachable": 2})
    assert "out of reach" not in title({**row, "places_reachable": 4}) and "2/4 places" in title(row)
