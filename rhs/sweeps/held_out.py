"""Buildings that nobody could tune on: their list is promised by a hash now and shown later.

A promise is the SHA-256 of `NAME\\nSALT\\nBUILDING BUILDING ...`; whoever shows the list shows the salt with it, as JSON:
{"suite": NAME, "salt": SALT, "buildings": ["random:FAMILY/NUMBER", ...]}. Without the salt the list could be guessed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

from rhs.base.errors import ConfigError
from rhs.worlds.random.names import parse

PROMISED = {
    "corridor-v1": "aeaa74bf16432c3022d1d2ad9e4d80bad809c3ee4089ebf46eac02158e216491",
    "home-v1": "e7b5a511ea8179f0b3471b41389a50efeb5673a342a56880a5da6ae0709eb4a3",
}


def promise(name: str, salt: str, buildings: Sequence[str]) -> str:
    """The 64 hex digits that stand for this list."""
    return hashlib.sha256(f"{name}\n{salt}\n{' '.join(buildings)}".encode()).hexdigest()


def revealed(name: str, path: Path) -> tuple[tuple[str, int], ...]:
    """The buildings of a list that is shown, with the seeds of their runs. Raises ConfigError unless it is the one that was
    promised."""
    try:
        content = json.loads(path.read_text("utf-8"))
        salt, buildings = str(content["salt"]), [str(one) for one in content["buildings"]]
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f'{path}: expected {{"suite": ..., "salt": ..., "buildings": [...]}} ({error})') from error
    if promise(name, salt, buildings) != PROMISED.get(name):
        raise ConfigError(f"{path} is not the list that was promised for {name}: sha256 {PROMISED.get(name, 'none')}")
    return tuple((world, parse(world).number or 0) for world in buildings)
