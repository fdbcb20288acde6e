"""A whole chain of light parts: an empty room, a noisy wheel, a straight line. And every way an odometry can go wrong."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from rhs.api.errors import check_choice, check_range

NOTHING: frozenset[str] = frozenset()
FAULTS = ("none", "raise", "exit", "os_exit", "kill", "segfault", "sleep", "spin", "none_result", "nan_pose", "shape",
          "reseed", "mutate", "leak", "interrupt", "os_exit_zero", "remove_folder", "thread", "child", "orphan", "memory",
          "kill_server", "huge_reason", "escape", "handle")


@dataclass
class FakeSource:
    """A source that can be driven about an empty room."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "driving", "command", "wheel"})
    image_width: int = 32
    """pixels across"""
    views: int = 6
    """views of the survey"""
    delay_s: float = 0.0
    """seconds it takes to come up with a view"""
    ahead: bool = False
    """whether it may be led before anybody asks"""

    def build(self, context: Any) -> Any:
        from .room import Room

        return Room(self, context)


@dataclass
class FakeImuSource(FakeSource):
    """The same with an inertial measurement unit: five readings between two views."""

    provides: ClassVar[frozenset[str]] = FakeSource.provides | {"imu"}

    def build(self, context: Any) -> Any:
        from .room import ImuRoom

        return ImuRoom(self, context)


@dataclass
class FakeSensor:
    """Passes on the wheel with a little noise."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "scan", "wheel", "command"})

    def build(self, context: Any) -> Any:
        from .room import Wheel

        return Wheel(context)


@dataclass
class FakeMono(FakeSensor):
    """Sees no depth."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"image", "command"})


@dataclass
class FakeOdometry:
    """Believes the wheel."""

    needs: ClassVar[frozenset[str]] = frozenset({"image", "depth"})
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Any:
        from .room import Counter

        return Counter()


@dataclass
class FakeEye(FakeOdometry):
    """Does without depth."""

    needs: ClassVar[frozenset[str]] = frozenset({"image"})
    provides: ClassVar[frozenset[str]] = frozenset({"scan"})


@dataclass
class FakeInertial(FakeOdometry):
    """Turns as the gyroscope says."""

    needs: ClassVar[frozenset[str]] = frozenset({"imu"})

    def build(self, context: Any) -> Any:
        from .room import Inertial

        return Inertial()


@dataclass
class FakeSlam:
    """Counts wheels, and knows the room: a map, a trajectory and a belief in one part."""

    needs: ClassVar[frozenset[str]] = frozenset({"wheel"})
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Any:
        from .slam import WheelSlam

        return WheelSlam(context)


@dataclass
class FakeBlind(FakeOdometry):
    """Needs nothing and offers nothing."""

    needs: ClassVar[frozenset[str]] = NOTHING


@dataclass
class Faulty(FakeOdometry):
    """Goes wrong in the way one asks for."""

    how: str = "none"
    """what happens"""
    at: int = 3
    """at which view"""
    seed: int = -1
    """only in the run with this seed; -1: always"""
    flag: str = ""
    """a file; while it exists, nothing goes wrong"""

    def __post_init__(self) -> None:
        check_choice("odometry.faulty", "how", self.how, FAULTS)

    def build(self, context: Any) -> Any:
        from .room import Counter

        return Trouble(self, Counter(), context)


MARK = "86399.25"  # seconds that the processes sleep which a part leaves behind; no other program does


class Trouble:
    """An odometry that counts views and strikes at one of them."""

    def __init__(self, settings: Faulty, inner: Any, context: Any) -> None:
        self.settings, self.inner, self.context = settings, inner, context
        self.count, self.kept = 0, []

    def revise(self) -> None:
        return None

    def update(self, observation: Any) -> Any:
        self.count += 1
        motion = self.inner.update(observation)
        if self.count < self.settings.at or (self.settings.flag and os.path.exists(self.settings.flag)):
            return motion
        return getattr(self, self.settings.how)(observation, motion)

    def none(self, observation: Any, motion: Any) -> Any:
        return motion

    def reseed(self, observation: Any, motion: Any) -> Any:
        import random

        import numpy as np

        np.random.seed(0)  # noqa: NPY002
        random.seed(0)
        return motion

    def leak(self, observation: Any, motion: Any) -> Any:
        self.kept.append(open(os.devnull))
        return motion

    def handle(self, observation: Any, motion: Any) -> Any:
        """Holds something by a number that only this process knows; to be pickled it looks fit."""
        self.kept = self.kept or [os.getpid()]
        if self.kept != [os.getpid()]:
            raise RuntimeError("no such handle")
        return motion

    def mutate(self, observation: Any, motion: Any) -> Any:
        observation.wheel[0] += 100.0
        return motion

    def interrupt(self, observation: Any, motion: Any) -> Any:
        os.kill(os.getpid(), signal.SIGINT)
        return motion

    def none_result(self, observation: Any, motion: Any) -> Any:
        return None

    def nan_pose(self, observation: Any, motion: Any) -> Any:
        from dataclasses import replace

        return replace(motion, previous_from_body=motion.previous_from_body * float("nan"))

    def shape(self, observation: Any, motion: Any) -> Any:
        from dataclasses import replace

        return replace(motion, covariance=motion.covariance[:3, :3])

    def exit(self, observation: Any, motion: Any) -> Any:
        sys.exit(3)

    def os_exit(self, observation: Any, motion: Any) -> Any:
        os._exit(3)

    def kill(self, observation: Any, motion: Any) -> Any:
        os.kill(os.getpid(), signal.SIGKILL)

    def segfault(self, observation: Any, motion: Any) -> Any:
        os.kill(os.getpid(), signal.SIGSEGV)

    def sleep(self, observation: Any, motion: Any) -> Any:
        time.sleep(3600)

    def spin(self, observation: Any, motion: Any) -> Any:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        time.sleep(3600)


    def os_exit_zero(self, observation: Any, motion: Any) -> Any:
        os._exit(0)

    def remove_folder(self, observation: Any, motion: Any) -> Any:
        import shutil

        shutil.rmtree(self.context.folder)
        return motion

    def thread(self, observation: Any, motion: Any) -> Any:
        import threading

        threading.Thread(target=time.sleep, args=(3600,), daemon=False).start()
        return motion

    def child(self, observation: Any, motion: Any) -> Any:
        import subprocess

        subprocess.Popen(["sleep", MARK])
        return motion

    def orphan(self, observation: Any, motion: Any) -> Any:
        import subprocess

        subprocess.Popen(["sh", "-c", f"setsid sleep {MARK} & exit"], start_new_session=True)
        return motion

    def memory(self, observation: Any, motion: Any) -> Any:
        while True:
            self.kept.append(bytearray(os.urandom(1 << 20)) * 50)
            time.sleep(0.05)

    def kill_server(self, observation: Any, motion: Any) -> Any:
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(3600)

    def huge_reason(self, observation: Any, motion: Any) -> Any:
        from dataclasses import replace

        return replace(motion, reason="x" * 131_073)

    def escape(self, observation: Any, motion: Any) -> Any:
        raise ValueError("\x1b]0;owned\x07\x1b[31m red")


def _raise(self: Trouble, observation: Any, motion: Any) -> Any:
    raise ValueError("the odometry of this test\nfails on purpose")


setattr(Trouble, "raise", _raise)


@dataclass
class FakeCloser:
    """Leaves the survey as it is."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Any:
        from .room import Closer

        return Closer()


@dataclass
class FakeMapper:
    """Draws the room as empty."""

    needs: ClassVar[frozenset[str]] = frozenset({"scan"})
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Any:
        from .room import Empty

        return Empty()


@dataclass
class FakePlanner:
    """Goes straight, or not at all. Its settings are of every type."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING
    samples: int = 100
    """points drawn"""
    step_m: float = 0.5
    """longest edge, metres"""
    mode: str = "fast"
    """a word"""
    smooth: bool = True
    """a switch"""
    weights: list[float] = field(default_factory=lambda: [1.0, 2.0])
    """numbers of several kinds"""
    limit: float | None = None
    """a number or none"""
    norm: Literal["l1", "l2"] = "l2"
    """one of two words"""

    def __post_init__(self) -> None:
        check_range("planner.fake", "samples", self.samples, low=1, high=1_000_000)
        check_range("planner.fake", "step_m", self.step_m, low=0.01, high=10.0, unit="m")

    def build(self, context: Any) -> Any:
        from .room import Straight

        return Straight(self, context)


@dataclass
class Newer(FakePlanner):
    """Written for a program that is still to come."""

    api: ClassVar[int] = 99


@dataclass
class Wanting(FakePlanner):
    """Needs a library that is not installed."""

    requires: ClassVar[tuple[str, ...]] = ("some_planning_library",)


@dataclass
class FakeLocaliser:
    """Believes the odometry."""

    needs: ClassVar[frozenset[str]] = NOTHING
    provides: ClassVar[frozenset[str]] = NOTHING

    def build(self, context: Any) -> Any:
        from .room import Believer

        return Believer()


@dataclass
class Vandal(FakeLocaliser):
    """Writes into everything it is given."""

    def build(self, context: Any) -> Any:
        from .room import Scribbler

        return Scribbler()


@dataclass
class Leaver(FakeLocaliser):
    """Ends the process at its third view."""

    def build(self, context: Any) -> Any:
        from .room import Quitter

        return Quitter()


not_a_class = 7
