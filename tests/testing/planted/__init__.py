"""Parts by strangers: of each kind honest ones, which must pass rhs.testing, and ones with one mistake each, which must not.

A mistake is a class of a few lines whose docstring says what is wrong; `says` is what its author must be told.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar


def settings(part: Callable[[Any], Any], needs: str = "", provides: str = "") -> Any:
    """Settings of a plugin that builds this part: part(context)."""
    wants, offers = frozenset(needs.split()), frozenset(provides.split())

    @dataclass
    class Planted:
        """A part of somebody else's."""

        needs: ClassVar[frozenset[str]] = wants
        provides: ClassVar[frozenset[str]] = offers

        def build(self, context: Any) -> Any:
            return part(context)

    return Planted()
