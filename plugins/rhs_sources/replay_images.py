"""Images of recordings: read, checked, and turned into RGB and metres."""

from __future__ import annotations

import importlib.util
import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera
from rhs.api.packed_pictures import keep_png
from rhs.api.pictures import MOST_PIXELS, check_size, head_of

NEAR_M, FAR_M = 0.3, 8.0  # nearer than Kinects see, and further than most rooms are long
SEEN_M = (0.05, 100.0)  # typical depths that cameras see
MOSAIC = 1.05  # from 1.1 on mosaics of photographs, up to 0.95 these as grey images with noise (20 grey levels) on them
DEEP_LAYERS = ("z", "depth", "v")  # Blender writes ViewLayer.Depth.Z or Depth.V
LOOKED_AT = 12  # images of depth whose scale nobody typed


SHIFTED, LEAST_VALUES = 8, 20  # SUN3D keeps depth three bits to the left; different depths of an image that tell
log = logging.getLogger("rhs.replay")


class UnreadableImage(ConfigError):
    """A file that holds no image; what else the recording holds may be whole."""


def read_color(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 RGB of an image file; a grey image becomes three equal channels."""
    import cv2

    _check_file(path, "a colour image")
    data = path.read_bytes()
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB) if data else None
    if image is None:
        raise _unreadable(path, "a colour image")
    keep_png(image, data)
    return image


def is_wide(path: Path) -> bool:
    """Whether it is a PNG of 16 bits a channel."""
    head = head_of(path)
    return head[:4] == b"\x89PNG" and head[24:25] == b"\x10"


def has_mosaic(image: np.ndarray) -> bool:
    """Whether a grey image (H, W, 3) was kept as it lay behind a Bayer filter: a pixel differs more from its neighbours,
    which are of other colours, than from the next but one, which is of its own. Of other images it is half as much."""
    plane = image[:, :, 0].astype(np.float32)
    if (image != image[:, :, :1]).any() or min(plane.shape) < 3:
        return False
    near, next_but_one = ([float(np.abs(p[step:] - p[:-step]).mean()) for p in (plane, plane.T)] for step in (1, 2))
    return min(near) > MOSAIC * max(next_but_one)


def without_mosaic(image: np.ndarray) -> np.ndarray:
    """The grey image of a mosaic, whichever pixels have which colour: 1 2 1 across and down weighs red, green and blue by 1,
    2 and 1 about every pixel."""
    import cv2

    return np.asarray(cv2.GaussianBlur(image, (3, 3), 0), np.uint8)


def read_depth(path: Path, *, scale: float, max_depth_m: float, typed: bool = False, packed: bool = False) -> np.ndarray:
    """(H, W) float32 metres, NaN unknown, of a 16-bit or float depth image (.pfm and .exr too), or an array of NumPy (.npy).
    typed: the user's scale; else one of floats is 1, they are metres. packed: four channels of 8 bits are the bytes of a
    float."""
    import cv2

    _check_file(path, "a 16-bit depth image")
    own = {".npy": _array, ".exr": _layer}.get(path.suffix.lower())
    raw = cv2.imread(str(path), cv2.IMREAD_UNCHANGED) if own is None else own(path)
    if raw is None:
        raise _unreadable(path, "a 16-bit depth image")
    if packed and raw.dtype == np.uint8 and raw.shape[2:] == (4,):
        raw = raw.view("<f4")[:, :, 0]
    scale = scale if typed or raw.dtype.kind != "f" else 1.0
    return metres(raw, scale=scale, max_depth_m=max_depth_m, where=path.name)


def _array(path: Path) -> np.ndarray | None:
    """The array of a .npy file; None where it holds none, or a larger one than is read."""
    try:
        raw = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OSError, EOFError):
        return None
    if not isinstance(raw, np.ndarray) or raw.size > MOST_PIXELS:
        return None
    return np.array(raw, np.float32 if raw.dtype.kind == "f" else raw.dtype)


def reads_exr() -> bool:
    """Whether the extra that reads OpenEXR is installed."""
    return importlib.util.find_spec("OpenEXR") is not None


def _layer(path: Path) -> np.ndarray | None:
    """The depth of an OpenEXR file: its only channel, the one that is called so, or three that are equal; None where
    there is none. OpenCV's wheels are made without OpenEXR. Raises ConfigError where the extra is not installed."""
    if not reads_exr():
        raise ConfigError(f"{path}: found OpenEXR; type pip install OpenEXR (the extra exr), or write it as .npy (metres) "
                          "or as 16-bit .png")
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            layers = {name: np.asarray(one.pixels, np.float32) for name, one in file.channels().items()}
    except Exception:  # the library raises many kinds for damaged files
        return None
    named = [name for name in layers if name.rsplit(".", 1)[-1].lower() in DEEP_LAYERS]
    found = [layers[name] for name in (named or layers)]
    alike = all(np.array_equal(found[0], other, equal_nan=True) for other in found[1:])
    return found[0] if found and alike and found[0].size <= MOST_PIXELS else None


def metres(raw: np.ndarray, *, scale: float, max_depth_m: float, where: str) -> np.ndarray:
    """(H, W) float32 metres: `raw / scale`; 0, 65535, non-finite, negative and beyond max_depth_m become NaN."""
    if raw.ndim == 3 and raw.shape[2] == 1:
        raw = raw[:, :, 0]
    if raw.ndim != 2 or raw.dtype not in (np.uint16, np.float32):
        bits, channels = raw.dtype.itemsize * 8, 1 if raw.ndim == 2 else raw.shape[2]
        raise ConfigError(
            f"depth in {where} is {bits}-bit with {channels} channel(s); expected 16-bit or float with one channel"
        )
    if raw.dtype == np.uint16:
        table = _table(float(scale), float(max_depth_m))
        return np.take(table, raw, mode="clip")  # three times sooner than table[raw]; no value is outside
    depth = raw / np.float32(scale)
    return np.where((depth > 0) & (depth <= max_depth_m), depth, np.float32(np.nan))


def check_pair(color: np.ndarray, depth: np.ndarray, where: str, hint: str = "") -> None:
    """Refuse colour and depth of different sizes; hint: what to type then."""
    if color.shape[:2] != depth.shape[:2]:
        (h, w), (dh, dw) = color.shape[:2], depth.shape[:2]
        raise ConfigError(f"{where}: colour is {w}x{h} but depth is {dw}x{dh}; expected registered images of one size{hint}")


def shrunk(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """The image in (width, height) fewer pixels, each the mean of what it covers."""
    import cv2

    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def resized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera of images that `shrunk` made: pixel (0, 0) is the middle of the first one."""
    x, y = size[0] / camera.width, size[1] / camera.height
    return replace(camera, width=size[0], height=size[1], fx=camera.fx * x, fy=camera.fy * y, skew=camera.skew * x,
                   cx=(camera.cx + 0.5) * x - 0.5, cy=(camera.cy + 0.5) * y - 0.5)


def check_depth(depth: np.ndarray, *, scale: float, where: str, typed: bool = True) -> bool:
    """Refuse depth in metres, none of it cut off, whose typical value no camera sees: the scale is wrong. False where the
    image says nothing of it, because all of it is unknown. Raises ConfigError naming the range found. typed: the user gave
    the scale; of another that makes rooms of an unusual size it is said that it was taken for granted."""
    known = depth[np.isfinite(depth)]
    if not known.size:
        return False
    low, typical, high = float(known.min()), float(np.median(known)), float(known.max())
    if not SEEN_M[0] <= typical <= SEEN_M[1]:
        raise ConfigError(
            f"{where}: typical depth is {typical:.3g} m ({low:.3g}..{high:.3g} m) with source.depth_scale={scale:g};"
            f" expected {SEEN_M[0]:g}..{SEEN_M[1]:g} m; type source.depth_scale=STEPS_PER_METRE"
        )
    if not typed:
        _hint([depth], scale=scale, where=where)
    return True


def hint_scale(files: Sequence[Path], *, scale: float, where: str) -> None:
    """Says so where depth images, some from the first to the last, make rooms of an unusual size by a scale nobody typed."""
    depths = []
    for k in np.unique(np.linspace(0, len(files) - 1, LOOKED_AT).astype(int)):
        with suppress(UnreadableImage):
            depths.append(read_depth(files[k], scale=scale, max_depth_m=np.inf))
    values = [np.rint(depth[np.isfinite(depth)] * scale).astype(int) for depth in depths]
    if all((one % SHIFTED == 0).all() for one in values) and any(len(np.unique(one)) > LEAST_VALUES for one in values):
        log.warning("%s: all of its depths are whole times %d: of SUN3D, whose bits are shifted? type source.depth_scale=%d",
                    where, SHIFTED, 1000 * SHIFTED)
        return
    _hint(depths, scale=scale, where=where)


def _hint(depths: list[np.ndarray], *, scale: float, where: str) -> None:
    seen = [known for depth in depths if len(known := depth[np.isfinite(depth)])]
    if not seen:
        return
    near, typical = min(np.percentile(known, 5) for known in seen), float(np.median([np.median(known) for known in seen]))
    if near < NEAR_M or typical > FAR_M:
        low, high = min(map(np.min, seen)), max(map(np.max, seen))
        log.warning("%s: depth is taken as %g steps a metre: typically %.2f m, from %.2f to %.2f m; if that is not so type "
                    "source.depth_scale=%d", where, scale, typical, low, high, 1000 if scale > 1000.0 else 5000)


_TABLES: dict[tuple[float, float], np.ndarray] = {}


def _table(scale: float, max_depth_m: float) -> np.ndarray:
    """(65536,) float32 metres of each 16-bit value: looking up is faster than dividing and masking."""
    if (scale, max_depth_m) not in _TABLES:
        values = (np.arange(65536) / scale).astype(np.float32)
        values[[0, 65535]] = np.nan
        values[values > max_depth_m] = np.nan
        _TABLES[(scale, max_depth_m)] = values
    return _TABLES[(scale, max_depth_m)]


def _check_file(path: Path, expected: str) -> None:
    """Refuse what is no file, or claims more pixels than are read."""
    if not path.is_file():
        raise _unreadable(path, expected)
    check_size(head_of(path), str(path))


def _unreadable(path: Path, expected: str) -> UnreadableImage:
    found = "no such file" if not path.is_file() else f"{path.stat().st_size} bytes that are no image"
    hint = "; write it as .npy (metres) or as 16-bit .png" if path.suffix.lower() in (".exr", ".npz", ".hdr") else ""
    return UnreadableImage(f"{path}: found {found}; expected {expected}{hint}")
