"""Settings that say beside their default what they may be."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest

from rhs.api.errors import Bounded, ConfigError, limits_of, one_of, within
from rhs.api.settings import make


@dataclass
class Inner(Bounded):
    share: float = within(0.5, 0.0, 1.0)


@dataclass
class Outer(Bounded):
    near_m: float = within(0.3, 0.0, 10.0, below="far_m")
    far_m: float = within(5.0, 0.1, 100.0)
    most: int | None = within(None, 1, 9)
    mode: str = one_of("fast", "exact")
    roughness: float = within(2.0, 0.0, 100.0, unit="grey levels")
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.inner.share > 0.9 and self.mode == "fast":
            raise ConfigError(f"inner.share={self.inner.share} needs mode=exact")
        if self.roughness == 7.0:
            raise ConfigError("roughness (of a wall)=7.0 is nobody's")


@dataclass
class Further(Outer):
    far_m: float = 50.0


@pytest.mark.parametrize(("wrong", "said"), [
    ({"near_m": -0.1}, "part.near_m=-0.1 is outside the allowed range [0, 10] m"),
    ({"far_m": math.nan}, "part.far_m=nan is outside the allowed range [0.1, 100] m"),
    ({"near_m": 5.0}, "part.near_m=5.0 is not below far_m=5.0"),
    ({"most": 10}, "part.most=10 is outside the allowed range [1, 9]"),
    ({"mode": "magic"}, "part.mode=magic is not one of fast, exact"),
    ({"roughness": 200.0}, "part.roughness=200.0 is outside the allowed range [0, 100] grey levels"),
    ({"roughness": 7.0}, "part.roughness (of a wall)=7.0 is nobody's"),
    ({"inner": {"share": 0.95}}, "part.inner.share=0.95 needs mode=exact"),
    ({"inner": {"share": 1.5}}, "part.inner.share=1.5 is outside the allowed range [0, 1]")])
def test_what_is_not_allowed_is_refused_by_the_key_that_was_typed(wrong, said):
    with pytest.raises(ConfigError) as error:
        make(Outer, wrong, "part")
    assert str(error.value) == said


def test_what_is_allowed_is_taken_ends_included_and_null_where_there_may_be_none():
    made = make(Outer, {"near_m": 0.0, "far_m": 100.0, "most": 9, "mode": "exact", "inner": {"share": 1.0}}, "part")
    assert (made.near_m, made.far_m, made.most, made.mode, made.inner.share) == (0.0, 100.0, 9, "exact", 1.0)
    assert make(Outer, {"most": None}, "part") == Outer()


def test_a_class_with_another_default_keeps_the_range():
    assert Further().far_m == 50.0 and limits_of(Further, "range")["far_m"] == (0.1, 100.0)
    with pytest.raises(ConfigError, match="^far_m=1000"):
        Further(far_m=1000.0)
