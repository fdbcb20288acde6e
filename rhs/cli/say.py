"""What the command line says at the end of a run or of a sweep, as text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

SHOWN = (
    "status", "reason", "success", "failure", "cause", "world", "sensor", "odometry", "loop_closer", "mapper", "planner",
    "localiser", "presets", "seed", "places_visited", "places_reachable", "places_total", "missions", "replans",
    "collisions", "clearance_min_m", "survey_collisions", "explored_share", "explore_way_m", "explore_stop", "path_length_m",
    "path_optimal_m", "distance_m",
    "matched_share", "ate_rmse_m", "truth_offset_s", "ate_at_offset_m", "end_error_before_closing_m", "end_error_m",
    "tracked_share", "gated_share", "map_agreement", "map_inconsistency", "way_sigma_m", "relations_trans_m",
    "relations_rot_deg", "revisits_trans_m",
    "starts", "found_share", "found_m", "localise_rmse_m", "belief_lost_share",
    "belief_wrong_sure_share", "kidnaps", "kidnap_recovered_share",
    "kidnap_recovery_m", "kidnap_wrong_sure_share", "belief_ece", "strips", "strips_registered_share",
    "mosaic_correlation", "along_error_pct", "plan_success", "plan_reason", "plan_valid", "plan_length_m",
    "plan_length_raw_m", "plan_optimal_m", "plan_above_optimum_pct", "plan_steps", "plan_learn_ms", "plan_ms",
    "plan_again_ms", "homotopy", "wall_ms", "real_time_factor", "peak_memory_mb",
)
LAST = 3  # what it cost
DRAWN = "the same seed may not give this row again; a part draws from context.rng"
USUAL = {"matched_share": 1.0, "gated_share": 0.0, "truth_offset_s": 0.0}  # not worth a line


def of_run(row: dict[str, Any], folder: Path) -> str:
    """The figures of one run that say most, one a line, and those of other people's plugins; a run that recognised places
    has their table below."""
    from rhs.config.dictionary import added

    lines = []
    row = {name: value for name, value in row.items() if name != "failure" or value != row.get("reason")}  # said once
    for name in (*SHOWN[:-LAST], *added(row), *SHOWN[-LAST:]):
        value = row.get(name, "")
        if value == "" or value is None or value != value or value == USUAL.get(name):
            continue
        lines.append(f"{name:<28}{value:.4g}" if isinstance(value, float) else f"{name:<28}{value}")
    if (folder / "places.csv").exists():
        lines += ["", of_places(folder)]
    if row.get("blame"):
        lines += ["", of_blame(row)]
    return "\n".join(lines)


def of_sweep(folder: Path) -> str:
    """The summary of a sweep's rows; the whole table and, where planners ran alone, theirs are written in the folder."""
    from rhs.reports.export import write_text
    from rhs.reports.planning_table import planning_rows, planning_table, publish
    from rhs.reports.summary import as_text, summarise, thresholds
    from rhs.reports.table import rows, to_csv

    unreadable: list[str] = []
    table = rows([folder], unreadable=unreadable)
    write_text(folder / "table.csv", to_csv(table))
    left_out = [*thresholds(table), *of_drawn(list(table.get("global_random", ()))),
                *(f"not counted: {message}" for message in unreadable)]
    if not len(table):
        return "\n".join(left_out)
    if not len(planning_rows(table)):
        return "\n".join([as_text(summarise(table)), *left_out])
    publish(table, folder)
    return "\n".join([as_text(planning_table(table)), *left_out])


def of_drawn(drawn: Sequence[object]) -> list[str]:
    """A line where parts drew from generators that everything in a process shares. drawn: global_random of each row."""
    names = [name for name in drawn if isinstance(name, str) and name]
    return [f"{len(names)} of {len(drawn)} runs used the global generator of {' or '.join(sorted(set(names)))}: {DRAWN}"
            ] if names else []


def of_blame(row: dict[str, Any]) -> str:
    """The shares of task=blame as a table, measures down, links across, how far they may be off, and the sentence."""
    from rhs.metrics.blame import LINKS, MEASURES, column

    def share(measure: str, link: str) -> str:
        value = row.get(column(measure, link))
        return f"{value:.3g}" if isinstance(value, float) and value == value else ""

    links = [link for link in (*LINKS, "rest") if any(share(measure, link) for measure in MEASURES)]
    lines = [f"{'cost of':<38}" + "".join(f"{link:>10}" for link in links)]
    lines += [f"{what + (f', {unit}' if unit else ''):<38}" + "".join(f"{share(measure, link):>10}" for link in links)
              for measure, (unit, what) in MEASURES.items()]
    off_by, measure = row.get("blame_off_by"), str(row.get("blame_measure") or "")
    if measure and isinstance(off_by, float) and off_by > 0.0:
        lines.append(f"({MEASURES[measure][1]}: each may be off by {off_by:.2g})")
    return "\n".join([*lines, str(row["blame"])])


def of_searches(accounts: Sequence[Mapping[str, Any]], counts: Sequence[str]) -> str:
    """A line for each search of a break point. counts: of the runs of each, in words."""
    width = max(len(one["combination"]) for one in accounts)
    return "".join(f"{one['combination']:<{width}}  {one['dial']}: {one['says']}  ({count})\n"
                   for one, count in zip(accounts, counts, strict=True))


def of_places(folder: Path) -> str:
    """places.csv of task=places as text, with the thesis's figures above ours."""
    rows = [line.split(",") for line in (folder / "places.csv").read_text(encoding="utf-8").splitlines()]
    rows.insert(1, ["thesis (votes)", "-", "0.80", "0.08", "0.12", "-", "-"])
    return "\n".join(f"{row[0]:<28}" + "".join(f"{cell:>11}" for cell in row[1:]) for row in rows)
