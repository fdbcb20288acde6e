"""Robotic Home Sentinel: camera to patrol, as an experiment.

    import rhs
    for step in rhs.steps(["world=square_small"]): ...                     # the loop itself
    row   = rhs.run({"world": "square_small", "planner": MyPlanner()})     # one run, its row
    table = rhs.sweep(["world=square_small", "planner=prm,rrt"])           # many, a DataFrame
    run   = rhs.load_run(row["folder"])                                    # what a run left behind
    rhs.evaluate("estimate.tum", "truth.tum")                              # ATE, RPE and completeness
    rhs.register("planner", "mine", MyPlanner)                             # a plugin without packaging

Names here and in `rhs.api`, `rhs.estimation` and `rhs.testing` are the public surface: rhs/README.md, "Public names".
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rhs.base.errors import RhsError, path_of

if TYPE_CHECKING:
    import pandas

    from rhs.api.metric import Metric
    from rhs.api.records import Step
    from rhs.config.compose import RunConfig as Config
    from rhs.runfolder.run import Run

__all__ = ["Config", "RhsError", "__version__", "evaluate", "load_run", "register", "run", "steps", "sweep", "table"]

try:
    __version__ = version("rhs")
except PackageNotFoundError:  # run from a folder that was never installed
    __version__ = "0"

Words = Sequence[str] | Mapping[str, Any]


def run(words: Words = (), *, quiet: bool = False) -> dict[str, Any]:
    """Run one experiment and return its row; the run folder stands in it as `folder`.

    words: `key=value` as on the command line, or a mapping of keys to values; a part may be given as the object of its
    settings, `{"planner": MyPlanner(step_m=0.2)}`. quiet: no progress bar. In a notebook the overview picture is shown.
    Raises ConfigError for what is refused before anything runs; a failure later is a row whose `status` is not "ok" and
    whose `reason` says why. Ctrl-C is raised again when the row is written.
    """
    from rhs.patrol.face import run_words

    return run_words(words, quiet=quiet)


def steps(words: Words = ()) -> Iterator[Step]:
    """The loop itself: one Step per view of the survey and then of the patrol, with the source closed at the end.

    Everything is also written to the run folder, as by `run`. Raises ConfigError for what is refused before anything
    runs, and whatever ends the run."""
    from rhs.patrol.face import steps_of

    return steps_of(words)


def sweep(words: Words, *, jobs: int = 0, timeout_s: float = 3600.0, quiet: bool = False) -> pandas.DataFrame:
    """Every combination of the values given, each in a process of its own; the rows as a DataFrame.

    words: as on the command line after -m, or a mapping whose lists are the values to combine. jobs: processes at a time,
    0 for one per core. timeout_s: of one job, 0 for none. quiet: no progress bar. A plugin of your own stands at the top of
    a .py file; where that is the script itself, call this under `if __name__ == "__main__":`, for the jobs read the file."""
    from rhs.sweeps.face import sweep_words

    return sweep_words(words, jobs=jobs, timeout_s=timeout_s, quiet=quiet)


def table(*folders: Path | str) -> pandas.DataFrame:
    """The rows of all runs under these folders, one line each. Raises ConfigError for what is no folder."""
    from rhs.reports.table import rows

    return rows([path_of(folder, "a folder of runs") for folder in folders or ("results",)])


def evaluate(estimate: Path | str, truth: Path | str | None = None, *, alignment: str = "se3",
             tolerance_s: float = 0.02) -> dict[str, float | int | str]:
    """ATE, RPE and completeness of a trajectory in TUM format against its truth; or, with one argument, the figures of a
    run folder again from its files.

    alignment: se3, sim3, origin or none. tolerance_s: most time between the stamps of a pair."""
    from rhs.metrics.evaluate import evaluate_folder, evaluate_pair

    way = path_of(estimate, "a run folder or a trajectory")
    if truth is None:
        return evaluate_folder(way)
    return evaluate_pair(way, path_of(truth, "a trajectory"), alignment=alignment, tolerance_s=tolerance_s)


def load_run(folder: Path | str) -> Run:
    """What a run left behind: `row`, `table` (the steps), `estimate`, `map`, `config`. Raises ConfigError when the folder
    holds no run."""
    from rhs.runfolder.run import load_run as load

    return load(folder)


def register(kind: str, name: str, plugin: type | Metric | tuple[Metric, ...]) -> None:
    """A plugin of this process: from now on `kind=name` chooses it, or rows have these metrics. The row records its file and
    the file's hash.

    Raises PluginError when the kind is unknown or the class is no plugin (rhs.api.contracts)."""
    from rhs.config import registry

    registry.register(kind, name, plugin)


def __dir__() -> list[str]:
    return __all__


def __getattr__(name: str) -> Any:
    if name == "Config":
        from rhs.config.compose import RunConfig

        return RunConfig
    raise AttributeError(f"module 'rhs' has no attribute {name!r}")
