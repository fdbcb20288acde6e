"""Settings that differ between the runs of a table become its columns, read from the config.yaml of each run folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

KEPT_APART = ("output", "overwrite", "recording", "video", "live", "task", "world", "seed")


def varied_settings(folders: list[str]) -> dict[str, dict[str, object]]:
    """folder -> {dotted key: value} of the settings that more than one value was used for. Lists become text."""
    settings = {folder: flat(_config(Path(folder) / "config.yaml")) for folder in folders}
    values: dict[str, set[str]] = {}
    for known in settings.values():
        for key, value in known.items():
            values.setdefault(key, set()).add(repr(value))
    everywhere = [key for key in values if all(key in known for known in settings.values() if known)]
    varied = [key for key in everywhere if len(values[key]) > 1]
    return {folder: {key: known[key] for key in varied if key in known} for folder, known in settings.items()}


def flat(config: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """{"planner": {"step_m": 1}} -> {"planner.step_m": 1}; names of parts and where results go are left out."""
    out: dict[str, object] = {}
    for key, value in config.items():
        if not prefix and key in KEPT_APART or prefix and key == "name":
            continue
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{key}.")
        else:
            out[f"{prefix}{key}"] = str(value) if isinstance(value, list) else value
    return out


def _config(path: Path) -> dict[str, Any]:
    import yaml

    try:
        content = yaml.load(path.read_bytes(), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
    except (OSError, yaml.YAMLError):
        return {}
    return content if isinstance(content, dict) else {}
