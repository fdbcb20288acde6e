"""Tasks: planning alone, single places, unrolling a tube."""
