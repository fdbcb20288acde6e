"""video.webm: what the camera saw beside the map as it came to be, one picture per step. Plays in browsers (VP8)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.files import write_whole
from rhs.api.grid import OccupancyGrid
from rhs.base.errors import RhsError
from rhs.recording.reader import RecordedView, read
from rhs.runfolder.run import Run

from .drawing import COLOURS

HEIGHT_PX = 360
FRAMES_PER_S = 10.0


def video(folder: Path) -> Path:
    """Make video.webm of a run folder from its run.mcap. Raises RhsError when it cannot be made."""
    if not (folder / "run.mcap").exists():
        raise RhsError(f"{folder} has no run.mcap; run with recording=full to make a video")
    return write_whole(folder / "video.webm", lambda path: _film(folder, path))


def _film(folder: Path, path: Path) -> None:
    import cv2

    board = Board(folder)
    writer, count = None, 0
    for view in read(folder / "run.mcap").views():
        frame = board.frame(view)
        if writer is None:
            size = frame.shape[1], frame.shape[0]
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"VP80"), FRAMES_PER_S, size)
            if not writer.isOpened():
                raise RhsError("this OpenCV cannot write VP8 video; install opencv-python-headless from PyPI")
        writer.write(frame)
        count += 1
    if writer is None:
        raise RhsError(f"{folder / 'run.mcap'} holds no complete view; nothing to film")
    writer.release()
    found = count_frames(path)
    if found != count:
        raise RhsError(f"{path} holds {found} of {count} frames; the disk may be full")


def count_frames(path: Path) -> int:
    """Frames that can really be read from a video."""
    import cv2

    capture, count = cv2.VideoCapture(str(path)), 0
    while capture.grab():
        count += 1
    capture.release()
    return count


class Board:
    """The map at the left, drawn on step by step, and the camera's picture at the right. Images are BGR."""

    def __init__(self, folder: Path):
        run = Run(folder)
        self._final, true = run.grid("map"), run.grid("true_map")
        frame = self._final or true or OccupancyGrid(np.full((200, 200), np.nan, np.float32), 0.1, (-10.0, -10.0))
        self._frame, self._true = frame, true
        self._scale = HEIGHT_PX / max(frame.shape)
        self._canvas = self._blank(None)
        self._phase = "survey"
        self._last: dict[str, tuple[int, int]] = {}
        self._places = (run.json("facts") or {}).get("places", ())

    def frame(self, view: RecordedView) -> np.ndarray:
        """(HEIGHT_PX, even width, 3) uint8."""
        import cv2

        if view.phase != self._phase:  # the survey is over: its finished map takes the place of the sketch
            self._phase, self._last, self._canvas = view.phase, {}, self._blank(self._final)
        pose = np.array(view.plain["map_from_body"]) if view.plain.get("map_from_body") else view.truth
        if pose is not None:
            self._draw(view, pose)
        picture = self._canvas.copy()
        if pose is not None:
            self._robot(picture, pose)
        words = f"{view.phase}  {view.plain.get('event', '')}"
        cv2.rectangle(picture, (0, HEIGHT_PX - 18), (9 * len(words.strip()), HEIGHT_PX), (255, 255, 255), -1)
        cv2.putText(picture, words, (4, HEIGHT_PX - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
        return np.hstack([picture, self._camera(view)]) if view.capture.image is not None else picture

    def _blank(self, grid: OccupancyGrid | None) -> np.ndarray:
        import cv2

        rows, columns = self._frame.shape
        shade = np.full((rows, columns, 3), (236, 226, 220), np.uint8)
        if grid is not None:
            shade[grid.free()] = 255
            shade[grid.occupied()] = 0
        if self._true is not None and self._true.shape == self._frame.shape:
            walls = self._true.occupied() & (shade.min(axis=2) > 0)
            shade[walls] = (224, 184, 122)
        size = _even(columns * self._scale), HEIGHT_PX
        return cv2.resize(shade[::-1], size, interpolation=cv2.INTER_NEAREST)

    def _pixel(self, xy_m: np.ndarray) -> tuple[int, int]:
        x, y = (np.asarray(xy_m[:2]) - self._frame.origin_m) / self._frame.resolution_m * self._scale
        return round(float(x)), round(HEIGHT_PX - float(y))

    def _draw(self, view: RecordedView, pose: np.ndarray) -> None:
        import cv2

        if view.phase == "survey" and view.capture.scan is not None:
            for x, y in _hits(view.capture.scan, pose):
                cv2.circle(self._canvas, self._pixel(np.array([x, y])), 1, (60, 60, 60), -1)
        for place in self._places:
            cv2.circle(self._canvas, self._pixel(np.array([place["x_m"], place["y_m"]])), 5, _bgr("place"), 2, cv2.LINE_AA)
        for name, at in (("truth", view.truth), ("estimate" if view.phase == "survey" else "patrol", pose)):
            if at is not None:
                now = self._pixel(at[:2, 3])
                cv2.line(self._canvas, self._last.get(name, now), now, _bgr(name), 2, cv2.LINE_AA)
                self._last[name] = now

    def _robot(self, picture: np.ndarray, pose: np.ndarray) -> None:
        import cv2

        corners = np.array([[0.45, 0.0], [-0.25, 0.25], [-0.25, -0.25]]) @ pose[:2, :2].T + pose[:2, 3]
        cv2.fillPoly(picture, [np.array([self._pixel(c) for c in corners], np.int32)], _bgr("corrected"), cv2.LINE_AA)

    def _camera(self, view: RecordedView) -> np.ndarray:
        import cv2

        image: Any = view.capture.image
        width = _even(image.shape[1] * HEIGHT_PX / image.shape[0])
        return cv2.resize(image[:, :, ::-1], (width, HEIGHT_PX), interpolation=cv2.INTER_LINEAR)


def _hits(scan, pose: np.ndarray) -> np.ndarray:
    """(N, 2) metres in the map where beams ended."""
    seen = np.isfinite(scan.ranges_m)
    bearing, reach = scan.bearings_rad[seen], scan.ranges_m[seen]
    body = np.stack([scan.origin_xy_m[0] + reach * np.cos(bearing), scan.origin_xy_m[1] + reach * np.sin(bearing)], axis=1)
    return body @ pose[:2, :2].T + pose[:2, 3]


def _bgr(name: str) -> tuple[int, int, int]:
    word = COLOURS[name].lstrip("#")
    return int(word[4:6], 16), int(word[2:4], 16), int(word[0:2], 16)


def _even(value: float) -> int:
    return max(2, 2 * round(value / 2))
