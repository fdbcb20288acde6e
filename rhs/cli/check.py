"""`python -m rhs check KIND=NAME [KIND.KEY=VALUE ...]`: does a plugin keep its contract?

Every check of rhs.testing for that kind, one line each. Exit code 0 when all hold, 1 when one does not, 2 refused.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from rhs.api import settings
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.config.overrides import parse, plain_words
from rhs.testing.checks import checks


def main(words: Sequence[str]) -> int:
    """The command."""
    found = plain_words(parse(words))
    if not found or "." in found[0].key:
        raise ConfigError("check: say which plugin, for example: python -m rhs check planner=prm")
    kind, name = found[0].key, str(found[0].value)
    cls = registry.load(kind, name)
    registry.check_requirements(kind, name, cls)
    values = {word.key.partition(".")[2]: word.value for word in found[1:]}
    chosen = settings.make(cls, values, kind)
    failed = 0
    for title, check in checks(kind).items():
        begin = time.perf_counter()
        with tempfile.TemporaryDirectory() as folder:
            reason = _reason(check, chosen, Path(folder))
        failed += bool(reason)
        said = f"{title.replace('_', ' ')}{f': {reason}' if reason else ''}"
        sys.stdout.write(f"{'FAILS' if reason else 'ok   '}{time.perf_counter() - begin:7.1f} s  {said}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{kind}={name}: {f'{failed} checks fail' if failed else 'keeps its contract'}\n")
    return 1 if failed else 0


def _reason(check: object, chosen: object, folder: Path) -> str:
    """Why the check fails, in one line; empty when it holds."""
    try:
        check(chosen, folder)  # type: ignore[operator]
    except AssertionError as error:
        return " ".join(str(error).split()) or "it does not hold"
    except Exception as error:  # whatever a plugin raises where it should not
        return " ".join(f"{type(error).__name__}: {error}".split())
    return ""
