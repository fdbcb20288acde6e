"""The checks by kind, and those of the settings that every kind has. See rhs.testing."""

from __future__ import annotations

import dataclasses
import functools
import tempfile
import traceback
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rhs.api.contracts import DEGRADE as DEGRADED
from rhs.api.contracts import SLAM
from rhs.api.errors import ConfigError, ContractError
from rhs.api.settings import slip
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE
from rhs.base.errors import words_of
from rhs.config.documented import field_docs, summary
from rhs.config.parts import SENSED

from .degradations import DEGRADE
from .localisers import LOCALISER
from .loop_closers import LOOP_CLOSER
from .mappers import MAPPER
from .odometry import ODOMETRY
from .planners import PLANNER
from .replans import REPLAN
from .sensors import SENSOR
from .slams import SLAMS
from .sources import SOURCE

Check = Callable[[Any, Path], None]
WORDS = SENSED | {"walls", "extras"}  # of needs and provides that are no extra modality
SHOWN = WORDS | {"cloud", RIGHT_IMAGE, RIGHT_CAMERA}  # what the views of these checks hold


def check_plugin(kind: str, settings: Any) -> None:
    """Run all checks of a kind (`source`, `sensor`, ...) on an instance of the plugin's dataclass.

    Raises AssertionError: which check, what was found, what was expected."""
    for name, check in checks(kind).items():
        with tempfile.TemporaryDirectory() as folder:
            try:
                check(settings, Path(folder))
            except AssertionError as error:
                raise AssertionError(f"{kind} {type(settings).__name__}: {name.replace('_', ' ')}: {error}") from error


CHECKED = {"source": SOURCE, "sensor": SENSOR, "odometry": ODOMETRY, "loop_closer": LOOP_CLOSER, "localiser": LOCALISER,
           "mapper": MAPPER, "planner": PLANNER, "replan": REPLAN, DEGRADED: DEGRADE, SLAM: SLAMS}  # by kind


def checks(kind: str) -> dict[str, Check]:
    """Name -> check(settings, folder) for a kind of part. Each raises AssertionError, whatever the part itself raised."""
    if kind not in CHECKED:
        raise ConfigError(f"no checks for kind {kind}; there are for {', '.join(CHECKED)}")
    return {check.__name__: _asserting(check) for check in (*SETTINGS, *CHECKED[kind])}


def _asserting(check: Check) -> Check:
    """The check, with any other exception of the part turned into an AssertionError that says where it was raised."""
    @functools.wraps(check)
    def asserting(settings: Any, folder: Path) -> None:
        try:
            check(settings, folder)
        except AssertionError as error:
            if str(error):
                raise
            raise AssertionError(in_words(error)) from error  # of the part, which says nothing
        except Exception as error:
            hint = ("; depth, scan and wheel are None unless `needs` names them, wheel and command also in a view without "
                    "content" if "NoneType" in str(error) and _its_own(error) else "")
            raise AssertionError(in_words(error) + hint) from error

    return asserting


def in_words(error: BaseException) -> str:
    """What a part raised, and its own line in which it did; or, as it stands, why rhs refused what it returned."""
    if isinstance(error, ContractError):
        return " ".join(str(error).split())
    own = _its_own(error)
    return " ".join(f"{type(error).__name__}: {words_of(error)}{f' ({own[-1]})' if own else ''}".split())


def _its_own(error: BaseException) -> list[str]:
    """The lines of the part's own package that led to an error, the last of them last; what it called beyond is not its."""
    frames = [(str(frame.f_globals.get("__name__", "")).partition(".")[0], frame.f_code.co_filename, line)
              for frame, line in traceback.walk_tb(error.__traceback__)]
    owner = next((package for package, _, _ in frames if package != "rhs"), "")
    return [f"{Path(file).name}:{line}" for package, file, line in frames if package == owner]


def says_what_it_is(settings: Any, folder: Path) -> None:
    assert summary(type(settings)), "write a docstring: --help shows its first paragraph"


def says_what_every_setting_means(settings: Any, folder: Path) -> None:
    silent = silent_settings(type(settings))
    assert not silent, f"write a string literal after each of these settings saying what it means: {', '.join(silent)}"


def silent_settings(cls: type, owner: str = "") -> list[str]:
    """The settings without a meaning, those of nested groups included; a group says what it is by its own docstring."""
    hints, meanings, out = typing.get_type_hints(cls), field_docs(cls), []
    for item in dataclasses.fields(cls):
        hint = hints[item.name]
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            out += ([] if summary(hint) else [owner + item.name]) + silent_settings(hint, f"{owner}{item.name}.")
        elif item.init and not meanings.get(item.name):
            out.append(owner + item.name)
    return out


def declares_what_it_needs_and_provides(settings: Any, folder: Path) -> None:
    for word in ("needs", "provides"):
        value = getattr(type(settings), word, None)
        assert isinstance(value, frozenset), f"{word} must be a ClassVar[frozenset[str]], found {type(value).__name__}"
        for one in sorted(value - WORDS):
            meant = slip(one, WORDS)
            assert not meant, f"{word} names {one!r}; did you mean {meant}?"


SETTINGS: tuple[Check, ...] = (says_what_it_is, says_what_every_setting_means, declares_what_it_needs_and_provides)
