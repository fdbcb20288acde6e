"""A stranger's metrics: one that counts views, one that fails."""

from rhs.api.metric import Metric

FAKE = (
    Metric("views_seen", "", "lines of steps.csv", "steps.csv", lambda run: len(run.steps), tasks=("survey",)),
    Metric("broken_m", "m", "fails always", "nowhere", lambda run: 1.0 / 0.0, tasks=("survey",)),
)
