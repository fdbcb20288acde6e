"""Short YAML is read in C: the same values, the same refusals."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from rhs.base import strict_yaml
from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import parse_yaml

ROOT = Path(__file__).resolve().parents[2]
TEXTS = [path.read_text() for folder in ("conf", "worlds") for path in sorted((ROOT / folder).rglob("*.yaml"))]
WRONG = ["a: 1\na: 2", "a: *b", "a: [1", "a: !!python/name:os.system", "a: " + "9" * 400, "[" * 100 + "]" * 100, "a:\t1: 2"]


def test_short_texts_say_what_the_loader_in_python_says():
    assert len(TEXTS) > 40
    for text in [*TEXTS, "a: 012\nb: no\nc: 12:30\nd: 1e3\ne: ~\nf: true\ng: .inf"]:
        assert repr(parse_yaml(text, "x")) == repr(yaml.load(text, strict_yaml._Loader))  # noqa: S506


@pytest.mark.parametrize("text", WRONG)
def test_what_is_refused_is_refused_in_the_same_words(text, monkeypatch):
    with pytest.raises(ConfigError) as quick:
        parse_yaml(text, "x")
    monkeypatch.setattr(strict_yaml, "_SHORT", -1)
    with pytest.raises(ConfigError) as slow:
        parse_yaml(text, "x")
    assert str(quick.value) == str(slow.value)
