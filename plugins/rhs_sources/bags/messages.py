"""ROS messages turned into arrays: images, depth in any of its encodings, camera info, scans, clouds, poses."""

from __future__ import annotations

import logging
import struct
from collections.abc import Collection, Iterator
from contextlib import suppress
from itertools import islice

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, rotation_of_quaternion, se3, transform
from rhs.api.pictures import HEAD_BYTES, MOST_PIXELS, check_size
from rhs.api.records import Scan

from ..lens_models import MODELS as LENS_MODELS
from ..lens_models import with_lens
from ..replay_images import UnreadableImage, metres
from ..replay_stamps import TIME_FIELDS
from ..unread import VIDEO
from .rvl import unpacked_rvl

log = logging.getLogger("rhs.replay")
COLOR = {"rgb8": (3, None), "bgr8": (3, (2, 1, 0)), "8UC3": (3, (2, 1, 0)), "rgba8": (4, (0, 1, 2)),
         "bgra8": (4, (2, 1, 0)), "8UC4": (4, (2, 1, 0)), "mono8": (1, (0, 0, 0)), "8UC1": (1, (0, 0, 0)),
         "rgb16": (3, None), "bgr16": (3, (2, 1, 0))}
BAYER = {"bayer_rggb8": "BayerRGGB2RGB", "bayer_bggr8": "BayerBGGR2RGB", "bayer_gbrg8": "BayerGBRG2RGB",
         "bayer_grbg8": "BayerGRBG2RGB"}  # sensor_msgs' words for the first two by two pixels, and OpenCV's
YUV = {"yuv422": "YUV2RGB_UYVY", "uyvy": "YUV2RGB_UYVY", "yuv422_yuy2": "YUV2RGB_YUY2", "yuyv": "YUV2RGB_YUY2"}  # of webcams
PLANES = {"nv12": "YUV2RGB_NV12", "nv21": "YUV2RGB_NV21"}  # brightness, then colours of two by two pixels (Isaac ROS)
WIDE, FEW_SHADES = ("mono16", "16UC1"), 40  # grey of 16 bits; of 256
DEPTH = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
FEW, SAME = 10, 0.34  # messages; share of them with stamps of their own from which on stamps are believed
LOOKED_AT, NEAR_S = 100, 60.0  # messages of a topic for its first stamp; it is of a clock that began at zero
MOST_RAD = 2.0 * np.pi + 0.1  # of a scan: a turn, and what rounding and doubled ends add
OFF = 0.05  # of what a scan covers, by which its end may be off
FURTHEST_M = 500.0  # that lasers which look round see
UNIT = 0.05  # a quaternion may be so much longer or shorter than 1
KITTI = "/kitti/camera_"
BROWN = "brown_conrady"  # inverse, modified: librealsense projects all of them by plumb_bob's polynomial (rsutil.h)
LEAST_PX = 2.0  # of a focal length; shares of the image (0.8) are none
FLOATS = {7: "f4", 8: "f8"}  # sensor_msgs/PointField datatypes
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", **FLOATS}


def stamp_of(message) -> float:
    """Seconds of a message's header."""
    stamp = message.header.stamp
    return stamp.sec + stamp.nanosec * 1e-9


class UnreadableBag(ConfigError):
    """A bag that cannot be read further: cut, damaged, or written in a way that is not known."""


def messages(reader, connections: list) -> Iterator:
    """(topic, when it arrived in seconds, message) in the order of the bag. Raises UnreadableBag."""
    try:
        for connection, arrived_ns, raw in reader.messages(connections=connections) if connections else ():  # of none: all
            yield connection.topic, arrived_ns * 1e-9, _read(reader, raw, connection.msgtype)
    except Exception as error:  # the library raises many kinds for damaged files
        said = " ".join(f"{type(error).__name__}: {error}".split())[:150]
        raise UnreadableBag(f"{reader.paths[0]}: cannot be read further ({said})") from error


def _read(reader, raw, kind: str):
    """The message, also of an image behind which a recorder writes more than its definition tells."""
    try:
        return reader.deserialize(raw, kind)
    except Exception as error:
        if "size mismatch" not in str(error) or not kind.endswith("/Image"):
            raise
        definition = reader.typestore.get_msgdef(kind)
        return definition.deserialize_ros1(raw, 0, definition.cls, reader.typestore)[0]


def stamped(reader, topics: Collection[str], coarse: Collection[str] = ()) -> Iterator:
    """(topic, stamp, message) in the order of the bag; a header that was left at zero, or none, means when it arrived, as
    do those of the topics that are coarse."""
    chosen = [c for c in reader.connections if c.topic in topics]
    simulated = {c.topic for c in chosen if _begins_at_zero(reader, c)}
    for topic, arrived_s, message in messages(reader, chosen):
        stamp = stamp_of(message) if hasattr(message, "header") else 0.0
        yield topic, stamp if topic not in coarse and (stamp or topic in simulated) else arrived_s, message


def coarse_topics(reader, topics: Collection[str]) -> set[str]:
    """Of the topics those whose headers hardly tell their messages apart (whole seconds, a stamp that never changes); said
    once."""
    found = set()
    for topic in topics:
        first: list = []
        with suppress(UnreadableBag):  # said where the views are read
            first += islice(messages(reader, [c for c in reader.connections if c.topic == topic]), FEW)
        stamps = {stamp_of(message) for _, _, message in first if hasattr(message, "header")}
        arrived = {arrived_s for _, arrived_s, _ in first}
        if len(first) == FEW and 0 < len(stamps) <= SAME * FEW and len(arrived) == FEW and stamps != {0.0}:
            found.add(topic)
            log.warning("%s: of its first %d messages %d have stamps of their own; each is taken to be of when it arrived",
                        topic, FEW, len(stamps))
    return found


def _begins_at_zero(reader, connection) -> bool:
    """Whether zero is where a simulator's clock begins, and no stamp left out: it is the first, and the next is near."""
    for number, (_, _, message) in enumerate(islice(messages(reader, [connection]), LOOKED_AT)):
        stamp = stamp_of(message) if hasattr(message, "header") else 0.0
        if stamp:
            return number > 0 and stamp < NEAR_S
    return False


def shift_of(message, topic: str) -> int:
    """By how many bits the pixels of a grey image of 16 are above 8: cameras of 10, 12 and 14 leave the upper ones empty. 0
    of other images; said where what they show uses few of them (a thermal camera's)."""
    if getattr(message, "encoding", "") not in WIDE:
        return 0
    values = _rows(message, np.dtype("u2"), 1, topic)
    most, least = (int(np.percentile(values, share)) for share in (99.9, 0.1))
    shift = max(most.bit_length() - 8, 0)
    log.warning("%s: its images are %s: taken for grey ones of %d bits (of depth type source.depth_topic=%s)", topic,
                message.encoding, shift + 8, topic)
    if (shades := (most >> shift) - (least >> shift)) < FEW_SHADES:
        log.warning("%s: its images of 16 bits use a small part of them (a thermal camera's?), %d shades of 256: stretch "
                    "all alike, from %d to %d, into mono8", topic, shades, least, most)
    return shift


def color_of(message, topic: str, shift: int = 8) -> np.ndarray:
    """(H, W, 3) uint8 RGB of an Image or CompressedImage; shift: of grey images of 16 bits."""
    if hasattr(message, "format"):
        encoding = message.format.split(";")[0].strip()
        if encoding.lower() in VIDEO:
            raise ConfigError(f"{topic}: its images are {encoding} video, which is not read; republish them as images "
                              "(image_transport republish) and record these")
        if encoding not in BAYER:
            return _decoded(message.data, topic, color=True)
        mosaic = _decoded(message.data, topic, color=False)  # image_transport packs it as it is, unless it made colour of it
        return _of_mosaic(mosaic, encoding) if mosaic.ndim == 2 else _decoded(message.data, topic, color=True)
    if message.encoding in BAYER:
        return _of_mosaic(_rows(message, np.dtype("u1"), 1, topic)[:, :, 0], message.encoding)
    if message.encoding in YUV:
        import cv2

        if int(message.width) % 2:
            raise ConfigError(f"{topic}: {message.encoding} images are {message.width} pixels wide; expected an even number")
        return cv2.cvtColor(_rows(message, np.dtype("u1"), 2, topic), getattr(cv2, f"COLOR_{YUV[message.encoding]}"))
    if message.encoding in WIDE:
        grey = np.minimum(_rows(message, np.dtype("u2"), 1, topic) >> shift, 255).astype(np.uint8)
        return np.repeat(grey, 3, axis=2)
    if message.encoding in PLANES:
        return _of_planes(message, topic)
    if message.encoding not in COLOR:
        known = ", ".join((*COLOR, *WIDE, *BAYER, *YUV, *PLANES))
        raise ConfigError(f"{topic}: images are {message.encoding or 'of no encoding'}; republish them as rgb8 or "
                          f"mono8 (cv_bridge) and record that; expected one of {known}")
    channels, order = COLOR[message.encoding]
    wide = message.encoding.endswith("16")
    image = _rows(message, np.dtype("u2" if wide else "u1"), channels, topic)
    image = (image >> 8).astype(np.uint8) if wide else image
    return np.ascontiguousarray(image if order is None else image[:, :, list(order)])


def _of_planes(message, topic: str) -> np.ndarray:
    """(H, W, 3) uint8 RGB of an image whose rows of brightness are followed by half as many rows of colour."""
    import cv2

    height, width, step = int(message.height), int(message.width), int(message.step)
    held, needed = np.asarray(message.data, np.uint8), step * height * 3 // 2
    if height % 2 or width % 2 or not 0 < height * width <= MOST_PIXELS or step < width or len(held) < needed:
        raise UnreadableImage(f"{topic}: an image says {width}x{height}, {message.encoding}, {step} bytes a row, but holds "
                              f"{len(held)} bytes; expected even sizes and half as much again")
    rows = np.ascontiguousarray(held[:needed].reshape(-1, step)[:, :width])
    return cv2.cvtColor(rows, getattr(cv2, f"COLOR_{PLANES[message.encoding]}"))


def _of_mosaic(mosaic: np.ndarray, encoding: str) -> np.ndarray:
    """(H, W, 3) uint8 RGB of the (H, W) uint8 behind a Bayer filter."""
    import cv2

    return cv2.cvtColor(np.ascontiguousarray(mosaic), getattr(cv2, f"COLOR_{BAYER[encoding]}"))


def depth_of(message, topic: str, *, scale: float, max_depth_m: float) -> np.ndarray:
    """(H, W) float32 metres, NaN unknown, of an Image or CompressedImage. 16-bit: `scale` steps a metre (0: 1000)."""
    if hasattr(message, "format"):
        return _compressed_depth(message, topic, scale=scale, max_depth_m=max_depth_m)
    if message.encoding not in DEPTH:
        bits = "8-bit " if "8" in message.encoding else ""
        raise ConfigError(f"{topic}: depth is {bits}{message.encoding}; expected one of {', '.join(DEPTH)}")
    raw = _rows(message, np.dtype(DEPTH[message.encoding]), 1, topic)[:, :, 0]
    return _in_metres(raw, topic, scale=scale, max_depth_m=max_depth_m)


def usual_scale(message) -> float:
    """Steps in a metre of a topic of depth where nobody says: floats are metres."""
    kind = message.format if hasattr(message, "format") else message.encoding
    return 1.0 if kind.startswith("32FC1") else 1000.0


def is_rectified(topic: str) -> bool:
    """Whether a topic's images had their lens undone, as its name says; kitti2bag names KITTI's rectified ones image_raw and
    writes the K of the raw ones beside them."""
    return "rect" in topic or topic.startswith(KITTI)


def camera_of(message, *, rectified: bool = False) -> Camera | None:
    """The camera of a CameraInfo, hand-held; None when it was not calibrated (K is zero, or in no pixels, and so is P).
    rectified: of images whose lens has been undone, whose camera is P (sensor_msgs/CameraInfo)."""
    k = np.asarray(message.K if hasattr(message, "K") else message.k, float).reshape(3, 3)
    d = tuple(float(v) for v in (message.D if hasattr(message, "D") else message.d))
    p = np.asarray(message.P if hasattr(message, "P") else message.p, float).reshape(3, 4)
    alone = not k.any() and min(p[0, 0], p[1, 1]) >= LEAST_PX  # kitti2bag, of KITTI odometry
    if not alone and (not np.all(np.isfinite(k)) or min(k[0, 0], k[1, 1]) < LEAST_PX):
        return None
    if (rectified or alone) and np.all(np.isfinite(p)) and p[0, 0] > 0 and p[1, 1] > 0:
        return Camera(message.width, message.height, p[0, 0], p[1, 1], p[0, 2], p[1, 2], p[0, 1])
    model = "_".join(message.distortion_model.lower().split())  # librealsense's have spaces
    model = "plumb_bob" if model.endswith(BROWN) else model
    if model in LENS_MODELS and d:
        try:
            return with_lens(Camera(message.width, message.height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1]), model, d)
        except ValueError as error:
            raise ConfigError(f"camera info has {error}") from None
    if model not in ("plumb_bob", "rational_polynomial", "") and any(d):
        raise ConfigError(f"camera info has distortion {message.distortion_model}; expected plumb_bob or equidistant; "
                          "undistort the images (image_proc) and use their topic")
    if any(d[8:]):
        raise ConfigError(f"camera info has {len(d)} distortion numbers, the ninth or later not zero; expected at most "
                          "k1, k2, p1, p2, k3, k4, k5, k6")
    if any(d[5:]):
        distortion = (*d, *[0.0] * 8)[:8]
    else:
        distortion = d[:5] if any(d) else ()
    return Camera(message.width, message.height, k[0, 0], k[1, 1], k[0, 2], k[1, 2], k[0, 1], distortion)


def scan_of(message, topic: str, most_m: float = np.inf) -> Scan:
    """A LaserScan or MultiEchoLaserScan; from range_max on, or the reading that stands for nothing (most_m), is free, below
    range_min or NaN unknown."""
    ranges = ranges_of(message)
    bearings = message.angle_min + message.angle_increment * np.arange(len(ranges))
    if not np.all(np.isfinite(bearings)) or not message.range_max > 0:
        raise ConfigError(f"{topic}: the scan's angles or range_max are not finite numbers above zero")
    around = abs(message.angle_increment) * (len(ranges) - 1)
    if around > MOST_RAD or (len(ranges) > 1 and around == 0.0):
        raise ConfigError(f"{topic}: a scan of {len(ranges)} ranges, {message.angle_increment:g} rad apart; expected them "
                          "over at most a turn, in radians")
    known = np.where((ranges > 0.0) & ~(ranges < message.range_min), ranges, np.nan)  # 0: many drivers' word for nothing
    if message.angle_increment < 0.0:  # of a scanner whose beams go the other way round
        bearings, known = bearings[::-1], known[::-1]
    # A wall just there is less likely than none, as drivers clip; pointcloud_to_laserscan writes the largest float there is.
    most_m = min(most_m, float(message.range_max), FURTHEST_M)
    return Scan(bearings, np.where(known >= most_m, np.inf, known), most_m)


def say_angles(message, topic: str) -> None:
    """Says so where angle_max is not where the beams end by angle_increment, as in scans that somebody has thinned."""
    beams, step = len(message.ranges), float(message.angle_increment)
    ends, said = message.angle_min + step * (beams - 1), float(message.angle_max)
    if beams > 1 and np.isfinite(said) and abs(said - ends) > max(3.0 * abs(step), OFF * abs(ends - message.angle_min)):
        log.warning("%s: its %d beams, %.4f rad apart, end at %.2f rad, and angle_max says %.2f: angle_increment is "
                    "believed, and if it is wrong so is the map", topic, beams, step, ends, said)


def say_readings(ranges_m: list[np.ndarray], least_m: float, topic: str) -> None:
    """Says so where scans (N,) hold nothing that was measured, or nothing as far as their range_min (least_m)."""
    found = np.concatenate([one[np.isfinite(one) & (one > 0.0)] for one in ranges_m])
    if not len(found):
        log.warning("%s: of its first %d scans no beam met anything (all inf, NaN or 0)", topic, len(ranges_m))
    elif found.max() < least_m:
        log.warning("%s: all readings of its first %d scans (%.2f to %.2f m) are nearer than its range_min, %g m, and so "
                    "unknown: its driver's range_min is wrong; write it right in the bag", topic, len(ranges_m), found.min(),
                    found.max(), least_m)


def ranges_of(message) -> np.ndarray:
    """(N,) metres of a LaserScan; of a MultiEchoLaserScan the first echo of each beam, which drivers make the nearest;
    NaN where it has none, as laser_proc has it."""
    if message.__msgtype__.endswith("MultiEchoLaserScan"):
        return np.array([one.echoes[0] if len(one.echoes) else np.nan for one in message.ranges], float)
    return np.asarray(message.ranges, float)


def pose_of(message, topic: str) -> np.ndarray | None:
    """4x4 pose of an Odometry, PoseStamped, PoseWithCovarianceStamped or TransformStamped; None where it holds NaN or a
    quaternion of zeros, as of what was lost, or has not begun (tf2 ignores such). Raises ConfigError for numbers that are no
    quaternion, as of a heading written into one."""
    if hasattr(message, "transform"):
        place, turn = message.transform.translation, message.transform.rotation
    else:
        pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
        place, turn = pose.position, pose.orientation
    position, quaternion = np.array([place.x, place.y, place.z]), np.array([turn.x, turn.y, turn.z, turn.w])
    length = float(np.linalg.norm(quaternion))
    if not np.isfinite([*position, length]).all() or length == 0.0:
        return None
    if abs(length - 1.0) > UNIT:
        raise ConfigError(f"{topic}: quaternion {quaternion.tolist()} is {length:.3g} long; expected a unit quaternion (a "
                          "heading is written as z = sin(yaw / 2), w = cos(yaw / 2))")
    return se3(rotation_of_quaternion(quaternion), position)


def cloud_depth(message, topic: str, camera: Camera, *, max_depth_m: float,
                camera_from_cloud: np.ndarray | None = None) -> np.ndarray:
    """(H, W) float32 metres of a PointCloud2, whose frame is the camera's optical one or stands to it as given: organised as
    it is where the frames are one, else the nearest point that falls on each pixel."""
    points, _ = points_of(message, topic)
    count = len(points)
    elsewhere = camera_from_cloud is not None and not np.allclose(camera_from_cloud, np.eye(4), atol=1e-6)
    if camera_from_cloud is not None and elsewhere:
        points = transform(camera_from_cloud, points)
    with np.errstate(invalid="ignore"):
        good = np.isfinite(points).all(axis=1) & (points[:, 2] > 0) & (points[:, 2] <= max_depth_m)
    organised = (message.height, message.width) == (camera.height, camera.width) and count == camera.height * camera.width
    if organised and not elsewhere:
        return np.where(good, points[:, 2], np.nan).reshape(camera.height, camera.width).astype(np.float32)
    points = points[good]
    pixels = np.rint(camera.project(points))
    inside = (pixels >= 0).all(axis=1) & (pixels[:, 0] < camera.width) & (pixels[:, 1] < camera.height)
    depth = np.full((camera.height, camera.width), np.inf, np.float32)
    u, v = pixels[inside].astype(int).T
    np.minimum.at(depth, (v, u), points[inside, 2].astype(np.float32))
    return np.where(np.isfinite(depth), depth, np.float32(np.nan))


def points_of(message, topic: str) -> tuple[np.ndarray, np.ndarray | None]:
    """(N, 3) points of a PointCloud2 or of Livox's CustomMsg as it has them, in its own frame, unknown ones NaN; and the
    time of each as it stands there (N,), or None where it has none."""
    if hasattr(message, "points"):  # nanoseconds after the header's stamp (livox_ros_driver2, CustomPoint.msg)
        table = np.array([(p.x, p.y, p.z, p.offset_time) for p in message.points], float).reshape(-1, 4)
        table[~table[:, :3].any(axis=1), :3] = np.nan
        return table[:, :3], table[:, 3]
    fields = {f.name: f for f in message.fields}
    if not {"x", "y", "z"} <= set(fields) or any(fields[n].datatype not in FLOATS for n in "xyz"):
        raise ConfigError(f"{topic}: the cloud has fields {', '.join(fields)}; expected x, y, z as floats")
    timed = [name for name in TIME_FIELDS if name in fields and fields[name].datatype in NUMBERS][:1]
    names = [*"xyz", *timed]
    order = ">" if message.is_bigendian else "<"
    kind = np.dtype({"names": names, "formats": [order + NUMBERS[fields[n].datatype] for n in names],
                     "offsets": [fields[n].offset for n in names], "itemsize": message.point_step})
    data, row = np.asarray(message.data, np.uint8), int(message.width) * int(message.point_step)
    if 0 < row < message.row_step and len(data) >= message.row_step * message.height:  # rows that end in padding
        data = data[: message.row_step * message.height].reshape(message.height, message.row_step)[:, :row]
    table = np.frombuffer(data.tobytes(), kind, data.size // max(message.point_step, 1))
    points = np.stack([table[n] for n in "xyz"], axis=1).astype(float)
    points[~points.any(axis=1)] = np.nan  # at the scanner itself: what drivers write of a beam that met nothing
    return points, table[timed[0]].astype(float) if timed else None


def _rows(message, kind: np.dtype, channels: int, topic: str) -> np.ndarray:
    """(H, W, channels) pixels of a raw Image, its row padding and byte order taken care of."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    least = width * channels * kind.itemsize
    if not 0 < height * width <= MOST_PIXELS or step < least or len(message.data) < step * (height - 1) + least:
        held = len(message.data)
        raise UnreadableImage(f"{topic}: an image says {width}x{height}, {step} bytes a row, but holds {held} bytes")
    data = np.asarray(message.data, np.uint8)
    if len(data) < step * height:
        data = np.concatenate([data, np.zeros(step * height - len(data), np.uint8)])
    raw = np.ascontiguousarray(data[: step * height].reshape(height, step)[:, :least])
    kind = kind.newbyteorder(">" if message.is_bigendian else "<")
    return raw.view(kind).astype(kind.newbyteorder("=")).reshape(height, width, channels)


def _decoded(data, topic: str, *, color: bool) -> np.ndarray:
    import cv2

    check_size(bytes(data[:HEAD_BYTES]), topic)
    image = cv2.imdecode(np.asarray(data, np.uint8), cv2.IMREAD_COLOR_RGB if color else cv2.IMREAD_UNCHANGED)
    if image is None:
        raise UnreadableImage(f"{topic}: {len(data)} compressed bytes are no image; expected JPEG or PNG")
    return image


def _compressed_depth(message, topic: str, *, scale: float, max_depth_m: float) -> np.ndarray:
    """image_transport's compressedDepth: 12 bytes before a 16-bit PNG or RVL; 32FC1 is kept as quantised inverse depth."""
    data = np.asarray(message.data, np.uint8)
    if "compressedDepth" not in message.format:
        return _in_metres(_decoded(data, topic, color=False), topic, scale=scale, max_depth_m=max_depth_m)
    if len(data) < 12:
        raise UnreadableImage(f"{topic}: {len(data)} bytes of compressed depth; expected 12 of a header and more")
    _, a, b = struct.unpack("<iff", data[:12].tobytes())
    rvl = "rvl" in message.format.lower()
    raw = unpacked_rvl(data[12:], topic) if rvl else _decoded(data[12:], topic, color=False)
    if message.format.startswith("32FC1") and raw.dtype == np.uint16:
        with np.errstate(divide="ignore"):
            raw = np.where(raw > 0, a / (raw.astype(np.float32) - b), np.nan).astype(np.float32)
    return _in_metres(raw, topic, scale=scale, max_depth_m=max_depth_m)


def _in_metres(raw: np.ndarray, topic: str, *, scale: float, max_depth_m: float) -> np.ndarray:
    default = 1000.0 if raw.dtype == np.uint16 else 1.0
    return metres(raw, scale=scale or default, max_depth_m=max_depth_m, where=topic)
