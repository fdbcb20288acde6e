"""Maps on disk: the ROS `map_server` pair (YAML and image), and MovingAI's `.map` and `.scen`.

Semantics of the YAML follow nav2's map_server (nav2_map_server, `map_io`): brightness 0..1 is the mean of the colour
channels, occupancy is 1 - brightness (brightness itself when `negate`), and
trinary: above occupied_thresh occupied, below free_thresh free, anything else unknown;
scale: the same ends, a linear ramp between them, transparent pixels unknown;
raw: pixel values 0..100 are percent, above 100 unknown; negate is ignored.
One key is ours, which map_server leaves alone: `marks_m`, the size below which a mark that touches no wall is writing.
White is what a PGM says it is; an alpha channel that is opaque everywhere says nothing and is left out.
The first row of the image is the highest y. Strict inequalities matter: unknown is written as grey 205, whose
occupancy 50/255 = 0.19608 is just above the written free_thresh of 0.196. Nav2's map_saver writes free_thresh: 0.25 beside
the same greys, by which its own map_server reads the unknown as free; here it stays unknown in such a map, and that is said.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from rhs.api.files import replacing
from rhs.api.grid import OccupancyGrid
from rhs.api.pictures import declared_size, head_of
from rhs.base.commands import check_whole
from rhs.base.errors import ConfigError
from rhs.base.strict_yaml import load_yaml

log = logging.getLogger("rhs.worlds")
FREE_GREY, UNKNOWN_GREY, OCCUPIED_GREY = 254, 205, 0
MOST_CELLS = 25_000_000  # 250 m x 250 m at 5 cm; the head of a small file could ask for all the memory there is
UNKNOWN_AS_SAVED = (255 - UNKNOWN_GREY) / 255  # occupancy of that grey; nav2's map_saver writes free_thresh: 0.25 to it
MOST_YAW_RAD = 2.0 * np.pi + 0.01
READ = "PGM, PNG, BMP, JPEG, WebP, TIFF or GIF"
SHADED = 0.2  # share of a picture in greys between wall and floor from which it is taken for a photograph
COLOURED, ROOMS = 0.06, 0.03  # by which the channels of a colour differ; share of a picture that is no writing
THICK = 0.04  # of a picture's shorter side; walls are thinner
UNKNOWN_GREYS = (127, 128, UNKNOWN_GREY)  # of hector_mapping, Cartographer and map_saver
MOST_ROOMS = 90.0  # per cent of it that are called free
_LOOKED_AT = 1_000_000  # pixels of a picture from which is told what is wrong with it
_BAND_CELLS = 1_000_000  # of a map that are turned at a time
_MAXVAL = re.compile(rb"P([2356])(?:(?:\s|#[^\n]*\n)+\d{1,9}){2}(?:\s|#[^\n]*\n)+(\d{1,5})\s")
_FLAGS = {"true": 1, "yes": 1, "on": 1, "false": 0, "no": 0, "off": 0}  # as map_server reads `negate: no`


@dataclass(frozen=True)
class MapHeader:
    """The keys of a map_server YAML. origin: (x m, y m, yaw rad) of the lower left corner of the image. marks_m: what is not
    free, smaller than this and apart from all else is writing or a symbol, and free; 0: nothing is."""

    image: FilePath
    resolution_m: float
    origin: tuple[float, float, float]
    negate: bool
    mode: str
    occupied_thresh: float
    free_thresh: float
    marks_m: float = 0.0


def load_map(yaml_path: str | FilePath, *, origin: tuple[float, float, float] | None = None,
             turned: bool = True) -> OccupancyGrid:
    """Read a map_server YAML and its image. Cells: 0 free, 1 occupied, NaN unknown, between them in scale and raw mode.

    A map with a yaw is turned into axis-parallel cells, each as bad as the worst pixel that it touches: occupied before
    unknown before free; cells that reach beyond the image are unknown. origin: for a file that gives none, as (x, y, yaw).
    turned: if not, cells are the image's and the yaw is left to whoever asked. Raises ConfigError, in one line, for anything
    missing or out of range.
    """
    return map_of(read_header(yaml_path, origin=origin), turned=turned)


def map_of(header: MapHeader, *, turned: bool = True) -> OccupancyGrid:
    """The map that a header describes, as `load_map` reads it."""
    probability = np.flipud(_occupancy(_read_image(header.image), header))
    if header.marks_m > 0.0:
        probability[small_marks(probability, header.marks_m / header.resolution_m) > 0] = 0.0
    x, y, yaw = header.origin
    if not turned or (abs(np.sin(yaw)) < 1e-12 and np.cos(yaw) > 0):
        return OccupancyGrid(np.ascontiguousarray(probability, np.float32), header.resolution_m, (x, y))
    return _turned(probability, header)


def save_map(stem_path: str | FilePath, grid: OccupancyGrid) -> tuple[FilePath, FilePath]:
    """Write `stem.yaml` and `stem.pgm` (trinary) and return both paths; files appear only when complete.

    A cell is written free below 0.25, occupied from 0.65 on (OccupancyGrid's calls), else unknown; reading the file
    back gives exactly these three classes.
    """
    stem = FilePath(stem_path)
    for name, content in map_files(stem.name, grid).items():
        with replacing(stem.with_name(name), "wb") as file:
            file.write(content)
    return stem.with_name(stem.name + ".yaml"), stem.with_name(stem.name + ".pgm")


def map_files(stem: str, grid: OccupancyGrid) -> dict[str, bytes]:
    """Names and contents of the two files that `save_map` writes."""
    grey = np.full(grid.shape, UNKNOWN_GREY, np.uint8)
    grey[grid.free()] = FREE_GREY
    grey[grid.occupied()] = OCCUPIED_GREY
    rows, columns = grey.shape
    text = (
        f"image: {stem}.pgm\nmode: trinary\nresolution: {float(grid.resolution_m)!r}\n"
        f"origin: [{float(grid.origin_m[0])!r}, {float(grid.origin_m[1])!r}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return {f"{stem}.pgm": b"P5\n%d %d\n255\n" % (columns, rows) + np.flipud(grey).tobytes(), f"{stem}.yaml": text.encode()}


def read_header(yaml_path: str | FilePath, *, origin: tuple[float, float, float] | None = None) -> MapHeader:
    """The checked keys of a map_server YAML; unknown keys are left alone, as map_server does. origin: where it has none."""
    path = FilePath(yaml_path)
    keys = ({} if origin is None else {"origin": list(origin)}) | read_yaml(path)
    missing = [k for k in ("image", "resolution", "origin") if k not in keys]
    if missing:
        raise ConfigError(f"{path}: map_server key {missing[0]!r} is missing; expected image, resolution, origin")
    corner = keys["origin"]
    if not isinstance(corner, list) or len(corner) not in (2, 3) or not all(_is_number(v) for v in corner):
        raise ConfigError(f"{path}: origin is {corner!r}; expected [x m, y m, yaw rad]")
    mode = keys.get("mode", "trinary")
    if mode not in ("trinary", "scale", "raw"):
        raise ConfigError(f"{path}: mode is {mode!r}; expected trinary, scale or raw")
    occupied = _number(path, keys, "occupied_thresh", 0.65, low=0.0, high=1.0)
    free = _number(path, keys, "free_thresh", 0.196, low=0.0, high=1.0)
    if free > occupied:
        raise ConfigError(f"{path}: free_thresh {free} is above occupied_thresh {occupied}; expected it below")
    x, y, yaw = (*map(float, corner), 0.0)[:3]
    if abs(yaw) > MOST_YAW_RAD:
        raise ConfigError(f"{path}: origin has a yaw of {yaw:g}; expected radians: {np.radians(yaw):.6g} if these are "
                          "degrees")
    return MapHeader(
        image=_image_of(path, str(keys["image"])),
        resolution_m=_number(path, keys, "resolution", 0.0, low=1e-6, high=1e6),
        origin=(x, y, yaw),
        negate=bool(_number(path, keys, "negate", 0, low=0, high=1)),
        mode=mode,
        occupied_thresh=occupied,
        free_thresh=free,
        marks_m=_number(path, keys, "marks_m", 0.0, low=0.0, high=100.0),
    )


def small_marks(probability: np.ndarray, most: float) -> np.ndarray:
    """(H, W) int: from 1 on for the cells of each patch that is not free, apart from all others and less than `most` cells
    wide and high; 0 elsewhere."""
    import cv2

    taken = ~(probability < 0.5)  # unknown too
    _, labels, boxes, _ = cv2.connectedComponentsWithStats(taken.astype(np.uint8), connectivity=8)
    small = (boxes[:, cv2.CC_STAT_WIDTH] < most) & (boxes[:, cv2.CC_STAT_HEIGHT] < most)
    small[0] = False  # the free cells
    return np.where(small[labels], labels, 0)


def writing_in(grid: OccupancyGrid, most_m: float = 1.0) -> int:
    """How many such marks, up to a letter's size on a plan, that hold a wall's cell."""
    marks = small_marks(grid.probability, most_m / grid.resolution_m)
    return len(np.unique(marks[(marks > 0) & grid.occupied()]))


def read_yaml(path: FilePath) -> dict[Any, Any]:
    """A YAML file as a dictionary, or a ConfigError with file and line; duplicate keys are refused."""
    keys = load_yaml(path)
    if not isinstance(keys, dict):
        raise ConfigError(f"{path}: expected keys and values, found {'nothing' if keys is None else type(keys).__name__}")
    return keys


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _image_of(path: FilePath, name: str) -> FilePath:
    """The image that a map names; where it is not there (map_saver writes paths of its own machine), the one of that name
    beside the map, and that is said."""
    image = path.parent / name
    beside = path.parent / name.replace("\\", "/").split("/")[-1]
    if image.is_file() or not beside.is_file():
        return image
    log.warning("%s: there is no %s; taken is %s beside it", path.name, name, beside.name)
    return beside


def _number(path: FilePath, keys: dict[Any, Any], name: str, default: float, *, low: float, high: float) -> float:
    value: Any = keys.get(name, default)
    value = _FLAGS.get(str(value).lower(), value) if name == "negate" else value
    if not _is_number(value) or not low <= value <= high:
        raise ConfigError(f"{path}: {name} is {value!r}; expected a number in [{low:g}, {high:g}]")
    return float(value)


def _read_image(path: FilePath, most: int = MOST_CELLS) -> np.ndarray:
    """(H, W, C) float brightness 0..1; the last channel of 2 or 4 is opacity. Reads what READ names. most: pixels; of
    a larger image every second, third, ... row and column."""
    import cv2

    if not path.is_file():
        raise ConfigError(f"map image {path} does not exist; correct the key `image` of its YAML")
    check_whole(path)
    size = declared_size(head_of(path))
    if size is None:
        raise ConfigError(f"{path} is not an image that can be read; expected {READ}")
    if size[0] * size[1] > MOST_CELLS:
        times = int(np.ceil(np.sqrt(size[0] * size[1] / MOST_CELLS)))
        smaller = f"scale it down {times} times ({size[0] // times} x {size[1] // times})"
        raise ConfigError(f"{path}: {size[0]} x {size[1]} cells are more than the {MOST_CELLS} allowed; {smaller} and write "
                          f"a resolution {times} times as large")
    log = cv2.utils.logging
    before = log.setLogLevel(log.LOG_LEVEL_SILENT)  # the error below says it better
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    log.setLogLevel(before)
    if image is None:
        raise ConfigError(f"{path} is not an image that can be read; expected {READ}")
    if image.dtype.kind != "u":
        raise ConfigError(f"{path}: its pixels are {image.dtype.name}, as heights are; expected grey or colour of "
                          "8 or 16 bits")
    step = int(np.ceil(np.sqrt(size[0] * size[1] / most)))
    image = (image[:, :, None] if image.ndim == 2 else image)[::step, ::step]
    if image.shape[2] in (2, 4) and (image[:, :, -1] == np.iinfo(np.dtype(image.dtype.name)).max).all():
        image = image[:, :, :-1]  # an editor's, which says nothing, and by which grey 205 would be free
    shade: np.ndarray = np.minimum(image / _white(path, image.dtype), 1.0)
    return shade


def _white(path: FilePath, kind: np.dtype) -> float:
    """The value of white: what a binary PGM or PPM says (of text OpenCV has stretched 8 bits), else the largest there is."""
    largest = float(np.iinfo(np.dtype(kind.name)).max)
    said = _MAXVAL.match(head_of(path))
    return largest if said is None or (said[1] in b"23" and largest == 255.0) else float(said[2])


def _occupancy(image: np.ndarray, header: MapHeader) -> np.ndarray:
    """(H, W) probability from (H, W, C) brightness, rows still in image order."""
    has_alpha = image.shape[2] in (2, 4)
    colours = image[:, :, :-1] if has_alpha else image
    if header.mode == "trinary" and has_alpha:
        shade = image.mean(axis=2)  # opacity counts as one more channel there: transparent is darker
    else:
        shade = colours.mean(axis=2)
    if header.mode == "raw":
        percent = np.round(shade * 255.0)
        return np.where(percent <= 100.0, percent / 100.0, np.nan)
    if header.mode == "trinary" and _is_raw(image):
        log.warning("%s: its greys are 0 to 100 and 255, as of a map that was saved in mode raw, in which 100 is a wall and "
                    "0 is free: if it is one write mode: raw", header.image.name)
    occupancy = shade if header.negate else 1.0 - shade
    low, high = header.free_thresh, header.occupied_thresh
    out = np.full(shape=occupancy.shape, fill_value=np.nan)
    if header.mode == "scale":
        out = np.rint(100.0 * (occupancy - low) / max(high - low, 1e-12)) / 100.0
    out[occupancy > high] = 1.0
    out[occupancy < low] = 0.0
    if low > UNKNOWN_AS_SAVED and header.mode == "trinary" and not header.negate and _is_saved(image):
        out[np.rint(255.0 * shade) == UNKNOWN_GREY] = np.nan
        log.warning("%s: its grey %d is taken for unknown, as map_saver writes it; by free_thresh: %g it would be free "
                    "(write free_thresh: 0.196)", header.image.name, UNKNOWN_GREY, low)
    if header.mode == "scale" and has_alpha:
        out[image[:, :, -1] < 1.0] = np.nan
    return out


def _is_raw(image: np.ndarray) -> bool:
    """Whether grey brightness (H, W, C) is of percents, 100 among them, and 255 for unknown, as a map saved in mode raw."""
    levels = set(np.unique(np.rint(255.0 * image)).astype(int).tolist())
    return image.shape[2] == 1 and {0, 100, 255} <= levels <= {*range(101), 255}


def _is_saved(image: np.ndarray) -> bool:
    """Whether brightness (H, W, C) is of the three greys of a map that was saved, and of no others."""
    levels = np.unique(np.rint(255.0 * image))
    return {UNKNOWN_GREY, FREE_GREY} <= set(levels) <= {OCCUPIED_GREY, UNKNOWN_GREY, FREE_GREY}


def advice_on(yaml_path: str | FilePath) -> str:
    """What may be wrong with a picture that has no floor to speak of; empty where nothing is seen."""
    header = read_header(yaml_path, origin=(0.0, 0.0, 0.0))
    image = _read_image(header.image, most=_LOOKED_AT)
    if header.mode == "raw":
        return "in mode raw 0 is free and 100 a wall; write mode: trinary for black walls on white"
    if image.shape[2] in (2, 4) and (image[:, :, -1] < 1.0).mean() > 0.2:
        return "much of the picture is transparent, which is unknown; save it on a white ground"
    shade = image[:, :, : 3 if image.shape[2] >= 3 else 1].mean(axis=2)
    levels = np.bincount(np.rint(100.0 * (1.0 - shade if header.negate else shade)).astype(int).ravel(), minlength=101)
    floor = int(np.argmax(levels))
    if floor == 50 and header.mode == "trinary":
        return ("most of it is half grey, which Cartographer writes for unknown; where its floor is of many shades write "
                "mode: scale")
    if floor < 35:
        return f"most of the picture is dark; for a dark floor write negate: {int(not header.negate)}"
    if floor <= 100.0 * (1.0 - header.free_thresh):
        return (f"most of it is {floor} % bright and free is above {100.0 * (1.0 - header.free_thresh):.0f} %; if that is "
                f"floor write free_thresh: {1.02 - 0.01 * floor:.2f}")
    return ""


def odd_shades(yaml_path: str | FilePath) -> str:
    """What to say of a picture much of which is neither wall nor floor: of colours, which no map has, or of one grey that
    does not lie round it, as the rooms of some plans; or of many greys, as a photograph (one that stands for unknown does
    not count). Empty of others."""
    import cv2

    header = read_header(yaml_path, origin=(0.0, 0.0, 0.0))
    image = _read_image(header.image, most=_LOOKED_AT)
    if header.mode != "trinary" or image.shape[2] == 2:
        return ""
    shade = image[:, :, :3].mean(axis=2)
    occupancy = shade if header.negate else 1.0 - shade
    neither = (occupancy <= header.occupied_thresh) & (occupancy >= header.free_thresh)
    filled = neither & (np.ptp(image[:, :, :3], axis=2) > COLOURED)
    levels = np.bincount(np.rint(255.0 * shade[neither]).astype(int), minlength=256)
    grey = int(np.argmax(levels))
    edge = np.concatenate([shade[0], shade[-1], shade[:, 0], shade[:, -1]])
    if grey not in UNKNOWN_GREYS and (np.rint(255.0 * edge) == grey).mean() < 0.5:
        filled |= neither & (np.rint(255.0 * shade) == grey)
    thick = max(3, round(THICK * min(shade.shape)))
    if filled.mean() > ROOMS and cv2.erode(filled.astype(np.uint8), np.ones((thick, thick), np.uint8)).any():
        most = min(0.02 + float(np.percentile(occupancy[filled], MOST_ROOMS)), header.occupied_thresh)
        return (f"{100.0 * filled.mean():.0f} % of it is of a colour that is neither wall nor floor, and is left out: "
                f"coloured rooms? write free_thresh: {most:.2f}")
    if levels.sum() - levels[max(0, grey - 8):grey + 9].sum() > SHADED * shade.size:
        return ("much of it is of many greys, neither wall nor floor: a photograph? straighten it, and draw its walls black "
                "on white")
    return ""


def _turned(probability: np.ndarray, header: MapHeader) -> OccupancyGrid:
    """The map seen along the axes: every new cell takes the worst of the pixels whose inside it meets, so that nothing
    comes nearer to a wall by turning the map."""
    x, y, yaw = header.origin
    step, (rows, columns) = header.resolution_m, probability.shape
    c, s = np.cos(yaw), np.sin(yaw)
    corners = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]]) * step @ np.array([[c, s], [-s, c]])
    low, high = corners.min(0), corners.max(0)
    width, height = np.maximum(np.ceil((high - low) / step - 1e-6).astype(int), 1)
    out = np.empty((height, width), np.float32)
    padded = np.pad(probability, 2, constant_values=np.nan)  # beyond the image nothing is known
    across = np.arange(width) + 0.5 + low[0] / step
    band = max(1, _BAND_CELLS // int(width))
    for first in range(0, int(height), band):
        u, v = np.meshgrid(across, np.arange(first, min(first + band, height)) + 0.5 + low[1] / step)
        out[first: first + band] = _worst(padded, c * u + s * v, c * v - s * u, (c, s), header.occupied_thresh)
    return OccupancyGrid(out, step, (float(x + low[0]), float(y + low[1])))


def _worst(
    padded: np.ndarray, column: np.ndarray, row: np.ndarray, turn: tuple[float, float], occupied: float
) -> np.ndarray:
    """(H, W): of the pixels that a turned cell with its middle at (column, row) meets, the greatest occupancy; NaN if one
    is unknown and none above `occupied`. Separating axes of two squares; turn: cosine and sine; padded by two pixels."""
    c, s = turn
    reach = 0.5 + 0.5 * (abs(c) + abs(s)) - 1e-6  # what meets by less is rounding
    most_row, most_column = np.array(padded.shape) - 1
    worst, unknown = np.full(column.shape, -np.inf), np.zeros(column.shape, bool)
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            i, j = np.floor(column).astype(int) + right, np.floor(row).astype(int) + down
            du, dv = i + 0.5 - column, j + 0.5 - row
            meets = (np.maximum(abs(du), abs(dv)) < reach) & (np.maximum(abs(c * du - s * dv), abs(s * du + c * dv)) < reach)
            value = padded[np.clip(j + 2, 0, most_row), np.clip(i + 2, 0, most_column)]
            worst = np.where(meets & (value > worst), value, worst)
            unknown |= meets & np.isnan(value)
    return np.where(unknown & (worst <= occupied), np.nan, worst)
