"""The public surface: every exported name stands in a checked-in list and says what it is."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import rhs
import rhs.api
import rhs.testing
from rhs.config.dictionary import ENUMERATIONS, STEPS, columns, members

ROOT = Path(__file__).resolve().parents[2]
LIST = Path(__file__).with_name("public_names.txt")
ROOMS = ("api", "estimation", "plots", "recording", "testing", "worlds")


def definitions() -> Iterator[tuple[str, ast.AST]]:
    """(room.module.name, definition) of every public class and function of the public rooms."""
    for room in ROOMS:
        for path in sorted((ROOT / "rhs" / room).rglob("*.py")):
            module = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            for node in ast.parse(path.read_text("utf-8")).body:
                if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                    yield f"{module}.{node.name}", node


def names() -> list[str]:
    return sorted([*(f"rhs.{name}" for name in rhs.__all__), *(f"rhs.api.{name}" for name in rhs.api.__all__),
                   *(f"rhs.testing.{name}" for name in rhs.testing.__all__), *(name for name, _ in definitions())])


def test_the_public_names_are_those_of_the_list():
    """A changed surface is seen in review: `python tests/api/test_public_names.py` writes the list anew."""
    assert names() == LIST.read_text().split()


def test_every_exported_name_is_there():
    for module in (rhs, rhs.api, rhs.testing):
        assert {name for name in module.__all__ if not hasattr(module, name)} == set()


def test_every_public_name_says_what_it_is():
    """A check of the conformance kit says it by its name, which is what its author is shown."""
    silent = [name for name, node in definitions() if not ast.get_docstring(node) and not is_check(node)]
    assert silent == []


def is_check(node: ast.AST) -> bool:
    return isinstance(node, ast.FunctionDef) and [arg.arg for arg in node.args.args] == ["settings", "folder"]


@pytest.mark.parametrize("cls", ENUMERATIONS.values(), ids=lambda cls: cls.__name__)
def test_every_event_and_status_is_explained(cls):
    assert {member.value for member in cls} == {name for name, meaning in members(cls).items() if meaning}


def test_every_column_is_explained():
    assert {column.name for column in [*columns().values(), *STEPS] if not column.meaning or not column.source} == set()
    assert len(columns()) > 100


if __name__ == "__main__":
    LIST.write_text("\n".join(names()) + "\n")
