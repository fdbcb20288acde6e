"""Robotic Home Sentinel: camera to patrol, as an experiment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

__all__ = ["run"]


def run(overrides: Sequence[str] = (), *, quiet: bool = False) -> dict[str, Any]:
    """Run one experiment from `key=value` words, as on the command line, and return its row (for notebooks).

    The run folder stands in the row as `folder`. Raises ConfigError for what is refused before anything runs; a failure
    later is a row whose `status` is not "ok" and whose `reason` says why.
    """
    from rhs.config.compose import compose_config
    from rhs.patrol.observers import unwatched
    from rhs.patrol.progress import bar
    from rhs.patrol.run import run_config
    from rhs.runfolder.folders import claim_run

    config = compose_config(list(overrides))
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        row = run_config(config, claim.folder, unwatched if quiet else bar)
        row.pop("_cause", None)
        return row | {"folder": str(claim.folder)}
