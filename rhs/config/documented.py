"""What a settings dataclass says about itself: its docstring, and the comments of its fields."""

from __future__ import annotations

import ast
import dataclasses
import inspect
import io
import textwrap
import tokenize


def summary(cls: type) -> str:
    """The first paragraph of the docstring on one line; empty if there is none."""
    text = inspect.cleandoc(cls.__doc__ or "")
    if text.startswith(f"{cls.__name__}("):  # the text that @dataclass makes up
        return ""
    return " ".join(text.split("\n\n", 1)[0].split())


def comments(cls: type) -> dict[str, str]:
    """Field -> its comment: the lines of comment right above it and the one behind it, base classes included."""
    out: dict[str, str] = {}
    for base in reversed(cls.__mro__):
        if dataclasses.is_dataclass(base):
            out.update(_own_comments(base))
    return out


def _own_comments(cls: type) -> dict[str, str]:
    try:
        source = textwrap.dedent(inspect.getsource(cls))
        tree = ast.parse(source)
    except (OSError, TypeError, SyntaxError):
        return {}
    lines = source.splitlines()
    notes = {token.start[0]: token.string.lstrip("#").strip()
             for token in tokenize.generate_tokens(io.StringIO(source).readline) if token.type == tokenize.COMMENT}
    body = tree.body[0].body if isinstance(tree.body[0], ast.ClassDef) else []
    out: dict[str, str] = {}
    last_name, last_line = "", 0
    for node in body:
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            shared = out.get(last_name, "") if node.lineno == last_line + 1 else ""
            out[node.target.id] = _comment_of(node, notes, lines) or shared  # right below: one comment for both
            last_name, last_line = node.target.id, node.end_lineno or node.lineno
    return out


def _comment_of(node: ast.AnnAssign, notes: dict[int, str], lines: list[str]) -> str:
    above: list[str] = []
    number = node.lineno - 1
    while number in notes and lines[number - 1].lstrip().startswith("#"):
        above.insert(0, notes[number])
        number -= 1
    behind = [notes[n] for n in range(node.lineno, (node.end_lineno or node.lineno) + 1) if n in notes]
    return " ".join(above + behind)
