"""The texts of --help and `help`, made from what is registered: every plugin, every setting, its meaning, type and default.

The meaning of a setting is the string literal after it in its settings dataclass: one home for each fact.
"""

from __future__ import annotations

import dataclasses
import re
import textwrap
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rhs.api import settings
from rhs.api.contracts import CHOICES
from rhs.api.errors import limits_of
from rhs.api.records import FeatureSettings
from rhs.base.data_dirs import data_dir
from rhs.base.strict_yaml import load_yaml
from rhs.config import registry
from rhs.config.documented import field_docs, summary

WIDTH = 118
KINDS = (*CHOICES, "engine")

TOP = """\
python -m rhs [options] key=value ...     one run: map a building, then patrol it
python -m rhs -m key=value1,value2 ...    a sweep: one run for each combination of values
python -m rhs COMMAND ...                 tables, reports, checks and more

More help
  python -m rhs help commands             every command in a line
  python -m rhs help planner              the planners, each with its settings; the same for every kind below
  python -m rhs planner=prm --help        one part in full, with its advanced thresholds
  python -m rhs help settings             every part and every setting, with unit and default
  python -m rhs help columns              every column of a table (also: events, statuses)

Options
  -m, --multirun      run every combination of the given values, each in its own process
  --jobs N            parallel processes of a sweep (default: one per core); on another engine, its workers
  --timeout SECONDS   stop a run after this time and count it as a failure (a job of a sweep: 3600; one run, or 0: no limit)
  --memory-mb N       stop a run above this memory and count it as a failure (a job of a sweep: 4096, or its share of the
                      machine; one run: no limit)
  --retries N         how often a job is tried again that was killed by something else than these limits (1)
  --fail-fast N       stop a sweep after N jobs that failed alike (never)
  --resume [FOLDER]   continue a sweep: run only the jobs that have not ended well
  --force             resume although the configuration or the version changed
  --plugin FILE.py    use a plugin from a file, without packaging; may be repeated
  --config-dir DIR    look for experiment/, stack/ and presets here first; may be repeated
  --cfg               print the resulting configuration and run nothing
  --debug             show the traceback of an error
  --version, -h, --help

A part is chosen by kind=name, a setting by key=value; a sweep takes key=1,2,3, 'key=range(10)' and 'planner=glob(*)'.
Words of a sweep: engine=NAME, where its jobs run; keep=all|failures|none, whose folders stay (failures above 1000 jobs);
share=false, jobs share neither survey nor views; cache=false, nor take one from earlier sweeps.
Exit codes: 0 done, 1 failed, 2 refused before anything ran, 3 finished but something failed, 130 and 143 interrupted.
"""


def help_text(words: Sequence[str] = ()) -> str:
    """What --help prints: how to begin and what there is, by name, or all of the parts that the words `kind=name` choose."""
    wanted = [tuple(word.split("=", 1)) for word in words if word.split("=", 1)[0] in KINDS and "=" in word]
    if wanted:
        return "\n".join("\n".join(_plugin(kind, name, is_default=False, full=True)) for kind, name in wanted)
    chosen = _chosen()
    parts = [line for kind in KINDS for line in _entry(f"  {kind}", _names(kind, chosen.get(kind)), indent=16)]
    pages = [line for group in ("experiment", "stack") for path in sorted((data_dir("conf") / group).glob("*.yaml"))
             for line in _entry(f"  {group}={path.stem}", _first_comment(path))]
    return "\n".join([TOP, "Parts, the default first (another sensor brings odometry, mapper and localiser that suit it)",
                      *parts, "", "Settings of a run", *_core_settings(), "", "Experiments and stacks", *pages])


def settings_text(kinds: Sequence[str] = KINDS) -> str:
    """Every part of these kinds with its settings but for advanced thresholds; of all kinds those of a run too."""
    lines = ["Settings of a run", *_core_settings(), ""] if tuple(kinds) == KINDS else []
    chosen = _chosen()
    for kind in kinds:
        lines += [f"{kind}: {_names(kind, chosen.get(kind))}", ""]
        for name in registry.names(kind):
            lines += _plugin(kind, name, is_default=chosen.get(kind) == name)
        lines.append("")
    return "\n".join(lines).rstrip()


def _names(kind: str, default: str | None) -> str:
    return ", ".join(sorted(registry.names(kind), key=lambda name: name != default)) or "none registered"


def _chosen() -> dict[str, str]:
    """The parts of a run to which nothing is said: by kind, those of the default sensor included."""
    chosen = _entries("config.yaml") | {"engine": "process"}
    return chosen | _entries(f"stack/{chosen['sensor']}.yaml")


def _entries(page: str) -> dict[str, str]:
    """What a page of conf/ chooses, by kind."""
    entries = load_yaml(data_dir("conf") / page).get("defaults", [])
    return {key.lstrip("/"): str(value) for entry in entries if isinstance(entry, dict) for key, value in entry.items()}


def _first_comment(path: Path) -> str:
    """The first sentence of a page's comments."""
    lines = path.read_text("utf-8").splitlines()
    comments = [line.lstrip("# ").rstrip() for line in lines if line.startswith("#") and not line.startswith("# @")]
    return re.split(r"(?<=\.) (?=[A-Z])", " ".join(comments), maxsplit=1)[0]


def _plugin(kind: str, name: str, *, is_default: bool, full: bool = False) -> list[str]:
    if failure := registry.failure(kind, name):
        return list(_entry(f"  {kind}={name}", f"NOT USABLE: {failure}"))
    if kind == "metric":
        heads = [(f"    {metric.name}", f"{metric.meaning} [{metric.unit}]" if metric.unit else metric.meaning)
                 for metric in registry.load(kind, name)]  # type: ignore[attr-defined]
        return [f"  metric={name}", *(line for head in heads for line in _entry(*head))]
    cls = registry.load(kind, name)
    origin = registry.origins(kind, name)[0]
    notes = [note for note in ("the default" if is_default else "",
                               "" if origin.distribution.startswith("rhs ") else f"from {origin.distribution}",
                               f"needs {', '.join(sorted(cls.needs))}" if cls.needs else "",  # type: ignore[attr-defined]
                               ) if note]
    meaning = summary(cls) + (f" ({'; '.join(notes)})" if notes else "")
    lines = list(_entry(f"  {kind}={name}", meaning))
    owner = "" if kind == "task" else kind
    return lines + list(_settings(cls, owner, skip=() if full else ("advanced",)))


def _core_settings() -> Iterator[str]:
    from rhs.config.compose import Core

    yield from _settings(Core, "", skip=("features",))
    yield from _settings(FeatureSettings, "features", skip=("advanced",))


def _settings(cls: type, owner: str, skip: Sequence[str] = (), values: dict[str, Any] | None = None) -> Iterator[str]:
    """One entry per setting: `key=default`, meaning, type, range; nested settings follow, with the defaults (`values`) that
    the class above gives them."""
    hints, meanings, values = typing.get_type_hints(cls), field_docs(cls), values or settings.defaults(cls)
    ranges, words = limits_of(cls, "range"), limits_of(cls, "words")
    for item in dataclasses.fields(cls):
        if not item.init or item.name in skip:
            continue
        key = settings.dotted(owner, item.name)
        if dataclasses.is_dataclass(hints[item.name]):
            yield from _settings(hints[item.name], key, values=values[item.name])  # type: ignore[arg-type]
            continue
        kind = " | ".join(filter(None, words.get(item.name, ()))) or settings.type_name(hints[item.name])
        if item.name in ranges:
            kind += ", {:.10g} to {:.10g}".format(*ranges[item.name])
        yield from _entry(f"    {key}={show(values[item.name])}", f"{meanings.get(item.name, '')} [{kind}]".strip())


def show(value: Any) -> str:
    """A default as one would type it."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, list):
        return f"[{','.join(map(show, value))}]"
    return str(value)


def _entry(head: str, text: str, indent: int = 40) -> Iterator[str]:
    wrapped = textwrap.wrap(text, WIDTH - indent) or [""]
    if len(head) >= indent - 1:
        yield head
        head = ""
    yield f"{head:<{indent}}{wrapped[0]}".rstrip()
    for line in wrapped[1:]:
        yield " " * indent + line
