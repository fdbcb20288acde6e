"""The text of --help, made from what is registered: every plugin, every setting, its meaning, type and default.

The meaning of a setting is the string literal after it in its settings dataclass: one home for each fact.
"""

from __future__ import annotations

import dataclasses
import textwrap
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from rhs.api import settings
from rhs.api.contracts import CHOICES
from rhs.api.records import FeatureSettings
from rhs.base.data_dirs import data_dir
from rhs.base.strict_yaml import load_yaml
from rhs.config import registry
from rhs.config.documented import field_docs, summary

WIDTH = 118

TOP = """\
python -m rhs [options] key=value ...     one run: map a building, then patrol it
python -m rhs -m key=value1,value2 ...    a sweep: one run for each combination of values
python -m rhs planner=prm --help          one part in full, with its advanced thresholds
python -m rhs COMMAND ...                 tables, reports, checks and more: python -m rhs help commands

Options
  -m, --multirun      run every combination of the given values, each in its own process
  --jobs N            parallel processes of a sweep (default: one per core); on another engine, its workers
  --timeout SECONDS   stop a job of a sweep after this time and count it as a failure (3600; 0: no limit)
  --memory-mb N       kill a job of a sweep above this memory and count it as a failure (4096, or its share of the machine)
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
share=false, jobs that differ only after the survey do not share one.
Exit codes: 0 done, 1 failed, 2 refused before anything ran, 3 finished but something failed, 130 and 143 interrupted.
The meaning of the columns of a table: python -m rhs help columns
"""


def help_text(words: Sequence[str] = ()) -> str:
    """All of it, or only the parts that the words `kind=name` choose."""
    wanted = [tuple(word.split("=", 1)) for word in words if word.split("=", 1)[0] in (*CHOICES, "engine") and "=" in word]
    if wanted:
        return "\n".join("\n".join(_plugin(kind, name, is_default=False, full=True)) for kind, name in wanted)
    lines = [TOP, "Experiments and stacks", *_folder_lines(), "", "Settings of a run", *_core_settings(), ""]
    chosen = _defaults() | {"engine": "process"}
    for kind in (*CHOICES, "engine"):
        lines += [f"{kind}: {', '.join(registry.names(kind)) or 'none registered'}", ""]
        for name in registry.names(kind):
            lines += _plugin(kind, name, is_default=chosen.get(kind) == name)
        lines.append("")
    return "\n".join(lines).rstrip()


def _defaults() -> dict[str, str]:
    """What conf/config.yaml chooses when nothing is said."""
    entries = load_yaml(data_dir("conf") / "config.yaml").get("defaults", [])
    return {key: str(value) for entry in entries if isinstance(entry, dict) for key, value in entry.items()}


def _folder_lines() -> Iterator[str]:
    for group in ("experiment", "stack"):
        for path in sorted((data_dir("conf") / group).glob("*.yaml")):
            yield from _entry(f"  {group}={path.stem}", _first_comment(path))


def _first_comment(path: Path) -> str:
    comments = [line.lstrip("# ").rstrip() for line in path.read_text("utf-8").splitlines() if line.startswith("#")]
    return next((line for line in comments if line and not line.startswith("@")), "")


def _plugin(kind: str, name: str, *, is_default: bool, full: bool = False) -> list[str]:
    if failure := registry.failure(kind, name):
        return list(_entry(f"  {kind}={name}", f"NOT USABLE: {failure}"))
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
    """One entry per setting: `key=default`, meaning, type; nested settings follow, with the defaults (`values`) that the
    class above gives them."""
    hints, meanings, values = typing.get_type_hints(cls), field_docs(cls), values or settings.defaults(cls)
    for item in dataclasses.fields(cls):
        if not item.init or item.name in skip:
            continue
        key = settings.dotted(owner, item.name)
        if dataclasses.is_dataclass(hints[item.name]):
            yield from _settings(hints[item.name], key, values=values[item.name])  # type: ignore[arg-type]
            continue
        kind = settings.type_name(hints[item.name])
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
