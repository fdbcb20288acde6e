"""The numbers of a run, from its folder alone."""
