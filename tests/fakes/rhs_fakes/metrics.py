"""A stranger's metric, which counts views."""

from rhs.api.metric import Metric

FAKE = (Metric("views_seen", "", "lines of steps.csv", "steps.csv", lambda run: len(run.steps), tasks=("survey",)),)
