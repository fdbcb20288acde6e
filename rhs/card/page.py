"""card.html: the card as one page that needs no other file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import yaml

from rhs.metrics.calibration import kidnaps
from rhs.plots import new_figure
from rhs.reports.calibration_pictures import draw_knowing
from rhs.reports.drawing import extent
from rhs.reports.html import HEAD, TABLE
from rhs.reports.report import embed_figure, template

from . import loop_closers, mappers, planners
from .card import Card, short, table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = HEAD + TABLE + """
<p>{{ origin }}</p>
<ul>{% for said in verdict %}<li>{{ said }}</li>{% endfor %}</ul>
<h2>Contract</h2><div class="wide"><table>
{% for one in contract %}<tr><td>{{ "holds" if one.holds else "FAILS" }}</td><td>{{ one.check }}</td>
<td>{{ one.why }}</td></tr>
{% endfor %}</table></div>
{% if figures.rows %}<h2>{{ set_title }}</h2><p>{{ standard_set }}</p>{{ table(figures) }}
<p>{% for name, meaning in columns %}<b>{{ name }}</b>: {{ meaning }}. {% endfor %}</p>{% endif %}
{% if faults %}<h2>Faults</h2><div class="wide"><table><tr><th>fault</th><th>answers</th><th>for example</th></tr>
{% for one in faults %}<tr><td>{{ one.says }}</td><td>{{ one.times }}</td><td>{{ one.questions | join(", ") }}</td></tr>
{% endfor %}</table></div>{% endif %}
{% if breaks.rows %}<h2>Where it breaks</h2><p>The level of a dial at which less than half is left of what it is without
degradation.</p>{{ table(breaks) }}{% endif %}
{% if rooms.rows %}<h2>{{ rooms_title }}</h2>{{ table(rooms) }}{% endif %}
{% for name, picture in pictures %}<h2>{{ name }}</h2><img src="{{ picture }}" alt="{{ name }}">{% endfor %}
<h2>Settings</h2><pre>{{ settings }}</pre><p>{{ versions }}</p>
</body></html>
"""


def page_of(card: Card) -> str:
    """The page."""
    content = card.content
    names, rows = table(content)
    return template(PAGE).render(
        title=f"Card of {content['part']}", origin=content["from"], verdict=content["verdict"], contract=content["contract"],
        set_title=content.get("set_title", "On the standard set"), rooms_title=content.get("rooms_title", "Room by room"),
        standard_set=content.get("standard_set", ""), figures={"names": names, "rows": rows},
        columns=list(content.get("columns", {}).items()), faults=content.get("faults", []), breaks=_breaks(content),
        rooms=_rooms(content), pictures=[(name, embed_figure(figure)) for name, figure in pictures(card)],
        settings=yaml.safe_dump(content["settings"], sort_keys=False), versions=content["versions"])


def _broke_at(one: dict[str, Any]) -> str:
    """At which level of a dial; of a part that is never right without it nothing is left to break."""
    if not one["undegraded"] > 0.0:
        return "never right"
    return "holds" if one["breaks_at"] is None else short(one["breaks_at"])


def _breaks(content: dict[str, Any]) -> dict[str, Any]:
    return {"names": ["dial", "breaks at", "levels", "what is left", "undegraded"],
            "rows": [[one["dial"], _broke_at(one),
                      ", ".join(f"{level:g}" for level in one["levels"]),
                      ", ".join(f"{score:.2f}" for score in one["scores"]), f"{one['undegraded']:.2f}"]
                     for one in content.get("breaks", [])]}


def _rooms(content: dict[str, Any]) -> dict[str, Any]:
    rooms = content.get("rooms", {})
    names = [name for name in content.get("columns", {}) if name != "memory_mb"]
    return {"names": ["room", *names], "rows": [[room, *(short(found.get(name)) for name in names)]
                                                for room, found in rooms.items()]}


def pictures(card: Card) -> list[tuple[str, Figure]]:
    """What there is to be seen, by the kind of the part."""
    if card.pictures:
        return card.pictures
    kind = card.content["part"].partition("=")[0]
    draw = {"planner": _of_planners, "localiser": _of_localisers, "odometry": _of_odometries,
            "mapper": _of_mappers, "loop_closer": _of_loop_closers}.get(kind)
    return draw(card) if draw is not None and any(result.items for result in card.results.values()) else []


def _of_planners(card: Card) -> list[tuple[str, Figure]]:
    figure = new_figure(9.0, 3.4)
    left, right = figure.subplots(1, 2)
    found = {part: planners.plain_ones(result) for part, result in card.results.items()}
    for axes, values, label in (
            (left, [[one.above_pct for one in each if np.isfinite(one.above_pct)] for each in found.values()],
             "length above the exact shortest path [%]"),
            (right, [[max(one.cpu_ms, 1e-2) for one in each] for each in found.values()], "CPU time of a question [ms]")):
        axes.boxplot(values, orientation="horizontal", whis=(5, 95), showfliers=False)
        axes.set_yticks(range(1, len(found) + 1), list(found) if axes is left else [""] * len(found))
        axes.invert_yaxis()
        axes.set_xlabel(label)
    left.set_xlim(left=0.0)
    right.set_xscale("log")
    made = [("How long its paths are, how long it takes (box: quartiles, whiskers: 5 to 95 %)", figure)]
    faulty = [one for one in found[card.content["part"]] if one.faults][:3]
    return made + ([("Answers that are wrong", _wrong_answers(faulty))] if faulty else [])


def _wrong_answers(faulty: list[Any]) -> Figure:
    figure = new_figure(3.4 * len(faulty), 3.0)
    known = {one.name: one for one in planners.asked()}
    for number, answer in enumerate(faulty):
        problem, axes = known[answer.name].problem, figure.add_subplot(1, len(faulty), number + 1)
        (rows, columns), (x, y), step = problem.blocked.shape, problem.origin_m, problem.resolution_m
        axes.imshow(problem.blocked, origin="lower", cmap="Greys", vmax=1.6,
                    extent=(x, x + columns * step, y, y + rows * step))
        points = answer.points_m[np.isfinite(answer.points_m).all(axis=1)] if len(answer.points_m) else answer.points_m
        axes.plot(points[:, 0], points[:, 1], color="#c1121f", linewidth=1.2)
        axes.plot(*problem.start_m, "o", color="#2a9d4a", markersize=5)
        axes.plot(*problem.goal_m, "s", color="#1f6fb4", markersize=5)
        axes.set_title(f"{answer.name}: {', '.join(answer.faults).replace('_', ' ')}", fontsize=8)
        axes.tick_params(labelsize=7)
    return figure


def _of_localisers(card: Card) -> list[tuple[str, Figure]]:
    patrols = {part: [one.beliefs for one in result.items if one.beliefs is not None]
               for part, result in card.results.items()}
    figure = draw_knowing([each for one in patrols[card.content["part"]] for each in kidnaps(one)], patrols)
    return [("Carried away; reliability of its stated chances beside ours", figure), *_broken(card)]


def _of_odometries(card: Card) -> list[tuple[str, Figure]]:
    from scipy.stats import chi2

    figure = new_figure(9.5, 4.0)
    left, right = figure.subplots(1, 2)
    left.plot([0, 1], [0, 1], color="#888888", linestyle="--", linewidth=1)
    for part, result in card.results.items():
        drives = [one for one in result.items if one.level is None and one.ok.any()]
        if drives:
            inside = np.sort(chi2.cdf(np.concatenate([one.nees[one.ok] for one in drives]), 3))
            left.plot(inside, np.arange(1, len(inside) + 1) / len(inside), linewidth=1.3, label=f"{part}: n {len(inside)}")
    left.set_xlabel("share that its ellipse should hold")
    left.set_ylabel("share of errors that it holds")
    left.legend(fontsize=7, frameon=False, loc="lower right")
    own = [one for one in card.results[card.content["part"]].items if one.level is None and one.ok.any()]
    _scatter(right, own)
    return [("Whether its covariance is honest (above the line: too careful, below: too sure); its errors", figure),
            *_broken(card)]


def _scatter(axes: Axes, drives: list[Any]) -> None:
    """Errors of single motions, ahead and to the left."""
    for one in drives:
        error = 1e3 * one.errors[one.ok]
        axes.plot(error[:, 0], error[:, 1], ".", markersize=4, label=one.room)
    axes.axhline(0.0, color="#888888", linewidth=0.6)
    axes.axvline(0.0, color="#888888", linewidth=0.6)
    axes.set_xlabel("error ahead [mm]")
    axes.set_ylabel("error to the left [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    if drives:
        axes.legend(fontsize=7, frameon=False)


def _of_mappers(card: Card) -> list[tuple[str, Figure]]:
    drives = card.results[card.content["part"]].items
    figure = new_figure(2.6 * max(len(drives), 1), 2.6)
    for number, one in enumerate(drives):
        axes = figure.add_subplot(1, len(drives), number + 1)
        axes.imshow(one.grid.probability, origin="lower", cmap="Greys", vmin=0.0, vmax=1.0, extent=extent(one.grid))
        ends = np.concatenate([view.ends_m for view in mappers.shown(one.room)])
        axes.plot(ends[:, 0], ends[:, 1], ",", color="#c1121f", alpha=0.6)
        axes.set_title(one.room, fontsize=8)
        axes.tick_params(labelsize=7)
    return [("Its maps [m]; red: where beams truly ended", figure)]


def _of_loop_closers(card: Card) -> list[tuple[str, Figure]]:
    surveys = card.results[card.content["part"]].items
    figure = new_figure(3.0 * max(len(surveys), 1), 3.2)
    for number, one in enumerate(surveys):
        axes, (views, truth) = figure.add_subplot(1, len(surveys), number + 1), loop_closers.survey(one.survey)
        before = np.array([view.map_from_body for view in views])
        for poses, colour, label in ((truth, "#888888", "true"), (before, "#e08a1e", f"before: {one.before_m:.2f} m"),
                                     (one.poses, "#1f6fb4", f"after: {one.after_m:.2f} m, {one.accepted} loops")):
            axes.plot(poses[:, 0, 3], poses[:, 1, 3], color=colour, linewidth=1.2, label=label)
        axes.set_title(one.survey, fontsize=8)
        axes.set_aspect("equal", adjustable="datalim")
        axes.legend(fontsize=6, frameon=False)
        axes.tick_params(labelsize=7)
    return [("Its surveys [m]", figure)]


def _broken(card: Card) -> list[tuple[str, Figure]]:
    """What is left at each level of each dial."""
    breaks = card.content.get("breaks", [])
    if not breaks:
        return []
    figure = new_figure(2.6 * len(breaks), 2.6)
    for number, one in enumerate(breaks):
        axes = figure.add_subplot(1, len(breaks), number + 1)
        axes.plot([0, *one["levels"]], [one["undegraded"], *one["scores"]], "o-", markersize=3)
        axes.axhline(one["undegraded"] / 2, color="#c1121f", linewidth=0.8)
        axes.set_ylim(-0.03, 1.03)
        axes.set_xlabel(one["dial"], fontsize=8)
        axes.tick_params(labelsize=7)
        if number == 0:
            axes.set_ylabel("share that is right", fontsize=8)
    return [("Under degradations (red: half of what it is without)", figure)]
