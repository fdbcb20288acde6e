"""Several plugins of one kind under one name, `degrade=blur+low_light`: their settings side by side, in one dataclass."""

from __future__ import annotations

import dataclasses
import typing
from typing import Any

from rhs.api.contracts import DEGRADE
from rhs.api.settings import RESERVED
from rhs.base.errors import PluginError

JOINED = "+"


def names_in(kind: str, name: str) -> list[str]:
    """The plugins that a name stands for: one, or of degradations as many as it joins."""
    return name.split(JOINED) if kind == DEGRADE else [name]


def joined(kind: str, members: dict[str, type]) -> type:
    """One settings dataclass for these plugins; each of its settings is one of theirs.

    Raises PluginError where two of them have a setting of one name."""
    hints = {name: typing.get_type_hints(cls) for name, cls in members.items()}
    owner: dict[str, str] = {}
    fields: list[Any] = []
    for name, cls in members.items():
        for item in dataclasses.fields(cls):
            if not item.init or item.name in RESERVED:
                continue
            if item.name in owner:
                raise PluginError(f"{kind}={JOINED.join(members)}: {owner[item.name]} and {name} both have a setting "
                                  f"{item.name}; rename it in one of them")
            owner[item.name] = name
            fields.append((item.name, hints[name][item.name], _default(item)))

    def check(self: Any) -> None:
        members_of(self)

    named = {"needs": frozenset().union(*(cls.needs for cls in members.values())),  # type: ignore[attr-defined]
             "provides": frozenset(), "members": members, "__post_init__": check}
    return dataclasses.make_dataclass("Joined", fields, namespace=named)


def _default(item: dataclasses.Field[Any]) -> Any:
    if item.default is not dataclasses.MISSING:
        return dataclasses.field(default=item.default)
    return dataclasses.field(default_factory=item.default_factory)  # type: ignore[arg-type]


def members_of(settings: Any) -> list[Any]:
    """The settings of each plugin that joined settings stand for, each checked by its own rules; of one plugin its own."""
    members = getattr(settings, "members", None)
    if members is None:
        return [settings]
    return [cls(**{item.name: getattr(settings, item.name) for item in dataclasses.fields(cls) if item.init})
            for cls in members.values()]
