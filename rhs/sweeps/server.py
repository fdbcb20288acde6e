"""Imported by the process that the jobs of a sweep are forked from, and by no other: what every job needs is done once."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import sys
import warnings

from rhs.api.contracts import PLUGIN_KINDS
from rhs.base.processes import SWEEP_PATH, SWEEP_PRELOAD, adopt_orphans
from rhs.base.provenance import commit, versions
from rhs.config import registry

sys.path[:] = os.environ[SWEEP_PATH].split(os.pathsep)  # where the process that sweeps looks for modules
# What jobs left behind becomes this process's, for the sweep to find.
adopt_orphans()
warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
commit()
versions()
for _kind in PLUGIN_KINDS:  # strangers' plugins are listed, and imported in the jobs
    for _name in registry.names(_kind):
        _origins = registry.origins(_kind, _name)
        if _kind == "metric" and len(_origins) == 1 and _origins[0].distribution.startswith("rhs "):
            registry.load(_kind, _name)
signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that sweeps answers it; it was blocked until here
signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
for _name in os.environ[SWEEP_PRELOAD].split():
    with contextlib.suppress(BaseException):  # it may raise anything, even exit: the jobs that want it say so
        importlib.import_module(_name)
