"""A run folder read back: what metrics, pictures and people in notebooks look at."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from rhs.api.grid import OccupancyGrid
from rhs.api.trajectory import Trajectory, read_tum
from rhs.base.errors import ConfigError, RhsError, path_of
from rhs.worlds.maps import load_map

from .row import read_row

if TYPE_CHECKING:
    import pandas

Result = TypeVar("Result")


class StepLine(Mapping[str, str]):
    """A line of steps.csv by the names of its columns, in a tenth of the memory of a dict of as many texts."""

    __slots__ = ("_columns", "_text")

    def __init__(self, columns: dict[str, int], cells: list[str]) -> None:
        self._columns = columns
        short = len(columns) - len(cells)  # cells that a cut line lacks
        self._text = "\0".join(cell.replace("\0", "") for cell in (*cells, *[""] * short))

    def __getitem__(self, name: str) -> str:
        return self._text.split("\0")[self._columns[name]]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def __repr__(self) -> str:
        return f"StepLine({ {name: cell for name, cell in self.items() if cell} })"


class Run:
    """One run folder. Files are read when they are asked for, once; nothing is written.

    >>> run = rhs.load_run("results/runs/2026-11-21_12-00-00_seed0")          # doctest: +SKIP
    >>> run.row["ate_rmse_m"], run.table["x_m"].mean(), run.map.resolution_m   # doctest: +SKIP
    """

    def __init__(self, folder: Path | str) -> None:
        self.folder = Path(folder)
        self._known: dict[Any, Any] = {}

    def __repr__(self) -> str:
        return f"Run({str(self.folder)!r})"

    @cached_property
    def row(self) -> dict[str, object]:
        """The row of the table; unknown is None. Raises ConfigError when there is none."""
        return read_row(self.folder / "row.json")

    @cached_property
    def config(self) -> dict[str, Any]:
        """The resolved configuration as plain values."""
        from rhs.base.strict_yaml import load_yaml

        return dict(load_yaml(self.folder / "config.yaml"))

    @cached_property
    def steps(self) -> list[StepLine]:
        """The lines of steps.csv as text; unknown is empty. No lines where there is no such file."""
        path = self.folder / "steps.csv"
        if not path.exists():
            return []
        with path.open(encoding="utf-8", newline="") as file:
            lines = csv.reader(file)
            columns = {name: k for k, name in enumerate(next(lines, []))}
            return [StepLine(columns, cells) for cells in lines if cells]

    @cached_property
    def table(self) -> pandas.DataFrame:
        """steps.csv as a DataFrame, one line per view (`python -m rhs help columns` says what its columns mean)."""
        import pandas

        path = self.folder / "steps.csv"
        return pandas.read_csv(path) if path.exists() else pandas.DataFrame()

    @property
    def estimate(self) -> Trajectory | None:
        """The survey as it was believed view by view."""
        return self.trajectory("estimate")

    @property
    def map(self) -> OccupancyGrid | None:
        """The map drawn."""
        return self.grid("map")

    def trajectory(self, name: str) -> Trajectory | None:
        """`estimate`, `corrected`, `truth_survey`, `patrol`, `truth_patrol`, `localised` or `truth_localised`;
        None where there is none."""
        path = self.folder / f"{name}.tum"
        trajectory = self.once_of(("tum", name), lambda: read_tum(path) if path.exists() else None)
        return trajectory if trajectory is not None and len(trajectory) else None

    def grid(self, name: str) -> OccupancyGrid | None:
        """`map`, `map_patrol`, `true_map` or `true_map_patrol`; None where there is none."""
        path = self.folder / f"{name}.yaml"
        return self.once_of(("map", name), lambda: load_map(path) if path.exists() else None)

    def json(self, name: str) -> Any:
        """The content of NAME.json, or None. Raises RhsError when it is not JSON."""
        return self.once_of(("json", name), lambda: _json(self.folder / f"{name}.json"))

    def once(self, function: Callable[[Any], Result]) -> Result:
        """`function(self)`, computed once."""
        return self.once_of(function, lambda: function(self))

    def once_of(self, key: Any, function: Callable[[], Result]) -> Result:
        """What the function returns, kept under the key."""
        if key not in self._known:
            self._known[key] = function()
        return self._known[key]


def load_run(folder: Path | str) -> Run:
    """The run of that folder. Raises ConfigError when it holds neither a row nor steps."""
    run = Run(path_of(folder, "the folder of a run"))
    if not any((run.folder / name).exists() for name in ("row.json", "steps.csv", "config.yaml")):
        raise ConfigError(f"{run.folder} is no run folder: it holds neither row.json nor steps.csv")
    return run


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8")) if path.exists() else None
    except ValueError as error:
        raise RhsError(f"{path} is not JSON: {error}") from error
