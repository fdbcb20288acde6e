"""`python -m rhs blame RUN [key=value ...]`: which link of the chain cost what.

    python -m rhs blame results/runs/RUN                     the run's own patrol, and counterfactual ones
    python -m rhs blame RUN links=[sense,odometry,localise]  these links; more than five are sampled
    python -m rhs -m task=blame ... 'seed=range(10)'         over seeds: `rhs table` gives means with intervals

The run's configuration is taken with task=blame, other words are laid over it. Exit codes as of a run.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rhs.base.errors import ConfigError
from rhs.config.compose import TASK, RunConfig, overlaid
from rhs.sweeps.runs import values_of

from .one_run import one_run


def main(words: Sequence[str]) -> int:
    """The command."""
    return one_run(config_of(words), debug=False)


def config_of(words: Sequence[str]) -> RunConfig:
    """The configuration of the run folder named first, with task=blame and the other words laid over it.

    Raises ConfigError."""
    if not words or ("=" in words[0] and "/" not in words[0].partition("=")[0] and not Path(words[0]).is_dir()):
        raise ConfigError("blame: which run? type python -m rhs blame FOLDER")
    folder = Path(words[0])
    try:
        values = values_of([folder])[folder]
    except ConfigError as error:
        raise ConfigError(f"blame {folder}: {error}") from error
    if values.get(TASK) not in ("patrol", "blame"):
        raise ConfigError(f"blame {folder}: task={values.get(TASK)}; blame takes patrols apart")
    values |= {TASK: "blame", "output": "", "overwrite": False}
    return overlaid(values, list(words[1:]))
