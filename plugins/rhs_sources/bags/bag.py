"""ROS 2 bags (mcap, sqlite3) and ROS 1 bags, read by `rosbags`: images, depth, clouds, scans, wheels and true poses."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import BODY_FROM_OPTICAL, Camera, inverse, planar, se3
from rhs.api.records import Capture
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE, camera_numbers

from ..carmen.log import NO_CAMERA, check_unit, end_of_range
from ..folders.clouds import check_solid
from ..replay_cameras import chosen_camera
from ..replay_images import UnreadableImage, check_depth, check_pair
from ..replay_mounts import Mounts, links_of, mount_of, mounted, optical, say_apart, tf_topics
from ..replay_register import DepthCamera, typed_depth_camera
from ..replay_stamps import cloud_extras
from ..replay_tum import SET_BACK, UNREADABLE, Recording
from . import messages as ros
from . import realsense
from .cut import as_taken
from .depth import color_from, depth_camera_of
from .files import opened
from .held import encodings_in, topics_in
from .own_frame import check_scanners_own, own_place, place_in_frame
from .pairs import right_camera
from .topics import Topics, choose_topics, true_odometry
from .truth import read_truth
from .turning import Turning, turning_in
from .wheels import beside_wheels, odometry_in_tf, wheel_readings

LOOKED_AT, NEARLY = 500, 0.9  # scans that show how the laser says that it met nothing; least share of its range_max
DESKEWED = ("deskew", "undistort", "compensated")  # in the names of topics
BACK_S = 1.0  # further back than messages overtake one another
WAITING = 100  # images of one kind kept while their partner has not come yet; a bound on memory


def open_bag(path: Path, settings) -> Recording:
    """The views of a bag: paired colour and depth, or scans when there are no images."""
    reader = opened(path)
    try:
        found = topics_in(reader)
        topics = choose_topics(found, settings, str(path), encodings_in(reader, found))
        if topics.depth and not settings.depth_scale:
            settings = replace(settings, depth_scale=realsense.depth_scale(reader, topics.depth))
        links, moving = links_of(_transforms(reader, topics.sees))
        topics = _with_wheels(reader, topics, settings, moving)
        placed = _placed(reader, topics, settings, links)
        turning = _turning(reader, topics, settings, placed)
        camera = NO_CAMERA
        if topics.color:
            topics = replace(topics, shift=ros.shift_of(_first(reader, topics.color), topics.color))
            camera = _camera(reader, topics, settings, path, registered=placed.depth is None)
        if topics.color and placed.camera is not None:
            camera = replace(camera, body_from_camera=placed.camera)
        right = right_camera(reader, topics, camera, links, settings) if topics.right else None
        sees = topics.sees
        truth = read_truth(reader, found, settings, sees=(sees, _frame(reader, sees)), body_from_frame=placed.frame
                           if topics.color else placed.cloud if topics.around else placed.scan,
                           links=links, optical=camera.body_from_camera if topics.color else None)
    except BaseException:
        reader.close()
        raise
    counts: Counter = Counter()
    lost: list[str] = []
    stop = settings.start + settings.count * settings.stride if settings.count else None
    found_views = _views(reader, topics, settings, (camera, placed, right), counts, lost)
    if settings.views_late_s:
        found_views = ((capture and replace(capture, stamp_s=capture.stamp_s - settings.views_late_s), reading)
                       for capture, reading in found_views)
    with_wheels = beside_wheels(found_views, waits="wheel" in topics.provide(), for_s=abs(turning.span_s), made=turning.seen)
    views = islice(with_wheels, settings.start, stop, settings.stride)

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
    return Recording(camera, captures(), expected, counts, provides=topics.provide(), lost=lost, right=right)


def _recorded(reader, info: str, images: str) -> Camera | None:
    """The camera of a topic of images, as the first CameraInfo says."""
    if not info:
        return None
    said = _first(reader, info)
    return as_taken(ros.camera_of(said, rectified=ros.is_rectified(images)), said, _first(reader, images), images)


def _recorded_color(reader, topics: Topics, settings) -> Camera | None:
    """The same of colour; None where its lens is not read, and the camera was typed."""
    try:
        return _recorded(reader, topics.info, topics.color)
    except ConfigError:
        if settings.camera == "auto":
            raise
        return None


def _camera(reader, topics: Topics, settings, path: Path, *, registered: bool) -> Camera:
    """The camera: of the user, else of the first CameraInfo; its size checked against the first image."""
    recorded = _recorded_color(reader, topics, settings)
    first = ros.color_of(_first(reader, topics.color), topics.color, topics.shift)
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
    if scans:
        ros.say_angles(scans[0], topic)
        ros.say_readings(ranges, float(scans[0].range_min), topic)
    within = [one[(one > 0.0) & (one < scan.range_max)] for one, scan in zip(ranges, scans, strict=True)]
    check_unit(within, topic)
    end_m = end_of_range(within)
    said_m = float(scans[0].range_max) if scans else np.inf
    return end_m if scans and (NEARLY * said_m <= end_m or said_m == np.inf) else np.inf  # Foxglove's say no range


def _turning(reader, topics: Topics, settings, placed: Placed) -> Turning:
    """How the beams of the laser go round, where its scans are the views and there are wheels to put them right by."""
    if not settings.deskew and topics.sees != topics.scan:
        raise ConfigError("source.deskew=false: the views of this bag are no scans of a laser; leave it out (of a lidar's "
                          "clouds type odometry.deskew=false)")
    asked = settings.deskew and topics.sees == topics.scan and "wheel" in topics.provide()
    return turning_in(reader, topics, placed.scan, placed.most_m) if asked else Turning(0.0, placed.scan, topics.scan)


def _with_wheels(reader, topics: Topics, settings, moving: dict[str, str]) -> Topics:
    """The topics, with the wheels that only tf tells of, unless these are the link that a topic of the truth tells too."""
    true = {(_frame(reader, topic).strip("/"), _frame(reader, topic, moved=True).strip("/"))
            for topic in true_odometry(topics_in(reader), settings)}
    moving = {child: parent for child, parent in moving.items() if (parent, child) not in true}
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
    wheels = _frame(reader, topics.wheel, moved=True) or topics.odometry[1]
    tree = Mounts(links, settings.body_frame, wheels=wheels)
    say_apart(topics.wheel, wheels, tree)

    def of(topic: str) -> np.ndarray | None:
        frame = _frame(reader, topic)
        found = tree.of(frame, to_the_end=topic in (topics.scan, topics.around)) if frame else None
        if topic in (topics.scan, topics.around) and topic and (own_m := own_place(reader, topic)) is not None:
            found = own_m if found is None else found @ own_m
        if found is None and settings.body_frame and frame:
            raise ConfigError(f"source.body_frame={settings.body_frame}: no fixed tf links join it to {frame}; found "
                              f"{tree.listed()}")
        return found

    if topics.around:
        check_solid(ros.points_of(_first(reader, topics.around), topics.around)[0], topics.around)
        own = typed_scan is None and check_scanners_own(reader, topics, _frame(reader, topics.around))
        return Placed(None, None, typed_scan if typed_scan is not None else of(topics.around) if own else None)
    scan = of(topics.scan) if typed_scan is None else typed_scan
    frame = of(topics.color) if typed_camera is None else typed_camera @ se3(BODY_FROM_OPTICAL, np.zeros(3))
    camera = optical(frame, _frame(reader, topics.color)) if typed_camera is None else frame
    cloud = None
    if topics.cloud and topics.color:
        cloud = color_from((_frame(reader, topics.color), _frame(reader, topics.cloud)), links, topics.cloud)
        cloud = cloud if (own_m := own_place(reader, topics.cloud)) is None else cloud @ own_m
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
    cameras = _recorded_color(reader, topics, settings), _recorded(reader, topics.depth_info, topics.depth)
    told, own = realsense.first_from_second(reader, topics.color, topics.depth), cameras[1] or cameras[0]
    if told is not None and own is not None:
        return DepthCamera(own.fx, own.fy, own.cx, own.cy, told, own.distortion)
    return depth_camera_of(frames, links, cameras, topics.depth)


def _transforms(reader, sensor: str) -> Iterator:
    """(child, parent, parent_from_child, is static) of a bag's tf, the static ones first."""
    for topic, static in tf_topics(reader.topics, sensor):
        for _, _, message in ros.messages(reader, [c for c in reader.connections if c.topic == topic]):
            for t in message.transforms:
                child, parent = t.child_frame_id.strip("/"), t.header.frame_id.strip("/")
                if (pose := ros.pose_of(t, topic)) is not None:
                    yield child, parent, pose, static


def _frame(reader, topic: str, *, moved: bool = False) -> str:
    """The frame of a topic's first message; moved: the one whose motion wheels tell. Empty without a topic."""
    message = _first(reader, topic) if topic else None
    return "" if message is None else str(message.child_frame_id if moved else message.header.frame_id)


def _in_turn(reader, topics: Topics, settings, counts: Counter, lost: list[str]) -> Iterator:
    """(topic, stamp, message) of what is used, in order; of each topic but tf without messages of another frame than its
    first, and those whose stamps do not ascend, which are counted."""
    last: dict[str, float] = {}
    frames: dict[str, tuple[str, tuple[float, ...]]] = {}
    coarse = ros.coarse_topics(reader, {topics.sees, topics.depth} - {""})
    for topic, stamp, message in _as_far_as_it_goes(ros.stamped(reader, topics.used(), coarse), lost):
        if topic != topics.tf:
            frame = message.header.frame_id, place_in_frame(message)
            if frames.setdefault(topic, frame) != frame:
                counts["other_frame"] += 1  # a second sensor on one topic, or one that was moved
                continue
            if not stamp > last.get(topic, -np.inf):
                back_s = last[topic] - stamp
                far = topic == topics.sees and back_s > BACK_S
                counts[SET_BACK if far else "backward" if back_s else "duplicate"] += 1
                if far:
                    lost[:1] = [f"{counts[SET_BACK]} views are of a clock that was set back and left out: cut the bag "
                                "there, and give each part"]
                continue
            if topic == topics.sees and stamp - last.get(topic, stamp) > settings.max_jump_s:
                counts["jump"] += 1
            last[topic] = stamp
        yield topic, stamp, message


def _views(reader, topics: Topics, settings, seen_by: tuple[Camera, Placed, Camera | None], counts: Counter,
           lost: list[str]) -> Iterator:
    """(Capture without number, None) as soon as all of a view is there, and (None, (stamp, pose)) of the wheels; views whose
    images cannot be read are left out and said to be lost."""
    placed, scan = seen_by[1], None
    waiting: dict[str, deque] = {topics.color: deque(), topics.beside: deque()}
    for topic, stamp, message in _in_turn(reader, topics, settings, counts, lost):
        if topic in (topics.wheel, topics.tf):
            readings = [(None, reading) for reading in wheel_readings(message, stamp, topics, topic)]
            if not readings and topic != topics.tf:  # which moves other links too
                counts["no_pose"] += 1
            yield from readings
        elif topic == topics.scan and len(message.ranges) == 0:
            counts["empty"] += 1
        elif topic == topics.scan == topics.sees:
            try:
                scan = ros.scan_of(message, topic, placed.most_m)
            except ConfigError as error:
                if scan is None:
                    raise
                _lose(error, counts, lost)
                continue
            yield Capture(0, stamp, scan=scan, sensed=True), None
        elif topic == topics.scan:
            scan = mounted(ros.scan_of(message, topic, placed.most_m), placed.scan, topic)
        elif topic == topics.around:
            yield Capture(0, stamp, scan=scan, sensed=True, extras=_cloud(message, topic, stamp, placed)), None
        else:
            waiting[topic].append((stamp, message))
            for pair in _paired(waiting, topics, settings, counts):
                try:
                    seen = _seen(pair, topics, settings, seen_by, scan)
                except ConfigError as error:  # the first images were read before
                    _lose(error, counts, lost)
                    continue
                yield seen, None


def _lose(error: ConfigError, counts: Counter, lost: list[str]) -> None:
    """A view that cannot be read is left out, and that is said."""
    counts[UNREADABLE] += 1
    lost[:1] = [f"{counts[UNREADABLE]} views cannot be read, the last: {error}"]


def _as_far_as_it_goes(messages: Iterator, lost: list[str]) -> Iterator:
    """The messages of a bag, up to where it cannot be read further; that is said to be lost."""
    try:
        yield from messages
    except ros.UnreadableBag as error:
        lost.append(str(error))


def _paired(waiting: dict[str, deque], topics: Topics, settings, counts: Counter) -> Iterator:
    """Colour and depth messages that belong together, oldest first; those that never will are counted."""
    colors = waiting[topics.color]
    deep = topics.beside
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


def _seen(pair, topics: Topics, settings, seen_by: tuple[Camera, Placed, Camera | None], scan) -> Capture:
    (stamp, color), deep = pair
    camera, placed, second = seen_by
    beside: dict[str, np.ndarray] = {}
    image = ros.color_of(color, topics.color, topics.shift)
    if image.shape[:2] != (camera.height, camera.width):
        raise UnreadableImage(f"{topics.color}: found {image.shape[1]}x{image.shape[0]} pixels; expected "
                              f"{camera.width}x{camera.height} as in the first view")
    depth = None
    if second is not None:
        beside = {RIGHT_CAMERA: camera_numbers(second), RIGHT_IMAGE: ros.color_of(deep[1], topics.right, topics.shift)}
    elif deep is not None and topics.depth:
        depth = ros.depth_of(deep[1], topics.depth, scale=settings.depth_scale, max_depth_m=settings.max_depth_m)
        depth = depth if placed.depth is None else placed.depth.registered(depth, camera)
    elif deep is not None:
        depth = ros.cloud_depth(deep[1], topics.cloud, camera, max_depth_m=settings.max_depth_m,
                                camera_from_cloud=placed.cloud)
    if depth is not None:
        check_pair(image, depth, f"{topics.color} and {topics.depth or topics.cloud}")
    return Capture(0, stamp, image=image, depth=depth, scan=scan, sensed=True, extras=beside)


def _cloud(message, topic: str, stamp_s: float, placed: Placed) -> dict[str, np.ndarray]:
    """Its finite points in the body frame, and their times if it has them, unless its topic says that it is deskewed."""
    points, times = ros.points_of(message, topic)
    finite = np.isfinite(points).all(axis=1)
    times = None if times is None or any(word in topic.lower() for word in DESKEWED) else times[finite]
    return cloud_extras(points[finite], times, stamp_s, placed.cloud)


def _with(capture: Capture, index: int, travel) -> Capture:
    return replace(capture, index=index, travel=travel)

