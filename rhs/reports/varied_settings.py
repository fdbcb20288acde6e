"""The settings of runs, read from the config.yaml of each run folder; those that differ become columns of the table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from rhs.base.commands import check_regular
from rhs.base.errors import RhsError
from rhs.config.compose import OUTPUTS

KEPT_APART = (*OUTPUTS, "task", "world", "seed")
LARGEST_BYTES = 1 << 20
MOST_VALUES = 20_000


def varied_settings(folders: list[str]) -> dict[str, dict[str, object]]:
    """folder -> {dotted key: value} of the settings that more than one value was used for, everywhere or among the runs
    with the same part; names of parts are left out. Lists become text."""
    settings = {folder: settings_of(folder) for folder in folders}
    known = [one for one in settings.values() if one]
    names = sorted({key for one in known for key in one if key not in KEPT_APART and not key.endswith(".name")})
    varied = [key for key in names if _varies(key, known)]
    return {folder: {key: one[key] for key in varied if key in one} for folder, one in settings.items()}


def _varies(key: str, known: list[dict[str, object]]) -> bool:
    """Whether runs differ in it. A key that a run with the same part lacks is none of an older version when it stands in a
    group or dict of the part: there it is another value."""
    values = [repr(one[key]) for one in known if key in one]
    if len(values) == len(known):
        return len(set(values)) > 1
    part, inside = f"{key.split('.')[0]}.name", key.count(".") > 1
    by_part: dict[object, set[str]] = {}
    for one in known:
        if key in one or (inside and part in one):
            by_part.setdefault(one.get(part), set()).add(repr(one[key]) if key in one else "")
    return any(len(found) > 1 for found in by_part.values())


def is_setting(column: str) -> bool:
    """Whether a column of the table is a setting that differs between the runs."""
    return "." in column or column in ("start", "goal", "obstacles", "obstacle_count", "moved_count", "people_count")


def settings_of(folder: Path | str) -> dict[str, object]:
    """The whole configuration of a run as {dotted key: value}, but where its results go; empty when it cannot be read."""
    path = Path(folder) / "config.yaml"
    try:
        check_regular(path)
        if path.stat().st_size > LARGEST_BYTES:
            return {}
        content = yaml.load(path.read_bytes(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506
        if not isinstance(content, dict) or sum(1 for _ in _within(content)) > MOST_VALUES:
            return {}
        return flat({key: value for key, value in content.items() if key not in OUTPUTS})
    except (OSError, ValueError, RecursionError, yaml.YAMLError, RhsError):
        return {}


def flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """{"planner": {"step_m": 1}} -> {"planner.step_m": 1}; lists and whatever else is no plain value become text."""
    out: dict[str, object] = {}
    for key, value in config.items():
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{key}.")
        else:
            plain = value is None or isinstance(value, bool | int | float | str) and value == value
            out[f"{prefix}{key}"] = value if plain else str(value)
    return out


def _within(value: object) -> Iterable[object]:
    """Every value inside, as often as it is referred to, up to the number that is too many."""
    waiting, count = [value], 0
    while waiting and count <= MOST_VALUES:
        one = waiting.pop()
        count += 1
        yield one
        waiting += one.values() if isinstance(one, Mapping) else one if isinstance(one, list) else ()
