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
    from .compose import compose_config
    from .experiment import run_config
    from .folders import claim_run
    from .notebook import unwatched
    from .progress import bar

    config = compose_config(list(overrides))
    with claim_run(config.output, seed=config.seed, overwrite=config.overwrite) as claim:
        row = run_config(config, claim.folder, unwatched if quiet else bar)
        row.pop("_cause", None)
        return row | {"folder": str(claim.folder)}
