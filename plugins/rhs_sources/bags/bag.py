"""ROS 2 bags (mcap, sqlite3) and ROS 1 bags, read by `rosbags`: images, depth, clouds, scans, wheels and true poses."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from os.path import commonprefix
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, inverse, planar, se3
from rhs.api.records import Capture

from ..carmen.log import NO_CAMERA, end_of_range
from ..replay_cameras import chosen_camera
from ..replay_images import UnreadableImage, check_depth, check_pair
from ..replay_mounts import Mounts, check_scanners_own, links_of, mount_of, mounted, optical, tf_topics
from ..replay_register import DepthCamera, typed_depth_camera
from ..replay_stamps import cloud_extras
from ..replay_tum import UNREADABLE, Recording
from . import messages as ros
from .depth import SAID_REGISTERED, color_from, depth_camera_of
from .files import opened
from .truth import read_truth
from .wheels import beside_wheels, odometry_in_tf, readings_in_tf

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
LOOKED_AT, NEARLY = 500, 0.9  # scans that show how the laser says that it met nothing; least share of its range_max
NEITHER = ("disparity", "confidence")  # in the names of images that are neither colour nor metres
DESKEWED = ("deskew", "undistort", "compensated")  # in the names of topics
WAITING = 100  # images of one kind kept while their partner has not come yet; a bound on memory


@dataclass(frozen=True)
class Topics:
    """The topics of a bag that are used; empty when there is none."""

    color: str = ""
    depth: str = ""
    cloud: str = ""
    info: str = ""
    scan: str = ""
    wheel: str = ""
    depth_info: str = ""
    tf: str = ""
    odometry: tuple[str, str] = ("", "")  # parent and child of the wheels' link in tf, where no topic has them

    def provide(self) -> frozenset[str]:
        """What the views will hold, in the words of a part's needs."""
        held = {"image": self.color, "gray": self.color, "depth": self.depth or (self.cloud if self.color else ""),
                "scan": self.scan, "wheel": self.wheel or self.tf, "cloud": self.around}
        return frozenset(word for word, topic in held.items() if topic)

    @property
    def around(self) -> str:
        """The topic of a lidar: clouds that no camera goes with."""
        return "" if self.color else self.cloud

    @property
    def sees(self) -> str:
        """The topic whose messages are the views."""
        return self.color or self.around or self.scan

    def used(self) -> set[str]:
        return {t for t in (self.color, self.depth, self.cloud, self.scan, self.wheel, self.tf) if t}


def open_bag(path: Path, settings) -> Recording:
    """The views of a bag: paired colour and depth, or scans when there are no images."""
    reader = opened(path)
    try:
        counted = any(info.msgcount for info in reader.topics.values())  # recorders list topics that they never heard
        found = {topic: info.msgtype for topic, info in reader.topics.items() if info.msgcount or not counted}
        topics = choose_topics(found, settings, str(path))
        links, moving = links_of(_transforms(reader, topics.sees))
        topics = _with_wheels(reader, topics, settings, moving)
        placed = _placed(reader, topics, settings, links)
        camera = NO_CAMERA
        if topics.color:
            camera = _camera(reader, topics, settings, path, registered=placed.depth is None)
        if topics.color and placed.camera is not None:
            camera = replace(camera, body_from_camera=placed.camera)
        sees = topics.sees
        truth = read_truth(reader, found, settings, sees=(sees, _frame(reader, sees)), body_from_frame=placed.frame
                           if topics.color else placed.cloud if topics.around else placed.scan)
    except BaseException:
        reader.close()
        raise
    counts: Counter = Counter()
    lost: list[str] = []
    stop = settings.start + settings.count * settings.stride if settings.count else None
    found_views = _views(reader, topics, settings, (camera, placed), counts, lost)
    views = islice(beside_wheels(found_views, waits="wheel" in topics.provide()), settings.start, stop, settings.stride)

    def captures():
        wheel_before = None
        try:
            for index, (capture, wheel) in enumerate(views):
                travel = None if wheel is None or wheel_before is None else planar(inverse(wheel_before) @ wheel)
                wheel_before = wheel
                yield _with(capture, index, travel), truth.of_body(capture.stamp_s)
        finally:
            reader.close()

    total = reader.topics[sees].msgcount
    expected = max(0, -(-(total - settings.start) // settings.stride))
    expected = min(expected, settings.count) if settings.count else expected
    return Recording(camera, captures(), expected, counts, provides=topics.provide(), lost=lost)


def choose_topics(found: dict[str, str], settings, where: str) -> Topics:
    """Which of the topics (name -> type) are colour, depth, ...; the user's word first, else the only fitting one."""
    images = [t for t, kind in found.items() if kind in IMAGES and not any(word in t.lower() for word in NEITHER)]
    deep = [t for t in images if "depth" in t.lower()]
    plain = [t for t in images if t not in deep and "/ir" not in t.lower() and "infra" not in t.lower()]

    def pick(name: str, fitting: list[str]) -> str:
        wanted = getattr(settings, f"{name}_topic")
        if wanted == "none":
            return ""
        if wanted and wanted not in found:
            raise ConfigError(f"{where}: no topic {wanted}; found {_listed(found)}")
        return wanted or _best(name, fitting, where)

    def of(*kinds: str) -> list[str]:
        return [t for t, kind in found.items() if kind.rsplit("/", 1)[-1] in kinds]

    alone = {"scans": ("LaserScan", "MultiEchoLaserScan"), "clouds": ("PointCloud2",)}.get(settings.views, ())
    if of(*alone):
        plain, deep = [], []
    color, depth = pick("color", plain), pick("depth", deep)
    scan = pick("scan", of("LaserScan", "MultiEchoLaserScan"))
    scan = "" if settings.views == "clouds" and of(*alone) else scan
    clouds = of("PointCloud2") if not depth and settings.depth_topic != "none" and (color or not scan) else []
    if not color and not scan and len(clouds) > 1:
        raise ConfigError(f"{where}: several clouds ({', '.join(clouds)}); type source.depth_topic=NAME")
    cloud = depth if depth and found[depth].endswith("PointCloud2") else (clouds[0] if len(clouds) == 1 else "")
    depth = "" if cloud == depth else depth
    if not color and not scan and not cloud:
        raise ConfigError(f"{where}: no colour image topic, no LaserScan and no PointCloud2; found {_listed(found)}")
    if color and not depth and not cloud and settings.depth_topic != "none":
        raise ConfigError(f"{where}: no depth topic; found {_listed(found)}; type source.depth_topic=NAME (or none)")
    infos = of("CameraInfo")
    info = pick("info", _beside(color, infos)) if color else ""
    deep = _beside(depth, infos) if depth else []
    return Topics(color, depth, cloud, info, scan, pick("wheel", of("Odometry")), deep[0] if len(deep) == 1 else "")


def _beside(topic: str, infos: list[str]) -> list[str]:
    """Of the topics of CameraInfo those whose names have the most folders in common with a topic's."""
    def shared(info: str) -> int:
        return len(commonprefix([topic.split("/"), info.split("/")]))

    most = max(map(shared, infos), default=0)
    return [info for info in infos if shared(info) == most]


def _best(name: str, fitting: list[str], where: str) -> str:
    """The only fitting topic; of several the one registered to colour, or the raw one of a raw-compressed pair."""
    if len(fitting) > 1:
        better = [t for t in fitting if any(word in t for word in SAID_REGISTERED)] if name == "depth" else []
        raw = [t for t in (better or fitting) if not t.endswith(("/compressed", "/compressedDepth"))]
        fitting = raw or better or fitting
    if len(fitting) > 1:
        raise ConfigError(f"{where}: several {name} topics ({', '.join(fitting)}); type source.{name}_topic=NAME")
    return fitting[0] if fitting else ""


def _listed(found: dict[str, str]) -> str:
    return ", ".join(f"{t} ({kind.rsplit('/', 1)[-1]})" for t, kind in sorted(found.items())) or "no topic at all"


def _recorded(reader, info: str, images: str) -> Camera | None:
    """The camera of a topic of images, as the first CameraInfo says."""
    return ros.camera_of(_first(reader, info), rectified="rect" in images) if info else None


def _camera(reader, topics: Topics, settings, path: Path, *, registered: bool) -> Camera:
    """The camera: of the user, else of the first CameraInfo; its size checked against the first image."""
    recorded = _recorded(reader, topics.info, topics.color)
    first = ros.color_of(_first(reader, topics.color), topics.color)
    camera = chosen_camera(settings.camera, first.shape[1::-1], recorded=recorded, where=path.name)
    if topics.depth:
        for number, (_, _, message) in enumerate(islice(ros.stamped(reader, {topics.depth}), WAITING)):
            depth = ros.depth_of(message, topics.depth, scale=settings.depth_scale, max_depth_m=np.inf)
            if registered and number == 0:
                check_pair(first, depth, f"{topics.color} and {topics.depth}")
            if check_depth(depth, scale=settings.depth_scale or ros.usual_scale(message), where=topics.depth,
                           typed=bool(settings.depth_scale)):
                break  # shows something
    return camera


def _first(reader, topic: str):
    """The first message of a topic; ConfigError when it holds none."""
    found = next(ros.stamped(reader, {topic}), None)
    if found is None:
        raise ConfigError(f"topic {topic} holds no message; expected at least one; type source.*_topic=NAME for another")
    return found[2]


@dataclass(frozen=True, eq=False)
class Placed:
    """Where the sensors sit: 4x4 body_from_scanner, body_from_camera (optical) and camera_from_cloud (of a lidar:
    body_from_cloud); None where nothing is said of it. depth: took the depth images, where it is not the colour camera.
    most_m: reading from which on the laser says that it met nothing. frame: body_from_frame of the frame of the images."""

    scan: np.ndarray | None
    camera: np.ndarray | None
    cloud: np.ndarray | None
    depth: DepthCamera | None = None
    most_m: float = np.inf
    frame: np.ndarray | None = None


def _most_m(reader, topic: str) -> float:
    """The largest reading of a laser, if that stands for nothing and is nearly its range_max: metres, else inf."""
    scans = [message for _, _, message in islice(ros.stamped(reader, {topic}), LOOKED_AT)]
    ranges = [ros.ranges_of(one) for one in scans]
    end_m = end_of_range([one[(one > 0.0) & (one < scan.range_max)] for one, scan in zip(ranges, scans, strict=True)])
    return end_m if scans and NEARLY * scans[0].range_max <= end_m else np.inf


def _with_wheels(reader, topics: Topics, settings, moving: dict[str, str]) -> Topics:
    """The topics, with the wheels that only tf tells of."""
    link = None if topics.wheel or settings.wheel_topic else odometry_in_tf(moving, settings.truth_frame)
    if link is None:
        return topics
    return replace(topics, tf=next(t for t, static in tf_topics(reader.topics, topics.sees) if not static), odometry=link)


def _placed(reader, topics: Topics, settings, links: dict) -> Placed:
    """As typed, else by the tf tree; a frame that was typed as the body's must be in it."""
    typed_scan, typed_camera = (mount_of(getattr(settings, name), name) for name in ("scan_mount", "camera_mount"))
    for typed, name, topic in ((typed_scan, "scan_mount", topics.scan or topics.around),
                               (typed_camera, "camera_mount", topics.color)):
        if typed is not None and not topic:
            raise ConfigError(f"source.{name}: {settings.path} holds nothing that is mounted so; leave it out")
    tree = Mounts(links, settings.body_frame, wheels=_frame(reader, topics.wheel, moved=True) or topics.odometry[1])

    def of(topic: str) -> np.ndarray | None:
        frame = _frame(reader, topic)
        found = tree.of(frame, to_the_end=topic in (topics.scan, topics.around)) if frame else None
        if found is None and settings.body_frame and frame:
            raise ConfigError(f"source.body_frame={settings.body_frame}: no fixed tf links join it to {frame}; found "
                              f"{tree.listed()}")
        return found

    if topics.around:
        if typed_scan is None:
            check_scanners_own(_frame(reader, topics.around), topics.around)
        return Placed(None, None, of(topics.around) if typed_scan is None else typed_scan)
    scan = of(topics.scan) if typed_scan is None else typed_scan
    frame = of(topics.color) if typed_camera is None else typed_camera @ se3(BODY_FROM_OPTICAL, np.zeros(3))
    camera = optical(frame, _frame(reader, topics.color)) if typed_camera is None else frame
    cloud = None
    if topics.cloud and topics.color:
        cloud = color_from((_frame(reader, topics.color), _frame(reader, topics.cloud)), links, topics.cloud)
    most_m = _most_m(reader, topics.scan) if topics.scan else np.inf
    return Placed(scan, camera, cloud, _depth_camera(reader, topics, settings, links), most_m,
                  se3(BODY_FROM_OPTICAL, np.zeros(3)) if frame is None else frame)


def _depth_camera(reader, topics: Topics, settings, links: dict) -> DepthCamera | None:
    """As typed, else as the bag says."""
    typed = typed_depth_camera(settings.depth_camera)
    if typed is not None and not topics.depth:
        raise ConfigError(f"source.depth_camera: {settings.path} holds no depth images; leave it out")
    if typed is not None or not topics.depth:
        return typed
    frames = _frame(reader, topics.color), _frame(reader, topics.depth)
    cameras = _recorded(reader, topics.info, topics.color), _recorded(reader, topics.depth_info, topics.depth)
    return depth_camera_of(frames, links, cameras, topics.depth)


def _transforms(reader, sensor: str) -> Iterator:
    """(child, parent, parent_from_child, is static) of a bag's tf, the static ones first."""
    for topic, static in tf_topics(reader.topics, sensor):
        for _, _, message in ros.messages(reader, [c for c in reader.connections if c.topic == topic]):
            for t in message.transforms:
                child, parent = t.child_frame_id.strip("/"), t.header.frame_id.strip("/")
                yield child, parent, ros.pose_of(t, topic), static


def _frame(reader, topic: str, *, moved: bool = False) -> str:
    """The frame of a topic's first message; moved: the one whose motion wheels tell. Empty without a topic."""
    message = _first(reader, topic) if topic else None
    return "" if message is None else str(message.child_frame_id if moved else message.header.frame_id)


def _views(reader, topics: Topics, settings, seen_by: tuple[Camera, Placed], counts: Counter,
           lost: list[str]) -> Iterator:
    """(Capture without number, None) as soon as all of a view is there, and (None, (stamp, pose)) of the wheels; views whose
    images cannot be read are left out and said to be lost."""
    camera, placed = seen_by
    last: dict[str, float] = {}
    frames: dict[str, str] = {}
    waiting: dict[str, deque] = {topics.color: deque(), topics.depth or topics.cloud: deque()}
    scan = None
    for topic, stamp, message in _as_far_as_it_goes(ros.stamped(reader, topics.used()), lost):
        if topic == topics.tf:
            yield from ((None, reading) for reading in readings_in_tf(message, topics.odometry, topic))
            continue
        if frames.setdefault(topic, message.header.frame_id) != message.header.frame_id:
            counts["other_frame"] += 1  # a second sensor on one topic
            continue
        if not stamp > last.get(topic, -np.inf):
            counts["duplicate" if stamp == last.get(topic) else "backward"] += 1
            continue
        if topic in last and stamp - last[topic] > settings.max_jump_s:
            counts["jump"] += 1
        last[topic] = stamp
        if topic == topics.wheel:
            yield None, (stamp, ros.pose_of(message, topic))
        elif topic == topics.scan and len(message.ranges) == 0:
            counts["empty"] += 1
        elif topic == topics.scan:
            scan = mounted(ros.scan_of(message, topic, placed.most_m), placed.scan, topic)
            if not topics.color and not topics.around:
                yield Capture(0, stamp, scan=scan, sensed=True), None
        elif topic == topics.around:
            yield Capture(0, stamp, scan=scan, sensed=True, extras=_cloud(message, topic, stamp, placed)), None
        else:
            waiting[topic].append((stamp, message))
            for pair in _paired(waiting, topics, settings, counts):
                try:
                    seen = _seen(pair, topics, settings, seen_by, scan)
                except UnreadableImage as error:
                    counts[UNREADABLE] += 1
                    lost[:1] = [f"{counts[UNREADABLE]} views cannot be read, the last: {error}"]
                    continue
                yield seen, None


def _as_far_as_it_goes(messages: Iterator, lost: list[str]) -> Iterator:
    """The messages of a bag, up to where it cannot be read further; that is said to be lost."""
    try:
        yield from messages
    except ros.UnreadableBag as error:
        lost.append(str(error))


def _paired(waiting: dict[str, deque], topics: Topics, settings, counts: Counter) -> Iterator:
    """Colour and depth messages that belong together, oldest first; those that never will are counted."""
    colors = waiting[topics.color]
    deep = topics.depth or topics.cloud
    while not deep and colors:
        yield colors.popleft(), None
    depths = waiting[deep]
    while colors and depths:
        gap = colors[0][0] - depths[0][0]
        closer_color = len(colors) > 1 and abs(colors[1][0] - depths[0][0]) < abs(gap)
        closer_depth = len(depths) > 1 and abs(depths[1][0] - colors[0][0]) < abs(gap)
        if abs(gap) <= settings.max_difference_s + 1e-9 and not closer_color and not closer_depth:
            yield colors.popleft(), depths.popleft()
        else:
            (colors if gap < 0 else depths).popleft()
            counts["unpaired"] += 1
    for queue in (colors, depths):
        while len(queue) > WAITING:
            queue.popleft()
            counts["unpaired"] += 1


def _seen(pair, topics: Topics, settings, seen_by: tuple[Camera, Placed], scan) -> Capture:
    (stamp, color), deep = pair
    camera, placed = seen_by
    image = ros.color_of(color, topics.color)
    if image.shape[:2] != (camera.height, camera.width):
        raise UnreadableImage(f"{topics.color}: found {image.shape[1]}x{image.shape[0]} pixels; expected "
                              f"{camera.width}x{camera.height} as in the first view")
    depth = None
    if deep is not None and topics.depth:
        depth = ros.depth_of(deep[1], topics.depth, scale=settings.depth_scale, max_depth_m=settings.max_depth_m)
        depth = depth if placed.depth is None else placed.depth.registered(depth, camera)
    elif deep is not None:
        depth = ros.cloud_depth(deep[1], topics.cloud, camera, max_depth_m=settings.max_depth_m,
                                camera_from_cloud=placed.cloud)
    if depth is not None:
        check_pair(image, depth, f"{topics.color} and {topics.depth or topics.cloud}")
    return Capture(0, stamp, image=image, depth=depth, scan=scan, sensed=True)


def _cloud(message, topic: str, stamp_s: float, placed: Placed) -> dict[str, np.ndarray]:
    """Its finite points in the body frame, and their times if it has them, unless its topic says that it is deskewed."""
    points, times = ros.points_of(message, topic)
    finite = np.isfinite(points).all(axis=1)
    times = None if times is None or any(word in topic.lower() for word in DESKEWED) else times[finite]
    return cloud_extras(points[finite], times, stamp_s, placed.cloud)


def _with(capture: Capture, index: int, travel) -> Capture:
    return replace(capture, index=index, travel=travel)

