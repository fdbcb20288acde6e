"""Intrinsics in files beside the frames, as cameras, calibration programs and data sets write them.

JSON: nine numbers of a matrix, row by row (3D Scanner App) or column by column (Open3D, Record3D's metadata.json), or fx,
fy, cx, cy by name; ScanNet++'s pose_intrinsic_imu.json. YAML: what ROS's
camera_calibration writes (camera_info.yaml). Text: a 3x3 or 4x4 matrix, or fx fy cx cy and the lens in one line;
BundleFusion's info.txt; DSO's camera.txt. YAML too of Kalibr (camchain.yaml: its first camera), EuRoC, OpenCV's
calibration, ORB-SLAM (Camera.fx) and VINS (projection_parameters). Replica's cam_params.json, one folder up, also says the
scale of depth, as do others by name (SCALES). Stray Scanner's camera_matrix.csv, Nerfstudio's transforms.json, COLMAP's
cameras.txt; Polycam's cameras/NUMBER.json, ARKitScenes' .pincam and RTAB-Map's calib/STAMP.yaml of each view, of which
the first is taken.
"""

from __future__ import annotations

import json
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse

from ..lens_models import MODELS, with_lens

NAMES = ("camera*.json", "*intrinsic*.json", "camera*.yaml", "camera*.yml", "calibration.yaml", "*intrinsic*.txt",
         "camera.txt", "calibration.txt", "intrinsic/intrinsic_color.txt", "info.txt", "_info.txt", "cam_params.json",
         "camera_matrix.csv", "transforms.json", "*camchain*.yaml", "metadata.json", "sensors.yaml")
ELSE = ("cameras/*.json", "calib/*.yaml", "frame_*.json", "lowres_wide_intrinsics/*.pincam", "cameras.txt",
        "sparse/cameras.txt", "sparse/0/cameras.txt")
ABOVE = ("cam_params.json",)  # and one folder up
MOST_BYTES = 60_000_000  # transforms.json and ScanNet++'s hold a pose of each view
MOST_SCALE = 1e6
SCALES = ("depth_scale", "png_depth_scale", "depthmapfactor", "rgbd.depthmapfactor", "depth_factor")
LEAST_MM, SMALL_BYTES = 0.01, 1_000_000  # of a step, where it is told in millimetres (BOP); of files that hold no poses
PINHOLES = ("pinhole", "simple_pinhole")  # models of cameras that say nothing of a lens
COLMAP = {"SIMPLE_PINHOLE": "f cx cy", "PINHOLE": "fx fy cx cy", "SIMPLE_RADIAL": "f cx cy k1", "RADIAL": "f cx cy k1 k2",
          "OPENCV": "fx fy cx cy k1 k2 p1 p2", "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4"}
LORIS = "d400_color_optical_frame"  # of OpenLORIS's sensors.yaml, in which cx stands before fy
OTHER_DIST = re.compile(r"undist|distance|_model|_type")  # names with "dist" that are of no lens
WITHIN = ("camera", "cam0", "cam", "camera_params", "intrinsic", "color", "rgb")  # what holds the numbers of a camera
LENSES = ("plumb_bob", "rational_polynomial", "radial-tangential", "radtan", "brown", "opencv", "none", "")
log = logging.getLogger("rhs.replay")
HOWTO = "type source.camera=[fx,fy,cx,cy] or source.camera=FILE"


def intrinsics_beside(folder: Path, size: tuple[int, int]) -> Camera | None:
    """The camera of the only intrinsics file in a folder; None where there is none. Raises ConfigError."""
    found = _files_beside(folder)
    if len(found) > 1:
        raise ConfigError(f"{folder}: several intrinsics: {', '.join(p.name for p in found[:4])}; type source.camera=FILE")
    return read_intrinsics(found[0], size) if found else None


def _files_beside(folder: Path) -> list[Path]:
    found = sorted({path for pattern in NAMES for path in folder.glob(pattern) if path.is_file()})
    found = [path for path in found if "depth" not in path.name.lower()] or found  # ScanNet's intrinsics_color.txt beside
    found = [path for path in found if path.name != "metadata.json" or '"K"' in path.read_text("utf-8", "replace")]
    found = found or [folder.parent / name for name in ABOVE if (folder.parent / name).is_file()]
    return found or [path for pattern in ELSE for path in sorted(folder.glob(pattern))[:1]][:1]


def depth_scale_said(folder: Path, camera: Any) -> float | None:
    """Steps of a depth image in one metre as the camera's file says it, which is said: the one that was typed (camera), or
    found. None where nothing does."""
    typed = isinstance(camera, str) and camera != "auto"
    file = next(iter([Path(camera).expanduser()] if typed else _files_beside(folder) if camera == "auto" else []), None)
    scale = None if typed else depth_scale_beside(folder)
    if scale is None and file is not None and file.is_file() and file.stat().st_size < SMALL_BYTES:
        scale = _scale_in(file)
        if scale is not None:
            log.warning("%s says %g steps of depth in a metre (source.depth_scale=)", file.name, scale)
    return scale


def _scale_in(file: Path) -> float | None:
    """By one of SCALES: above 1 steps in a metre; else the length of one, in metres (RealSense) or millimetres (BOP)."""
    try:
        text = file.read_text(encoding="utf-8-sig")
        plain = json.loads(text) if file.suffix == ".json" else read_yaml(text) if file.suffix in (".yaml", ".yml") else {}
        told = [plain, *(plain[key] for key in WITHIN if isinstance(plain.get(key), dict))]
        said = next((float(value) for one in told for key, value in one.items() if str(key).lower() in SCALES), 0.0)
    except (ValueError, TypeError, AttributeError, RecursionError):
        return None  # whoever needs its intrinsics says so
    scale = said if said > 1.0 or said <= 0.0 else (1.0 if said < LEAST_MM else 1000.0) / said
    return scale if 0.0 < scale <= MOST_SCALE else None


def depth_scale_beside(folder: Path) -> float | None:
    """Steps of a depth image in one metre as Replica's cam_params.json or SensReader's info.txt says it; None where nothing
    does."""
    path = next((path / name for name in ABOVE for path in (folder, folder.parent) if (path / name).is_file()), None)
    info = next((one for one in (folder / "info.txt", folder / "_info.txt") if one.is_file()), None)
    try:
        if info is not None:
            scale = float(_named(info.read_text(encoding="utf-8-sig")).get("m_depthShift", 0.0))
        else:
            plain = {} if path is None else json.loads(path.read_text(encoding="utf-8-sig"))
            scale = float(plain.get("camera", plain).get("scale", 0.0))
    except (ValueError, TypeError, AttributeError, UnicodeDecodeError, RecursionError):
        return None  # whoever needs its intrinsics says so
    return scale if 0.0 < scale <= MOST_SCALE else None


def depth_camera_beside(folder: Path) -> list[float]:
    """fx, fy, cx, cy of depth images of another size than colour, as SensReader's info.txt says; empty where nothing does,
    or the two cameras do not sit at one place."""
    info = next((one for one in (folder / "info.txt", folder / "_info.txt") if one.is_file()), None)
    try:
        named = {} if info is None else _named(info.read_text(encoding="utf-8-sig"))
        sizes = [[int(named[f"m_{eye}{side}"]) for side in ("Width", "Height")] for eye in ("color", "depth")]
        matrix, *places = (np.array(named[f"m_calibration{key}"].split(), float).reshape(4, 4)
                           for key in ("DepthIntrinsic", "DepthExtrinsic", "ColorExtrinsic"))
    except (KeyError, ValueError, UnicodeDecodeError):
        return []
    apart = sizes[0] == sizes[1] or not np.allclose(places[0], places[1])
    return [] if apart else [float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2))]


def read_intrinsics(path: Path, size: tuple[int, int]) -> Camera:
    """The camera of a JSON, YAML or text file; `size` (width, height) where it names none. Raises ConfigError."""
    if path.stat().st_size > MOST_BYTES:
        raise ConfigError(f"{path}: found {path.stat().st_size} bytes; expected a camera's intrinsics; {HOWTO}")
    try:
        text = path.read_text(encoding="utf-8-sig")
        if "m_calibrationColorIntrinsic" in text:
            return _of_bundle_fusion(text, size)
        if path.suffix == ".txt" and (camera := _of_dso(text)) is not None:
            return camera
        if path.suffix == ".txt" and (given := _of_colmap(text)) is not None:
            return camera_of_names(given, size)
        if path.suffix == ".pincam":
            width, height, *numbers = (float(word) for word in text.split())
            return _camera(numbers, (), (int(width), int(height)))
        if path.suffix in (".txt", ".csv"):
            return _camera(_of_text(text), (), size)
        plain = json.loads(text) if path.suffix == ".json" else read_yaml(text)
        if not isinstance(plain, dict):
            raise ValueError(f"found a {type(plain).__name__}, expected names and values")
        if isinstance(view := next(iter(plain.values()), None), dict) and "intrinsic" in view:  # ScanNet++
            plain = {"intrinsic_matrix": np.ravel(view["intrinsic"])}
        if isinstance(seen := plain.get(LORIS), dict):
            fx, cx, fy, cy = _data(seen["intrinsics"])
            plain = seen | {"intrinsics": [fx, fy, cx, cy]}
        return camera_of_names(next((plain[key] for key in WITHIN if isinstance(plain.get(key), dict)), plain), size)
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:  # json's, yaml's, of no text, too
        short = f"{type(error).__name__}: {' '.join(str(error).split())[:120]}"
        raise ConfigError(f"{path}: cannot be read as a camera's intrinsics ({short}); {HOWTO}") from None


def second_of_chain(path: Path, size: tuple[int, int]) -> tuple[Camera, np.ndarray] | None:
    """The second camera of Kalibr's camchain.yaml and 4x4 first_from_second; None of another file. Raises ConfigError."""
    try:
        plain = read_yaml(path.read_text(encoding="utf-8-sig")) if path.suffix in (".yaml", ".yml") else None
        if not isinstance(plain, dict) or "T_cn_cnm1" not in (plain.get("cam1") or {}):
            return None
        place = np.array(plain["cam1"]["T_cn_cnm1"], float).reshape(4, 4)
        return camera_of_names(plain["cam1"], size), inverse(place)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ConfigError(f"{path}: its cam1 cannot be read ({' '.join(str(error).split())[:100]}); expected Kalibr's "
                          "camchain.yaml") from None


def read_yaml(text: str) -> Any:
    """Plain values of a YAML text, of several documents (as `ros2 topic echo` writes) the first; OpenCV's first line
    `%YAML:1.0` and its tags are none and left out. Raises ValueError."""
    import yaml

    lines = [line.replace("!!opencv-matrix", "") for line in text.splitlines() if not line.startswith("%")]
    try:
        return next(iter(yaml.safe_load_all("\n".join(lines))), None)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from None


def _of_text(text: str) -> list[float]:
    lines = [line.split("#", 1)[0].replace(",", " ").split() for line in text.splitlines()]
    table = [[float(word) for word in words] for words in lines if words]
    if len(table) in (3, 4) and {len(row) for row in table} == {len(table)}:
        matrix = np.array(table)
    elif len(table) == 1 and len(table[0]) == 9 and table[0][1] == table[0][3] == 0.0 and table[0][8] == 1.0:
        matrix = np.array(table[0]).reshape(3, 3)
    elif len(table) == 1 and len(table[0]) in (4, 8, 9):
        return table[0]
    else:
        found = f"found {len(table)} lines of {len(table[0]) if table else 0} numbers"
        raise ValueError(f"{found}, expected a 3x3 matrix or fx fy cx cy")
    return [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]]


def _of_bundle_fusion(text: str, size: tuple[int, int]) -> Camera:
    """Lines `name = values`, of the colour camera, to whose pixels depth is registered."""
    named = _named(text)
    matrix = [float(word) for word in named["m_calibrationColorIntrinsic"].split()]
    if len(matrix) != 16:
        raise ValueError(f"m_calibrationColorIntrinsic has {len(matrix)} numbers, expected 16")
    said = (int(named.get("m_colorWidth", size[0])), int(named.get("m_colorHeight", size[1])))
    return _camera([matrix[0], matrix[5], matrix[2], matrix[6]], (), said)


def _named(text: str) -> dict[str, str]:
    """Of lines `name = values`."""
    return dict(line.split(" = ", 1) for line in text.splitlines() if " = " in line)


def _of_dso(text: str) -> Camera | None:
    """Model and numbers, width and height, two lines more (DSO's readme): five numbers alone are those of FOV, eight of
    radtan, all of them shares of the image where its middle is below 1. None of a file of another form."""
    lines = [line.split() for line in text.splitlines() if line.strip()]
    if len(lines) < 2 or len(lines[1]) != 2 or not all(word.isdigit() for word in lines[1]):
        return None
    named = lines[0][0].isalpha()
    numbers = [float(word) for word in lines[0][named:]]
    model = lines[0][0].lower() if named else {5: "fov", 8: "radtan"}.get(len(numbers), "")
    if len(numbers) < 4 or not model:
        return None
    width, height = (int(word) for word in lines[1])
    fx, fy, cx, cy, *lens = numbers
    if cx < 1.0 and cy < 1.0:
        fx, fy, cx, cy = fx * width, fy * height, cx * width - 0.5, cy * height - 0.5
    names = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "distortion_model": model, "distortion": lens}
    return camera_of_names(names, (width, height))


def _of_colmap(text: str) -> dict[str, Any] | None:
    """Names and values of the camera in COLMAP's cameras.txt, whose pixels begin at their corner; None of another file.
    Raises ValueError where there are several, or of a model that is not read."""
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if not rows or len(rows[0]) < 7 or not re.fullmatch(r"[A-Z][A-Z_]+", rows[0][1]):
        return None
    _, model, width, height, *numbers = rows[0]
    if len(rows) > 1 or model not in COLMAP:
        raise ValueError(f"found {len(rows)} cameras, the first {model}; expected one of {', '.join(COLMAP)}")
    named = dict(zip(COLMAP[model].split(), map(float, numbers), strict=True))
    fx = named.pop("f", None) or named["fx"]
    fisheye = {"camera_model": "OPENCV_FISHEYE"} if model.endswith("FISHEYE") else {}
    return {"fy": fx} | named | fisheye | {"fx": fx, "cx": named["cx"] - 0.5, "cy": named["cy"] - 0.5, "width": int(width),
                                           "height": int(height)}


def camera_of_names(given: dict[str, Any], size: tuple[int, int]) -> Camera:
    """The camera of names and values as these programs write them. Raises ValueError."""
    plain = {re.sub(r"^camera1?\.", "", str(key).lower()): value for key, value in given.items()}
    plain["lens"] = given.get("Camera.type", "")  # of ORB-SLAM3
    for key in ("projection_parameters", "distortion_parameters"):  # VINS
        plain |= plain.get(key) or {}
    told = [plain.get(key) or "" for key in ("distortion_model", "camera_model", "model_type", "lens")]
    told += [name for name in [plain.get("model")] if str(name).lower() in MODELS]  # else anybody's word for his device
    model = next((str(name).lower() for name in told if name and str(name).lower() not in PINHOLES), "")
    if model not in (*LENSES, *MODELS):
        raise ValueError(f"distortion_model is {model}, expected plumb_bob, equidistant or FOV")
    width, height = (plain.get(f"image_{key}") or plain.get(key) or plain.get(key[0]) for key in ("width", "height"))
    width, height = plain.get("resolution", (width or size[0], height or size[1]))
    said = (int(width), int(height))
    matrices = (_data(plain.get(key, ())) for key in ("intrinsic_matrix", "intrinsics", "k", "camera_matrix", "mtx"))
    nine = next((one for one in matrices if np.size(one) == 9), None)
    if nine is not None:
        matrix = np.array(nine, float).reshape(3, 3)
        matrix = matrix if (matrix[2, :2] == 0.0).all() else matrix.T  # column by column
    else:
        if "intrinsics" in plain:
            if np.size(plain["intrinsics"]) != 4:  # of Kalibr's omni, ds and eucm, say
                raise ValueError(f"intrinsics has {np.size(plain['intrinsics'])} numbers, expected fx, fy, cx, cy")
            plain |= dict(zip(("fx", "fy", "cx", "cy"), plain["intrinsics"], strict=True))
        others = (("fx", "fl_x"), ("fy", "fl_y"), ("cx", "ppx"), ("cy", "ppy"))
        keys = [k if k in plain or other not in plain else other for k, other in others]
        missing = [key for key in keys if key not in plain]
        if missing:
            raise ValueError(f"found {', '.join(map(str, list(given)[:5]))}; expected fx, fy, cx, cy or intrinsic_matrix")
        matrix = np.array([[plain[keys[0]], 0.0, plain[keys[2]]], [0.0, plain[keys[1]], plain[keys[3]]]], float)
    lens = _lens(plain, ("k1", "k2", "k3", "k4") if model in MODELS else ("k1", "k2", "p1", "p2", "k3"))
    corner = 0.5 if "fl_x" in plain else 0.0  # Nerfstudio counts pixels from their corners, as COLMAP does
    values = [matrix[0, 0], matrix[1, 1], matrix[0, 2] - corner, matrix[1, 2] - corner]
    return with_lens(_camera(values, (), said), model, lens) if model in MODELS else _camera(values, lens, said)


def _data(given: Any) -> Any:
    """The numbers of a matrix: as they are, or what is called `data`."""
    return given.get("data", ()) if isinstance(given, dict) else given


def _lens(plain: dict[str, Any], names: tuple[str, ...]) -> list[float]:
    """The numbers of a lens: listed under whatever people call them (D, dist, dist_coeffs, distortion_coefficients), else
    by their names. Raises ValueError for a list of a part of them."""
    for key, value in plain.items():
        if key in ("d", "coeffs") or ("dist" in key and not OTHER_DIST.search(key)):
            listed = np.ravel(_data(value)) if isinstance(value, (list, dict)) else np.zeros(0)
            if listed.size:
                if listed.dtype.kind not in "if":
                    raise ValueError(f"{key} holds {str(listed[0])[:20]!r}, expected numbers")
                if listed.size < 4 and listed.any() and ("radial" in key or "tangential" in key):
                    raise ValueError(f"{key} has {listed.size} numbers, expected k1, k2, p1, p2 and more")
                return [float(v) for v in listed]
    more = ("k4", "k5", "k6") if any(plain.get(key) for key in ("k4", "k5", "k6")) else ()
    return [float(plain.get(key, 0.0)) for key in (*names, *(key for key in more if key not in names))]


def _camera(values, lens, size: tuple[int, int]) -> Camera:
    fx, fy, cx, cy, *more = (float(v) for v in values)
    lens = tuple(lens) or tuple(more)
    lens = lens if any(lens[8:]) else lens[:8]  # OpenCV writes 12 and 14, of which the last are those of prisms and tilts
    numbers = [fx, fy, cx, cy, *lens]
    if not np.all(np.isfinite(numbers)) or not (fx > 0 and fy > 0) or len(lens) > 8:
        raise ValueError(f"found fx={fx:g} fy={fy:g}, {len(lens)} numbers of a lens; expected fx, fy above 0 and at most 8")
    padded = () if not any(lens) else (*lens, *[0.0] * 8)[: 5 if len(lens) <= 5 else 8]
    return Camera(size[0], size[1], fx, fy, cx, cy, distortion=padded)
