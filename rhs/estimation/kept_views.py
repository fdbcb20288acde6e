"""The views of a survey, kept in a file: a drive of any length takes the memory of a short one.

A view is some 5 kB, with its key-points 200 kB at 640x480, and nobody looks at it before the drive is over; then all are
looked at one after the other, a dozen times, and each is made anew from the file, the same to the bit. The first of them, a
short survey's all, are kept without their key-points once they have been made.
"""

from __future__ import annotations

import pickle
import tempfile
import weakref
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, overload

from rhs.api.files import free_space
from rhs.api.frozen import freeze
from rhs.api.geometry import Camera
from rhs.api.records import Features, View
from rhs.base.errors import RhsError
from rhs.base.system import read_at, write_at

HELD = 500  # views, some 10 kB each


class LazyViews(Sequence[View]):
    """Views that are made where they are looked at: `view(k)` gives the k-th."""

    def view(self, k: int) -> View:
        raise NotImplementedError

    @overload
    def __getitem__(self, k: int) -> View: ...
    @overload
    def __getitem__(self, k: slice) -> list[View]: ...
    def __getitem__(self, k: int | slice) -> View | list[View]:
        rows = range(len(self))[k]
        return self.view(rows) if isinstance(rows, int) else [self.view(row) for row in rows]


@dataclass(frozen=True, eq=False)
class ChangedViews(LazyViews):
    """Views as `changed(k, view)` makes them of others."""

    views: Sequence[View]
    changed: Callable[[int, View], View]

    def __len__(self) -> int:
        return len(self.views)

    def view(self, k: int) -> View:
        return self.changed(k, self.views[k])


class KeptViews(LazyViews):
    """Views in the order they were taken. folder: where their file lies, which has no name and goes with the process.

    It is read at given places, never from where somebody left off, so that forked processes may share it."""

    def __init__(self, folder: Path | None = None) -> None:
        self._open(folder)
        self._begins, self._sizes = array("q"), array("q")  # of each view in the file
        self._end = 0
        self._cameras: list[Camera] = []
        self._camera_of = array("l")
        self._features: dict[int, tuple[int, int]] = {}  # row -> where they begin, and their size
        self._free: list[tuple[int, int]] = []  # of key-points that were given up
        self._in_memory: dict[int, View] = {}  # of parts whose records cannot be written, and those made before

    def _open(self, folder: Path | None) -> None:
        self._folder = Path(folder or tempfile.gettempdir())
        self._file = tempfile.TemporaryFile(dir=folder, buffering=0)  # closed when nobody holds the views any more
        weakref.finalize(self, self._file.close)

    def __getstate__(self) -> dict[str, Any]:
        """For pickle: with what is in the file. Raises PicklingError where that is too much to be read at once."""
        content = read_at(self._file.fileno(), self._end, 0)
        if len(content) != self._end:
            raise pickle.PicklingError(f"{1e-6 * self._end:.0f} MB of views are too many to be kept")
        state = {name: value for name, value in vars(self).items() if name not in ("_folder", "_file")}
        hidden = {k: view for k, view in self._in_memory.items() if not self._sizes[k]}
        return state | {"_in_memory": hidden, "content": content}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """In a file of its own, where temporary files are."""
        content = state.pop("content")
        vars(self).update(state)
        self._open(None)
        self._put(content, 0)

    def __len__(self) -> int:
        return len(self._begins)

    def append(self, view: View) -> None:
        """Keep a view, without its key-points."""
        try:
            data = pickle.dumps(replace(view, camera=None, features=None), pickle.HIGHEST_PROTOCOL)  # type: ignore[arg-type]
        except (pickle.PicklingError, AttributeError, TypeError):
            self._in_memory[len(self)], data = view, b""
        if not self._cameras or view.camera is not self._cameras[-1]:
            self._cameras.append(view.camera)
        self._camera_of.append(len(self._cameras) - 1)
        self._begins.append(self._put(data, self._end))
        self._sizes.append(len(data))

    def keep_features(self, k: int, features: Features) -> None:
        """Keep the key-points of a view."""
        data = pickle.dumps(features, pickle.HIGHEST_PROTOCOL)
        fits = next((place for place in self._free if place[1] >= len(data)), None)
        if fits is not None:
            self._free.remove(fits)
        self._features[k] = self._put(data, self._end if fits is None else fits[0]), len(data)

    def forget_features(self, k: int) -> None:
        """Give up the key-points of a view."""
        self._free.append(self._features.pop(k))

    def view(self, k: int) -> View:
        view: View = self._in_memory.get(k) or freeze(self._get(self._begins[k], self._sizes[k]))
        if k < HELD:
            self._in_memory[k] = view
        features = None
        if k in self._features:
            features = self._get(*self._features[k])
            freeze(vars(features))  # as they are held, nothing is unpacked
        return replace(view, camera=self._cameras[self._camera_of[k]], features=features)

    def _put(self, data: bytes, at: int) -> int:
        try:
            write_at(self._file.fileno(), data, at)
        except OSError as error:
            raise RhsError(f"cannot keep the views in a file in {self._folder}: {error.strerror or error} "
                           f"({free_space(self._folder / 'views')})") from error
        self._end = max(self._end, at + len(data))
        return at

    def _get(self, at: int, size: int) -> Any:
        return pickle.loads(read_at(self._file.fileno(), size, at))  # noqa: S301 (nobody else can write to this file)
