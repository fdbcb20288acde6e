"""Folders of images that no list names: rgb/000001.png beside depth/000001.png, frame000001.jpg and depth000001.png in one
folder (Replica), or colour alone.

Images are taken in the order of the numbers in their names; numbers that are times are the stamps, others come at
`source.rate_hz` (30 where nothing is said). Colour and depth go together by their numbers, times by being near.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse

from ..replay_cameras import chosen_camera
from ..replay_images import (
    UnreadableImage,
    check_depth,
    check_pair,
    has_mosaic,
    hint_scale,
    is_wide,
    read_color,
    read_depth,
    reads_exr,
    resized,
    shrunk,
    without_mosaic,
)
from ..replay_mounts import placed_camera
from ..replay_stamps import associate, in_order
from ..replay_tum import Recording
from . import povray
from .intrinsics import depth_scale_said, intrinsics_beside
from .kitti_raw import drive_stamps, times_beside
from .poses import poses_beside
from .views import Listed, led, moved, numbered, one_series, stamps_by_name, truth_of

COLORS = ("rgb", "color", "colour", "image", "images", "rgb_images", "color_images", "left", "frames", "results",
          "lowres_wide", "photo", "data_rect")
SCENENET = "photo"  # beside depth along the rays (McCormac et al., ICCV 2017)
ASIDE = re.compile(r"conf(idence)?[_\d]", re.I)  # images of a phone that are neither colour nor depth
DEEP_ELSE = (".pfm", ".exr")  # of AirSim, Record3D, Blender, beside their images
FEW_SHADES = 40  # in 8 bits, of an image of 16
DEPTHS = ("depth", "depths", "depth_images", "lowres_depth")  # ARKitScenes' are the last
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".ppm", ".pgm", ".webp", ".tif", ".tiff")
DEEP_IMAGES = (".png", ".pgm", ".tif", ".tiff", ".npy", ".pfm", ".depth", ".jpg", ".jpeg")  # the last are refused by name
RATE_HZ = 30.0
DEPTH_SCALE = 1000.0
SAME_SHAPE = 0.02  # by which width to height of two images of one scene may differ

log = logging.getLogger("rhs.replay")


def is_frames(path: Path) -> bool:
    """Whether there are numbered images in a folder of colour, or two at least in the folder itself."""
    if not path.is_dir():
        return False
    within = _folder(path, COLORS)
    return len(_images(within or path)) >= (1 if within else 2)


def open_frames(path: Path, settings) -> Recording:
    """The views of numbered images: colour with depth where there is a folder of depth. Raises ConfigError."""
    colors, depths = _listed(path)
    one_series(colors)
    if depths and settings.depth_topic != "none":
        return _paired(path, colors, depths, settings)
    if not colors:
        raise ConfigError(f"{path}: no numbered image; expected rgb/000001.png, rgb/000002.png, ...")
    stamps, kept, rejected = _stamped(path, [number for number, _ in colors], settings)
    return _opened(path, colors, [(i, None) for i in kept], (stamps, rejected), settings)


def _listed(path: Path) -> tuple[list[tuple[str, Path]], list[tuple[str, Path]]]:
    """(number, file) of the images of colour and of depth: in a folder each, or named depth000001.png in one for both."""
    kinds = (*DEEP_IMAGES, ".exr") if reads_exr() else DEEP_IMAGES
    colors, within = _folder(path, COLORS), _folder(path, DEPTHS, kinds)
    if within is None and (strange := _folder(path, DEPTHS, ("",))) is not None:
        more = "; of .exr type pip install OpenEXR" if any(strange.glob("*.exr")) else ""
        log.warning("%s: no depth is read from %s; expected numbered %s; write others as .npy (metres)%s", path.name,
                    strange.name, ", ".join(DEEP_IMAGES[:6]), more)
    together = _images(colors or path)
    if within is not None:
        return together, _images(within, kinds)
    if along_rays := _images(path, (povray.DEPTH,)):
        return together, along_rays
    if other := [file for file in (colors or path).iterdir() if file.suffix.lower() in DEEP_ELSE]:
        log.warning("%s: no depth is read from its %d files such as %s; put them into a folder depth (.exr as .npy, metres, "
                    "or pip install OpenEXR), numbered as the images", path.name, len(other), other[0].name)
    deep = ["depth" in file.stem.lower() for _, file in together]
    return ([one for one, is_deep in zip(together, deep, strict=True) if not is_deep],
            [one for one, is_deep in zip(together, deep, strict=True) if is_deep])


def _paired(path: Path, colors, depths, settings) -> Recording:
    """Views of colour and depth, by equal numbers, or by near stamps where the numbers are times."""
    stamps, kept, rejected = _stamped(path, [number for number, _ in colors], settings)
    times, timed = stamps_by_name([number for number, _ in depths], settings.rate_hz, RATE_HZ)
    if timed:
        pairs = [(i, depths[j][1]) for i, j in associate(stamps, times, settings.max_difference_s)]
    else:
        by_number = {int(float(number)): file for number, file in depths}
        if len(by_number) < len(depths):
            raise ConfigError(f"{path}: {len(depths)} depth images have {len(by_number)} numbers at the end of their names "
                              f"({depths[0][1].name}, {depths[1][1].name}); expected one each, as 000001.png")
        numbers = [int(float(colors[k][0])) for k in kept]
        pairs = [(i, by_number[number]) for i, number in enumerate(numbers) if number in by_number]
    if not pairs:
        raise ConfigError(f"{path}: {len(colors)} colour and {len(depths)} depth images, no two with one number (or stamps "
                          f"within {settings.max_difference_s:g} s); type source.depth_topic=none to go without depth")
    rejected = rejected + Counter(unpaired=len(kept) - len(pairs) + len(depths) - len(pairs))
    chosen = [(kept[i], depth) for i, depth in pairs]
    return _opened(path, colors, chosen, (stamps[[i for i, _ in pairs]], rejected), settings)


def _stamped(path: Path, numbers: list[str], settings) -> tuple[np.ndarray, list[int], Counter]:
    """Ascending stamps, the indices of the files they are of, and what was rejected."""
    stamps, timed = stamps_by_name(numbers, settings.rate_hz, RATE_HZ)
    if not timed and (beside := times_beside(path, settings)) is not None:
        times, counts = drive_stamps(beside, [int(float(number)) for number in numbers], settings)
        return times, list(range(len(numbers))), counts
    kept, rejected = in_order(stamps, settings.max_jump_s) if timed else (list(range(len(numbers))), Counter())
    return stamps[kept], kept, rejected


def _opened(path: Path, colors, chosen, stamped, settings) -> Recording:
    """chosen: (which of colors, depth image or None) of each view; stamped: stamps (N,), counts."""
    stamps, rejected = stamped
    files = [(colors[i][1], depth) for i, depth in chosen]
    deep = files[0][1] is not None
    along_rays = deep and files[0][1].suffix == povray.DEPTH
    said = settings.depth_scale or (1.0 if along_rays else depth_scale_said(path, settings.camera) if deep else None)
    scale, typed = said or DEPTH_SCALE, bool(settings.depth_scale)
    first, mosaic = _first_image(files[0][0], path.name)
    size = (first.shape[1], first.shape[0])
    recorded = intrinsics_beside(path, size) if settings.camera == "auto" else None
    camera = placed_camera(chosen_camera(settings.camera, size, recorded=recorded, where=str(path)), settings)

    def depth_in(file: Path, max_depth_m: float = settings.max_depth_m) -> np.ndarray:
        if along_rays:
            return povray.read_ray_depth(file, camera, scale=scale, max_depth_m=max_depth_m)
        if colors[0][1].parent.name == SCENENET:
            return povray.ahead(read_depth(file, scale=scale, max_depth_m=max_depth_m, typed=typed), camera)
        return read_depth(file, scale=scale, max_depth_m=max_depth_m, typed=typed)

    smaller = _first_depth(first, depth_in(files[0][1], np.inf), files[0][1].name, scale) if deep else None
    if deep and not said:
        hint_scale([depth for _, depth in files], scale=scale, where=path.name)
    if smaller is not None:
        log.warning("%s: colour of %dx%d is made as small as its depth, %dx%d", path.name, *size, *smaller)
        camera = resized(camera, smaller)

    def read(i: int, before: int | None) -> dict:
        image = without_mosaic(read_color(files[i][0])) if mosaic else read_color(files[i][0])
        if image.shape[:2] != first.shape[:2]:
            raise UnreadableImage(f"{files[i][0]}: found {image.shape[1]}x{image.shape[0]} pixels; expected "
                                  f"{size[0]}x{size[1]} as in the first view")
        if not deep:
            return {"image": image}
        depth = depth_in(files[i][1])
        image = image if smaller is None else shrunk(image, smaller)
        check_pair(image, depth, files[i][0].name)
        return {"image": image, "depth": depth}

    true, counts, timed = _true_poses(path, colors, settings, scale if along_rays else None)
    camera_from_body = inverse(camera.body_from_camera)

    def pose(i: int) -> np.ndarray | None:
        return moved(true(chosen[i][0], float(stamps[i])), camera_from_body)

    provides = frozenset({"image", "gray", "depth"} if deep else {"image", "gray"})
    return led(Listed(str(path), stamps, read, camera, provides, pose, rejected + counts, timed=timed),
               settings)


def _first_image(file: Path, where: str) -> tuple[np.ndarray, bool]:
    """The first colour image, and whether it is a raw mosaic; what is odd about it is said."""
    first = read_color(file)
    if is_wide(file) and (shades := len(np.unique(first))) < FEW_SHADES:
        log.warning("%s: its images of 16 bits use a small part of them (a thermal camera's?), %d shades of 256: stretch "
                    "all alike: mogrify -level LOW%%,HIGH%% -depth 8 *.png", where, shades)
    mosaic = has_mosaic(first)
    if mosaic:
        log.warning("%s: its images are the raw mosaic of a Bayer filter; they are smoothed into grey ones", where)
    return first, mosaic


def _true_poses(path: Path, colors, settings, ray_scale: float | None):
    """(true pose of a view by number and stamp, counts, whether the views have times). ray_scale: of depth along rays
    (POV-Ray), beside which the poses lie."""
    numbers = [number for number, _ in colors]
    timed = bool(settings.rate_hz or times_beside(path, settings, say=False)) or stamps_by_name(numbers, 0.0, RATE_HZ)[1]
    beside = poses_beside(path)
    if ray_scale is not None and beside is None and not settings.truth:
        return povray.truth_of([color for _, color in colors], ray_scale), Counter[str](), timed
    return (*truth_of(beside, settings, numbers, untimed=not timed), timed)


def _first_depth(color: np.ndarray, depth: np.ndarray, where: str, scale: float) -> tuple[int, int] | None:
    """(width, height) of depth that shows all of the colour image in fewer pixels (ScanNet); None: in as many. Raises
    ConfigError where they do not fit each other, or the scale is wrong."""
    (height, width), (deep_height, deep_width) = color.shape[:2], depth.shape[:2]
    same_shape = abs(deep_width * height / (deep_height * width) - 1.0) < SAME_SHAPE
    smaller = (deep_width, deep_height) if same_shape and deep_width < width else None
    if smaller is None:
        check_pair(color, depth, where)
    check_depth(depth, scale=scale, where=where)
    return smaller


def _folder(path: Path, names: tuple[str, ...], kinds: tuple[str, ...] = IMAGES) -> Path | None:
    """The folder of that name, the first of the names first; any case."""
    inner = {p.name.lower(): p for p in path.iterdir() if p.is_dir()}
    return next((inner[name] for name in names if name in inner and _images(inner[name], kinds)), None)


def _images(folder: Path, kinds: tuple[str, ...] = IMAGES) -> list[tuple[str, Path]]:
    """Numbered files of these kinds; of any kind where one of them is empty."""
    return numbered(p for p in folder.iterdir() if (p.suffix.lower() in kinds or "" in kinds) and not ASIDE.match(p.name))
