"""What a settings dataclass says about itself: its docstring, and the string literal after each field.

An attribute docstring is what an IDE shows, what documentation tools print and what --help says: one home for each fact.
"""

from __future__ import annotations

import ast
import dataclasses
import inspect
import textwrap


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
            out.update(_own_docs(base))
    return out


def _own_docs(cls: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(cls))
        node = ast.parse(source).body[0]
    except (OSError, TypeError, SyntaxError):
        return {}
    body = node.body if isinstance(node, ast.ClassDef) else []
    out: dict[str, str] = {field.target.id: "" for field in body if isinstance(field, ast.AnnAssign)
                           and isinstance(field.target, ast.Name)}
    for field, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name):
            if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant) and isinstance(after.value.value, str):
                out[field.target.id] = " ".join(after.value.value.split())
    return out
