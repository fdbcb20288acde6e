"""Many runs from Python."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rhs.base.errors import ConfigError
from rhs.runfolder.folders import claim_sweep

from . import running, sweep
from .jobs import Limits, processes

if TYPE_CHECKING:
    import pandas


def sweep_words(words: Sequence[str] | Mapping[str, Any], *, jobs: int = 0, timeout_s: float = 3600.0) -> pandas.DataFrame:
    """rhs.sweep."""
    from rhs.reports.table import rows

    if isinstance(words, str):
        raise ConfigError(f"'{words}' is one text; give a list of words, [\"key=value\", ...]")
    typed = [f"{key}={_typed(value)}" for key, value in words.items()] if isinstance(words, Mapping) else list(words)
    plan = sweep.plan(typed)
    with claim_sweep(plan.output) as claim:
        sweep.remember(plan, claim.folder)
        running.run_plan(plan, claim.folder, Limits(jobs or processes(), timeout_s), tell=lambda status, outcome: None)
        return rows([claim.folder])


def _typed(value: Any) -> str:
    """A value, or a list or range of values to combine, as one would type it."""
    if isinstance(value, (list, tuple, range)):
        return ",".join(_typed(item) if not isinstance(item, (list, tuple)) else str(list(item)).replace(" ", "")
                        for item in value)
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    return str(value)
