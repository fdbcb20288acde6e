"""Imported by the process that the jobs of a sweep are forked from, and by no other: what every job needs is done once."""

from __future__ import annotations

import warnings

from rhs.base.processes import adopt_orphans
from rhs.base.provenance import commit, versions

# What jobs left behind becomes this process's, for the sweep to find.
adopt_orphans()
warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
commit()
versions()
