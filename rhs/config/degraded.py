"""A source whose captures are spoiled before anybody sees them: `degrade=NAME`, several as `degrade=NAME+NAME`."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from rhs.api.contracts import DEGRADE, Degradation, Source
from rhs.api.geometry import Camera, inverse, planar, se2
from rhs.api.records import Capture, Twist
from rhs.api.settings import nearest
from rhs.api.validate import check_capture, check_pose
from rhs.api.validate_source import check_camera
from rhs.base.errors import ConfigError, ContractError, RhsError

from . import registry
from .overrides import Word
from .registry import JOINED, names_in

MOST_LOST = 1000  # views in a row


def with_owners(words: Sequence[Word]) -> list[Word]:
    """The words, and `degrade=NAME` for degradations whose settings are typed without naming them. Raises ConfigError."""
    keys = [word.key.split(".")[1] for word in words if word.key.startswith(f"{DEGRADE}.")]
    typed = next((word.value for word in reversed(words) if word.key == DEGRADE), None)
    chosen = names_in(DEGRADE, typed) if isinstance(typed, str) else []
    if not keys or any(one not in registry.names(DEGRADE) for one in chosen):
        return list(words)
    wanted = list(chosen)
    for key in keys:
        if not any(key in _settings(name) for name in wanted):
            wanted.append(_owner(key))
    if wanted == chosen:
        return list(words)
    name = JOINED.join(wanted)
    return [*(word for word in words if word.key != DEGRADE), Word(DEGRADE, name, f"{DEGRADE}={name}")]


def _settings(name: str) -> list[str]:
    return [item.name for item in dataclasses.fields(registry.load(DEGRADE, name))]


def _owner(key: str) -> str:
    """The one degradation that has this setting."""
    usable = [name for name in registry.names(DEGRADE) if registry.failure(DEGRADE, name) is None]
    owners = [name for name in usable if key in _settings(name)]
    if len(owners) == 1:
        return owners[0]
    if owners:
        raise ConfigError(f"{DEGRADE}.{key}: {' and '.join(owners)} have such a setting; type {DEGRADE}={owners[0]} too")
    known = [one for name in usable for one in _settings(name)]
    hint = nearest(key, known, DEGRADE) or f"; there is {', '.join(known)}"
    raise ConfigError(f"unknown key {DEGRADE}.{key}{hint}")


def fault_of(settings: Any) -> str:
    """The link of the chain that a degradation is a fault of: `drive` where all it spoils is what wheels count, else
    `sense`."""
    return "drive" if settings.needs and settings.needs <= {"wheel", "command"} else "sense"


class Degraded:
    """A source behind its degradations. The truth, the facts and the floor pass by; so does whatever else it offers.

    chain: (name, degradation), the first of them sees the source's own captures. who: what to call the source in errors."""

    def __init__(self, source: Source, chain: Sequence[tuple[str, Degradation]], who: str = "source") -> None:
        self.source, self.chain, self._who = source, chain, who
        self._previous: np.ndarray | None = None  # true pose at the capture before, where somebody knows it
        self._begun = self._arrived = False
        self._lost: list[Capture] = []  # since the last view that arrived
        self._kept_back = 0
        self.camera = source.camera
        for who, one in chain:
            self.camera = _told(one.told(self.camera), self.camera, who)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.source, name)

    @property
    def views_lost(self) -> int:
        """The source's own and those that a degradation kept back."""
        return self.source.views_lost + self._kept_back

    def lead(self) -> Capture | None:
        return self._arriving(iter(self.source.lead, None))

    def drive(self, command: Twist) -> Capture:
        def held() -> Iterator[Capture]:
            for _ in range(MOST_LOST):
                yield self.source.drive(command)

        arrived = self._arriving(held())
        if arrived is None:
            raise RhsError(f"degrade: {MOST_LOST} views in a row were lost")
        return arrived

    def teleport(self, world_from_body: np.ndarray) -> None:
        self.source.teleport(world_from_body)
        self._previous = None  # nobody drove that way

    def _arriving(self, captures: Iterator[Capture | None]) -> Capture | None:
        """The next view that arrives, with the travel and the commands since the last one; None at the end."""
        for capture in captures:
            assert capture is not None
            spoiled, arrived = self._spoiled(capture)
            if arrived:
                whole = joined_up([*self._lost, spoiled])
                self._lost, self._arrived = [], True
                return whole
            self._lost.append(spoiled)
            self._kept_back += 1
        if self._lost and not self._arrived:
            raise RhsError(f"{' and '.join(who for who, _ in self.chain)}: all {len(self._lost)} views were lost")
        return None

    def _spoiled(self, capture: Capture) -> tuple[Capture, bool]:
        """The capture as the last degradation leaves it, and whether it arrives."""
        capture = check_capture(capture, who=self._who)
        moved = self._moved(capture)
        for who, one in self.chain:
            spoiled = one.degrade(capture, moved)
            if spoiled is None:
                return capture, False
            capture = _kept(check_capture(spoiled, who=who), capture, who)
        return capture, True

    def _moved(self, capture: Capture) -> np.ndarray | None:
        """True previous_from_body; by the wheels where there is no truth."""
        truth, previous = self.source.truth(), self._previous
        truth = None if truth is None else check_pose(truth, who=self._who, field="truth()")  # a copy: it may be moved on
        self._previous, begun = truth, self._begun
        self._begun = True
        if not begun:
            return np.eye(4)
        if truth is not None and previous is not None:
            return inverse(previous) @ truth
        return None if capture.travel is None else se2(*capture.travel)


def _told(camera: Camera, before: Camera, who: str) -> Camera:
    """What a degradation says of the camera. Raises ConfigError: nothing has run yet."""
    try:
        check_camera(camera, who=who)
        if (camera.width, camera.height) != (before.width, before.height):
            raise ContractError(f"{who}: told() says {camera.width}x{camera.height} pixels; expected {before.width}x"
                                f"{before.height}, as the images are")
    except ContractError as error:
        raise ConfigError(str(error)) from error
    return camera


def _kept(spoiled: Capture, capture: Capture, who: str) -> Capture:
    """The spoiled capture, if it is still that capture. Raises ContractError where its index or stamp changed, or an image,
    depth or scan is gone or of another size: whoever comes next would be blamed."""
    for name in ("index", "stamp_s"):
        was, found = getattr(capture, name), getattr(spoiled, name)
        if found != was:
            raise ContractError(f"{who}: {name} is {found:g}; expected {was:g}, as it was given")
    for name in ("image", "depth", "scan"):
        was, found = getattr(capture, name), getattr(spoiled, name)
        if was is not None and found is None:
            raise ContractError(f"{who}: {name} is None; expected one, as it was given (a view that is lost: return None)")
        if was is not None and name != "scan" and found.shape != was.shape:
            raise ContractError(f"{who}: {name} is of shape {found.shape}; expected {was.shape}, as it was given")
    return spoiled


def joined_up(captures: Sequence[Capture]) -> Capture:
    """The last of these captures, with the travel and the mean command of all of them, and whether the bumper was pressed in
    any of them."""
    last = captures[-1]
    if len(captures) == 1:
        return last
    travels = [capture.travel for capture in captures if capture.travel is not None]
    commands = [capture.command for capture in captures if capture.command is not None]
    whole = np.eye(4)
    for travel in travels:
        whole = whole @ se2(*travel)
    duration_s = sum(command.duration_s for command in commands)
    return dataclasses.replace(
        last, travel=planar(whole) if travels else None,
        contact=None if last.contact is None else any(capture.contact for capture in captures),
        command=_mean(commands, duration_s) if duration_s > 0 else last.command)


def _mean(commands: Sequence[Twist], duration_s: float) -> Twist:
    def over(value: Callable[[Twist], float]) -> float:
        return sum(value(command) * command.duration_s for command in commands) / duration_s

    return Twist(over(lambda command: command.forward_mps), over(lambda command: command.turn_radps), duration_s)
