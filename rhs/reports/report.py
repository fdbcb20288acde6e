"""Pictures and pages of runs, from the files of their folders alone. `python -m rhs.report FOLDER` makes them again.

overview.png: one run at a glance. report.html: one file that needs no other. For a folder of many runs, report.html
shows bars per group, the ways over one another, the worst runs and the table instead.
"""

from __future__ import annotations

import base64
import io
import sys
import textwrap
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.files import write_whole
from rhs.api.geometry import align, inverse, orthonormal, planar, se3
from rhs.base.commands import INTERRUPTED, Arguments, answered, check_regular
from rhs.base.errors import ConfigError, RhsError
from rhs.metrics.accuracy import pair
from rhs.metrics.survey import TOLERANCE_S, scale_known
from rhs.plots import new_figure, save
from rhs.runfolder.row import CHOICES, read_row
from rhs.runfolder.run import Run

from .charts import bars, blame_picture, errors_by_axis, errors_over_time, stage_times
from .drawing import draw_run, title, unit_of
from .export import write_text
from .html import RUN, SWEEP
from .observations import judged, reasons
from .patrol_story import patrol_story
from .summary import listing, notes_of, short, shown, summarise
from .table import some_rows, tell_unreadable
from .video import video
from .ways import ways

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

LARGEST_VIDEO_BYTES = 30 << 20
MOST_WORST = 6  # runs whose pictures stand in the report of a sweep
TITLE_CHARACTERS = 130  # of a line over a picture
DIGITS = 6  # of a stamp: trajectories are written with nine, steps.csv as the view has it


def pictures(folder: Path) -> list[Path]:
    """Every picture that the files of a run folder allow: a task needs to write nothing but its files."""
    return [path for draw in drawings(folder) if (path := draw()) is not None]


def drawings(folder: Path) -> list[Callable[[], Path | None]]:
    """What draws each of them."""
    from .calibration_pictures import calibration_picture, precision_recall_picture
    from .planning_pictures import plan_picture

    of_file = {"plan.json": plan_picture, "precision_recall.csv": precision_recall_picture, "blame.json": blame_picture}
    made: list[Callable[[Path], Path | None]] = [draw for name, draw in of_file.items() if (folder / name).exists()]
    if (folder / "steps.csv").exists():
        row = Run(folder).json("row") or {}
        asked = row.get("kidnaps") or row.get("starts")
        made += [overview, motion, *([calibration_picture] if asked else [])]
    return [partial(draw, folder) for draw in made]


def overview(folder: Path) -> Path:
    """overview.png: the map, the true walls, those a monocular odometry found, the survey as driven, believed and corrected,
    the patrol, the places."""
    run, figure = Run(folder), new_figure(10.5, 8.0)
    axes = figure.add_subplot()
    draw_run(axes, run)
    lines = title(run.json("row") or {}).splitlines()
    figure.suptitle("\n".join(part for line in lines for part in textwrap.wrap(line, TITLE_CHARACTERS)), fontsize=10)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    return write_whole(run.folder / "overview.png", lambda path: save(figure, path))


def motion(folder: Path) -> Path | None:
    """motion.png: the error of the belief in x, y and heading, view by view, with its band; None where nobody knows the
    truth."""
    run = Run(folder)
    rows = run.steps
    names = ("x_m", "y_m", "yaw_rad", "sigma_x_m", "sigma_y_m", "sigma_yaw_rad", "true_x_m", "true_y_m", "true_yaw_rad")
    steps = {name: np.array([float(row[name] or "nan") for row in rows]) for name in names}
    steps["trusted"] = np.array([row["motion_status"] == "ok" for row in rows], bool)
    steps["patrol"] = np.array([row["phase"] == "patrol" for row in rows], bool)
    # the truth of task=localise stands in the frame of its map already
    recorded = not any((run.folder / name).exists() for name in ("true_map.yaml", "truth_localised.tum"))
    if recorded:
        laid = truth_in_map(run)
        true = np.array([laid.get(round(float(row["stamp_s"]), DIGITS), np.full(3, np.nan)) for row in rows]).reshape(-1, 3)
        steps |= dict(zip(("true_x_m", "true_y_m", "true_yaw_rad"), true.T, strict=True))
    row = run.json("row") or {}
    figure = errors_by_axis(steps, unit_of(row)) if rows else None
    if figure is None:
        return None
    moved = "by a rigid motion" if unit_of(row) == "m" else "by a similarity"
    note = f"\n(the truth is laid onto the belief {moved}, as for the ATE)" if recorded else ""
    figure.suptitle(f"{title(row)}{note}", fontsize=10)
    return write_whole(run.folder / "motion.png", lambda path: save(figure, path))


def truth_in_map(run: Run) -> dict[float, np.ndarray]:
    """Stamp of a view, rounded to DIGITS -> (3,) true x, y, yaw, laid onto the survey as it was believed: positions by a
    rigid motion as for the ATE (Umeyama 1991), with a scale where the belief has none, headings by the mean turn that is
    left between the two bodies. Empty without a truth."""
    estimate, truth = run.trajectory("estimate"), run.trajectory("truth_survey")
    if estimate is None or truth is None:
        return {}
    both = pair(estimate, truth, TOLERANCE_S)
    if len(both.truth) < 3:
        return {}
    unknown = scale_known(run.steps) == 0.0
    map_from_truth, scale = align(both.truth.positions_m, both.estimate.positions_m, with_scale=unknown)
    laid = both.truth.poses.copy()
    laid[:, :3, 3] *= scale
    laid = map_from_truth @ laid
    turns = inverse(laid)[:, :3, :3] @ both.estimate.poses[:, :3, :3]
    body = orthonormal(se3(turns.mean(axis=0), np.zeros(3)))
    stamps = (round(float(stamp), DIGITS) for stamp in both.estimate.stamps_s)
    return {stamp: planar(pose @ body) for stamp, pose in zip(stamps, laid, strict=True)}


def html(folder: Path) -> Path:
    """report.html of one run: numbers, pictures, missions, settings; the video too when it is there and not large."""
    import pandas as pd

    row = read_row(folder / "row.json")
    steps = pd.read_csv(folder / "steps.csv") if (folder / "steps.csv").exists() else None
    overview_png = folder / "overview.png" if (folder / "overview.png").exists() else overview(folder)
    story = patrol_story(folder, row) if (folder / "changes.json").exists() else None
    taken = () if story else sorted((folder / "places").glob("*.png"))
    page = template(RUN).render(
        story=story, title=title(row).splitlines()[0] or folder.name, row=_shown(row), overview=embed(overview_png),
        places=[(path.stem, embed(path)) for path in taken], charts=_pictures(folder, steps),
        missions=Run(folder).json("missions") or [], config=_text(folder / "config.yaml"),
        video="" if story else _video(folder))
    return _written(folder, page)


def sweep(folder: Path, unreadable: list[str] | None = None) -> Path:
    """report.html of a folder of runs: bars per group, their ways over one another, the summary, the worst, and every run.

    A row.json that cannot be read is reported into `unreadable` and on the page; without that list it raises RhsError."""
    left_out = [] if unreadable is None else unreadable
    table = some_rows([folder], left_out)
    if unreadable is None and left_out:
        raise RhsError(left_out[0])
    group = [name for name in CHOICES if name in table.columns and table[name].nunique(dropna=False) > 1]
    scored, summary = judged(table), summarise(table)
    charts = [figure for name in shown(scored) if (figure := bars(scored, name, group)) is not None]
    shown_worst = [(Path(run), why, _picture(Path(run))) for run, why in worst(table)]
    charts += [figure for figure in [ways(table, group)] if figure is not None]
    runs = listing(table, [])
    runs["run"] = [Path(name).relative_to(folder).as_posix() for name in runs["run"]]
    page = template(SWEEP).render(title=folder.name, runs=_cells(runs), summary=_cells(summary),
                                  charts=[embed_figure(figure) for figure in charts], unreadable=left_out,
                                  notes=notes_of(summary), worst=[(run.relative_to(folder).as_posix(), why, picture)
                                                                  for run, why, picture in shown_worst if picture])
    return _written(folder, page)


def worst(table: pandas.DataFrame, most: int = MOST_WORST) -> list[tuple[str, str]]:
    """(folder, why) of runs that did not do what was asked, at most so many and as different as they are: one of each
    reason, the most frequent first, then a second of each."""
    why = {str(run): reason for run, reason in zip(table.index, reasons(table), strict=True) if reason}
    often, told = Counter(why.values()), Counter[str]()
    turn = {run: told.update([reason]) or told[reason] for run, reason in why.items()}
    return sorted(why.items(), key=lambda one: (turn[one[0]], -often[one[1]]))[:most]


def _picture(folder: Path) -> str:
    """The picture of a run as a data address, drawn if it is not there; empty where its files allow none."""
    lying = [path for path in (folder / "overview.png", folder / "plan.png") if path.exists()]
    with suppress(RhsError, OSError, ValueError, KeyError, TypeError):  # of a run that left half of its files
        drawn = lying or [path for draw in drawings(folder)[:1] if (path := draw()) is not None]
        return embed(drawn[0]) if drawn else ""
    return ""


def embed(path: Path) -> str:
    """A file as a data address."""
    kind = {".png": "image/png", ".jpg": "image/jpeg", ".webm": "video/webm"}[path.suffix]
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def embed_figure(figure: Figure) -> str:
    """A figure as a PNG data address."""
    out = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph", category=UserWarning)  # a name may hold what no font has
        figure.savefig(out, format="png", metadata={"Software": None})
    return f"data:image/png;base64,{base64.b64encode(out.getvalue()).decode()}"


def _pictures(folder: Path, steps: Any) -> list[tuple[str, str]]:
    """(what it shows, data address) of the charts of the steps and of the pictures that lie in the folder."""
    some = steps is not None and not steps.empty
    made = {"Error of the believed position": errors_over_time(steps) if some else None,
            "Time per view and stage": stage_times(steps) if some else None}
    lying = {"What each link cost": folder / "blame.png", "Error in x, y and heading": folder / "motion.png",
             "After kidnaps; reliability of the stated chances": folder / "knowing.png"}
    return [*((name, embed_figure(figure)) for name, figure in made.items() if figure is not None),
            *((name, embed(path)) for name, path in lying.items() if path.exists())]


def _shown(row: dict[str, object]) -> list[tuple[str, str]]:
    return [(name, "-" if value is None else f"{value:.5g}" if isinstance(value, float) else str(value))
            for name, value in row.items()]


def _cells(view: Any) -> dict[str, list]:
    return {"names": [str(name) for name in view.columns],
            "rows": [[short(value) for value in row] for row in view.itertuples(index=False, name=None)]}


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8") if path.exists() else ""


def _video(folder: Path) -> str:
    path = folder / "video.webm"
    return embed(path) if path.exists() and path.stat().st_size <= LARGEST_VIDEO_BYTES else ""


def template(text: str) -> Any:
    """A page in which every value is escaped."""
    from jinja2 import Environment

    return Environment(autoescape=True).from_string(text)


def _written(folder: Path, page: str) -> Path:
    write_text(path := folder / "report.html", page)
    return path


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the pictures and pages of run or sweep folders; one that fails does not stop the others.

    Exit code 0; 1 not possible; 2 refused; 3 made, but not of all."""
    parser = Arguments(prog="python -m rhs.report", description="Pictures and pages of run folders.")
    parser.add_argument("folders", nargs="+", type=Path, help="run folders (with row.json) or sweep folders")
    parser.add_argument("--video", action="store_true", help="also make video.webm (needs recording=full)")

    def work() -> int:
        chosen, codes = parser.parse_args(arguments), []  # type: ignore[var-annotated]
        for folder in chosen.folders:
            unreadable: list[str] = []
            code = answered(partial(_write_all, folder, chosen.video, unreadable))
            if code == INTERRUPTED:
                return code
            codes.append(code or tell_unreadable(unreadable))
        return codes[0] if len(set(codes)) == 1 else 3

    return answered(work)


def _write_all(folder: Path, with_video: bool, unreadable: list[str]) -> int:
    for path in _make(folder, with_video=with_video, unreadable=unreadable):
        sys.stdout.write(f"{path}\n")
    return 0


def _make(folder: Path, *, with_video: bool, unreadable: list[str]) -> Iterator[Path]:
    """The files of a folder, each as it is made; without its row a run has no page."""
    if not folder.is_dir():
        raise ConfigError(f"{folder} is not a folder; give a run or sweep folder")
    if not (folder / "row.json").exists():
        yield sweep(folder, unreadable)
        return
    for path in (*folder.iterdir(), *folder.glob("places/*"), *folder.glob("places_before/*")):
        check_regular(path)
    read_row(folder / "row.json")
    yield from pictures(folder)
    if with_video:
        yield video(folder)
    yield html(folder)
