"""Settings of every type, and parts that can be built but do nothing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from rhs.errors import check_range

NOTHING: frozenset[str] = frozenset()


class Part:
    """A part that remembers what it was built from."""

    def __init__(self, settings: Any, context: Any) -> None:
        self.settings, self.context, self.closed = settings, context, False
        self.camera, self.facts = "camera", "facts"

    def close(self) -> None:
        self.closed = True


class _Config:
    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Part:
        return Part(self, context)


@dataclass
class FakeSource(_Config):
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "driving", "command"})
    # pixels across
    image_width: int = 32


@dataclass
class FakeSensor(_Config):
    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "scan", "wheel", "command"})


@dataclass
class FakeMono(_Config):
    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "command"})


@dataclass
class FakeOdometry(_Config):
    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})


@dataclass
class FakeEye(_Config):
    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan"})


@dataclass
class FakeCloser(_Config):
    pass


@dataclass
class FakeMapper(_Config):
    needs: ClassVar[frozenset[str]] = frozenset({"scan"})


@dataclass
class FakePlanner(_Config):
    # points drawn
    samples: int = 100
    step_m: float = 0.5  # longest edge, metres
    mode: str = "fast"
    smooth: bool = True
    # numbers of several kinds
    weights: list[float] = field(default_factory=lambda: [1.0, 2.0])
    limit: float | None = None
    norm: Literal["l1", "l2"] = "l2"

    def __post_init__(self) -> None:
        check_range("planner.fake", "samples", self.samples, low=1, high=1_000_000)
        check_range("planner.fake", "step_m", self.step_m, low=0.01, high=10.0, unit="m")


@dataclass
class FakeLocaliser(_Config):
    pass


not_a_class = 7
