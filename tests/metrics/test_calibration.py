"""Kidnaps and calibration, counted by hand."""

from dataclasses import dataclass

import numpy as np
import pytest

from rhs.metrics.calibration import calibration_error, calibration_values, reliability
from rhs.reports.calibration_pictures import calibration_picture, precision_recall_picture


@dataclass
class Files:
    """A run folder that holds steps only."""

    steps: list


def _row(k, true_x, x, *, status="tracking", chance=0.9, event="", yaw=0.0):
    return {"phase": "patrol", "stamp_s": f"{0.5 * k}", "true_x_m": f"{true_x}", "true_y_m": "0.0", "true_yaw_rad": "0.0",
            "x_m": f"{x}", "y_m": "0.0", "yaw_rad": f"{yaw}", "belief_status": status, "belief_probability": f"{chance}",
            "event": event}


def _patrol():
    """Carried to 10 m: wrong and sure, lost, then right after 2 m. Carried to 30 m: wrong and sure to the end."""
    first = [_row(0, 0.0, 0.1), _row(1, 1.0, 1.1)]
    second = [_row(2, 10.0, 2.0, event="kidnapped+replan"), _row(3, 11.0, 3.0, status="lost", chance=0.1),
              _row(4, 12.0, 12.2), _row(5, 13.0, 13.1)]
    third = [_row(6, 30.0, 14.0, event="kidnapped"), _row(7, 31.0, 15.0), _row(8, 32.0, 16.0)]
    return first + second + third


def test_recovery_is_way_and_time_until_it_says_so_and_is_right():
    values = calibration_values(Files(_patrol()))
    assert values["kidnaps"] == 2
    assert values["kidnap_recovered_share"] == pytest.approx(0.5)
    assert values["kidnap_recovery_m"] == pytest.approx(2.0) and values["kidnap_recovery_s"] == pytest.approx(1.0)
    assert values["kidnap_wrong_sure_share"] == pytest.approx(0.5)
    assert values["belief_wrong_sure_share"] == pytest.approx(4 / 9)


def test_recovery_after_five_metres_comes_too_late():
    late = [_row(0, 0.0, 9.0, event="kidnapped", status="lost")]
    late += [_row(k, 2.0 * k, 2.0 * k, status="lost" if k < 3 else "tracking") for k in range(1, 5)]
    assert calibration_values(Files(late))["kidnap_recovered_share"] == 0.0  # it knew at 6 m


def test_right_means_the_heading_too():
    turned = [_row(0, 0.0, 0.0, event="kidnapped", yaw=0.2), _row(1, 1.0, 1.0, yaw=0.2)]
    assert calibration_values(Files(turned))["kidnap_wrong_sure_share"] == 1.0


def test_without_a_kidnap_or_without_truth_nothing_is_known():
    values = calibration_values(Files(_patrol()[:2]))
    assert values["kidnaps"] == 0 and np.isnan(values["kidnap_recovered_share"])
    blind = [{**row, "true_x_m": ""} for row in _patrol()]
    assert np.isnan(calibration_values(Files(blind))["kidnaps"]) and np.isnan(calibration_values(Files(blind))["belief_ece"])


def test_calibration_is_the_gap_between_chance_and_share():
    chance = np.array([0.95] * 10 + [0.15] * 10)
    right = np.array([True] * 9 + [False] + [True] * 2 + [False] * 8)
    np.testing.assert_allclose(reliability(chance, right), [[0.15, 0.2, 10], [0.95, 0.9, 10]])
    assert calibration_error(chance, right) == pytest.approx(0.05)
    assert calibration_error(np.ones(4), np.ones(4, bool)) == 0.0


def test_pictures_are_made_from_the_files_alone(tmp_path):
    rows = _patrol()
    text = ",".join(rows[0]) + "\n" + "".join(",".join(row.values()) + "\n" for row in rows)
    (tmp_path / "steps.csv").write_text(text)
    assert calibration_picture(tmp_path).stat().st_size > 10_000
    (tmp_path / "precision_recall.csv").write_text("method,threshold,precision,recall\nvotes,9,1,0.2\nvotes,5,0.5,0.2\n")
    assert precision_recall_picture(tmp_path).stat().st_size > 5_000
    assert calibration_picture(tmp_path / "nothing") is None
