"""The numbers of a run, from the files of its folder alone: every registered metric whose task it is.

What is missing is NaN, never 0. A metric that fails costs its own column: the row says which and why.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rhs.api.trajectory import ALIGNMENTS, Trajectory, read_tum
from rhs.base.errors import ConfigError, check_choice, check_range, told, where
from rhs.config import registry
from rhs.config.dictionary import GROUPS, RUN, TASKS, metrics_by_group
from rhs.runfolder.row import plain_value
from rhs.runfolder.run import Run, load_run

from .pose_forms import moved_fault, pose_fault
from .relations import LOG_WAY, read_relations, relation_values
from .survey import TOLERANCE_S, Values, trajectory_values
from .trajectory_forms import Numbered, read_trajectory

LONGEST_FAULT = 300  # characters of what one metric raised, of all that went wrong


def evaluate_folder(folder: Path) -> Values:
    """The figures of a run folder again; its task is the one its row, or its configuration, names. Raises ConfigError where
    there is no folder."""
    if not folder.is_dir():
        raise ConfigError(f"{folder}: expected a run folder, or two trajectories (TUM, KITTI, EuRoC): ESTIMATE TRUTH")
    run = load_run(folder)
    named = run.row if (folder / "row.json").exists() else run.config if (folder / "config.yaml").exists() else {}
    return evaluate(folder, str(named.get("task", "patrol")))


def evaluate_pair(estimate: Path, truth: Path, *, alignment: str = "se3", tolerance_s: float = TOLERANCE_S) -> Values:
    """ATE, RPE and completeness of two trajectories, each in a form of trajectory_forms. Raises ConfigError where one of
    them tells no time."""
    return evaluate_ways(*read_pair(estimate, truth), alignment=alignment, tolerance_s=tolerance_s)


def evaluate_ways(estimate: Trajectory, truth: Trajectory, *, alignment: str = "se3",
                  tolerance_s: float = TOLERANCE_S) -> Values:
    """The same of two that were read."""
    check_choice("evaluate", "alignment", alignment, ALIGNMENTS)
    check_range("evaluate", "tolerance", tolerance_s, low=0.0, high=10.0, unit="s")
    return trajectory_values(estimate, truth, alignment=alignment, tolerance_s=tolerance_s)


def read_pair(estimate: Path, truth: Path) -> tuple[Trajectory, Trajectory]:
    """Both trajectories. Raises ConfigError where one of them holds nothing, or tells no time."""
    ways = read_trajectory(estimate), read_trajectory(truth)
    for path, way in zip((estimate, truth), ways, strict=True):
        if not len(way):
            raise ConfigError(f"{path}: holds no pose; expected a trajectory, in TUM lines `stamp x y z qx qy qz qw`")
    untimed = [path for path, way in zip((estimate, truth), ways, strict=True) if isinstance(way, Numbered)]
    if len(untimed) == 1 and not np.array_equal(ways[0].stamps_s, ways[1].stamps_s):
        raise ConfigError(f"{untimed[0]}: its lines have no stamps and those of the other file have; write times.txt beside "
                          "it (seconds, a line for each pose; of the form of KITTI) or a stamp before each line")
    return ways


def pair_fault(estimate: Path, truth: Path) -> str:
    """What two trajectories show of how they were misread; empty where nothing is seen."""
    return pose_fault(read_trajectory(estimate), read_trajectory(truth), TOLERANCE_S)


def folder_fault(folder: Path) -> str:
    """The same of the way and the truth of a run folder; of task=localise whether the truth is of the map's frame."""
    if (folder / "localised.tum").is_file() and (folder / "truth_localised.tum").is_file():
        return moved_fault(read_tum(folder / "localised.tum"), read_tum(folder / "truth_localised.tum"))
    way, truth = folder / "corrected.tum", folder / "truth_survey.tum"
    way = way if way.is_file() else folder / "estimate.tum"
    return pair_fault(way, truth) if way.is_file() and truth.is_file() else ""


def evaluate_relations(estimate: Path, relations: Path) -> Values:
    """Errors of published relations: of a trajectory, or of the corrected way of a run folder."""
    if estimate.is_dir():
        names = [name for name in (f"{LOG_WAY}.tum", "corrected.tum", "estimate.tum") if (estimate / name).exists()]
        if not names:
            raise ConfigError(f"{estimate} holds no corrected.tum; expected a run folder or a trajectory")
        estimate = estimate / names[0]
    return relation_values(read_trajectory(estimate), read_relations(relations))


def evaluate(folder: Path, task: str = "patrol") -> Values:
    """All columns that follow from the files of one run folder of a task. Each package of somebody else reads the files for
    itself: what its metrics do to what they read changes nobody's figures."""
    ours, values = Run(folder), Values()
    failures = [why for why in (registry.failure("metric", name) for name in registry.names("metric")) if why]
    for group, members in metrics_by_group(task).items():
        run, known = (ours, RUN) if group in GROUPS else (Run(folder), (*RUN, *TASKS))
        taken = {column.name for column in known}
        for metric in members:
            if metric.name in taken or metric.name in values:
                failures.append(f"{metric.name} of {metric.source}: there is a column of that name already; rename it")
                continue
            try:
                values[metric.name] = plain_value(metric.name, metric.function(run))  # type: ignore[assignment]
            except KeyboardInterrupt:
                raise
            except BaseException as error:  # a plugin may raise anything, even exit
                values[metric.name] = metric.unknown
                failures.append(f"{metric.name}: {told(error)[:LONGEST_FAULT]}{where(error)}")
    return values | {"metric_failures": "; ".join(failures)[:2000]} if failures else values
