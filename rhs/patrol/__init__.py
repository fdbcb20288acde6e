"""The loop, the run, the survey and the sentinel."""
