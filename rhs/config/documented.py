"""What a settings dataclass says about itself: its docstring, and the string literal after each field.

An attribute docstring is what an IDE shows, what documentation tools print and what --help says: one home for each fact.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap
from functools import cache
from itertools import zip_longest
from pathlib import Path


def summary(cls: type) -> str:
    """The first paragraph of the docstring on one line; empty if there is none."""
    text = inspect.cleandoc(cls.__doc__ or "")
    if text.startswith(f"{cls.__name__}("):  # the text that @dataclass makes up
        return ""
    return " ".join(text.split("\n\n", 1)[0].split())


def field_docs(cls: type) -> dict[str, str]:
    """Field -> the string literal right after it on one line, "" where there is none; base classes included."""
    out: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            out.update(own_docs(base))
    return out


def own_docs(cls: type) -> dict[str, str]:
    """Of a class alone: field, or member of an enumeration, -> the string literal after it."""
    body = _body(cls)
    out: dict[str, str] = {}
    for field, after in zip_longest(body, body[1:]):
        target = getattr(field, "target", None) or next(iter(getattr(field, "targets", ())), None)  # with a type, without
        if isinstance(target, ast.Name):
            literal = after.value if isinstance(after, ast.Expr) else None
            text = literal.value if isinstance(literal, ast.Constant) and isinstance(literal.value, str) else ""
            out[target.id] = " ".join(text.split())
    return out


def _body(cls: type) -> list[ast.stmt]:
    """The statements of a class; none where nobody has its source (typed into a shell)."""
    try:
        classes = _classes(inspect.getsourcefile(cls) or "")
        if cls.__qualname__ not in classes:
            return list(_first(ast.parse(textwrap.dedent(inspect.getsource(cls)))))
    except (OSError, TypeError, SyntaxError):
        return []
    return classes[cls.__qualname__]


def _first(tree: ast.Module) -> list[ast.stmt]:
    return tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []


@cache
def _classes(path: str) -> dict[str, list[ast.stmt]]:
    """Qualified name -> statements of the classes at the top of a file, which is read once."""
    tree = ast.parse(Path(path).read_text(encoding="utf-8"))
    return {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}
