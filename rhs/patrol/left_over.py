"""What a run leaves in its process for the next one: a notebook holds many, and no row may depend on those before it."""

from __future__ import annotations

import contextlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from types import ModuleType
from typing import Any

import numpy as np

from rhs.base.global_generators import drawn_since, global_states
from rhs.config.compose import RunConfig

LARGEST = 10_000_000  # bytes of an array that is looked at


@contextmanager
def left_as_found(config: RunConfig) -> Iterator[None]:
    """The folder, numpy's error state, stdout and stderr are afterwards as they were. A UserWarning names what the parts of
    strangers changed in their classes and at the top of their modules, and the global generators that were used."""
    homes = {type(one.settings).__module__.partition(".")[0] for one in (config.task, *config.parts.values())}
    homes = {home for home in homes if home != "rhs" and not home.startswith("rhs_")}
    here, numerics, states, before = os.getcwd(), np.geterr(), global_states(), shared_state(homes)
    try:
        with redirect_stdout(sys.stdout), redirect_stderr(sys.stderr):
            yield
    finally:
        np.seterr(**numerics)
        with contextlib.suppress(OSError):
            os.chdir(here)
    changed = [name for name, content in shared_state(homes).items() if before.get(name, content) != content]
    changed += [f"{name}'s global generator" for name in (drawn_since(states) if homes else ())]
    if changed:
        warnings.warn(f"this run changed {', '.join(changed[:4])}: the next one in this process begins with that, and may "
                      "give another row; a part keeps in itself (self) what it learns, and draws from context.rng",
                      stacklevel=5)


def shared_state(homes: set[str]) -> dict[str, bytes]:
    """What stands in classes of these packages, and at the top of their modules, by its name. Of
    `__main__`, where people keep all else, only the classes."""
    out: dict[str, bytes] = {}
    for name, module in list(sys.modules.items()):
        if name.partition(".")[0] in homes and isinstance(module, ModuleType):
            own = {} if name == "__main__" else vars(module)
            classes = [one for one in vars(module).values() if isinstance(one, type) and one.__module__ == name]
            for owner, values in ((name, own), *((one.__qualname__, vars(one)) for one in classes)):
                out |= {f"{owner}.{key}": content for key, value in list(values.items())
                        if not key.startswith("__") and (content := _content(value))}
    return out


def _content(value: Any) -> bytes:
    """A plain value in bytes; empty for what is none."""
    if isinstance(value, np.ndarray):
        return value.tobytes() if value.nbytes <= LARGEST else b""
    with contextlib.suppress(Exception):
        return repr(value).encode() if isinstance(value, bool | int | float | str | list | dict | set | bytearray) else b""
    return b""
