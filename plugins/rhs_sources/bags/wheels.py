"""Wheels of a bag: where no topic has them, tf's odom -> base_link (REP 105); each view gets their pose at its stamp."""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import chain

import numpy as np

from rhs.api.records import Capture

from ..replay_stamps import between
from . import messages as ros

log = logging.getLogger("rhs.replay")
SAME_CLOCK_S = 1.0  # a view that is older than all wheels by less was taken as they began
LATE = 20  # views that wait for a reading of the wheels
KEPT = 100  # readings
ODOMS = ("odom", "odom_combined")  # REP 105; robot_pose_ekf's (PR2)
Made = Callable[[Capture, Sequence[tuple[float, np.ndarray]]], Capture]


def odometry_in_tf(moving: dict[str, str], truth_frame: str) -> tuple[str, str] | None:
    """(parent, child) of the link that a robot's odometry moves, said once; None where there is none, or it is the truth.
    moving: child -> parent of the links that move."""
    found = [(parent, child) for child, parent in sorted(moving.items(), reverse=True)  # base_link before base_footprint
             if parent.split("/")[-1] in ODOMS and child.split("/")[-1].startswith("base")]
    found = [link for link in found if link[0] != truth_frame.strip("/")]
    if not found:
        return None
    log.warning("no Odometry is in the bag: taken for the wheels is %s -> %s of tf (source.wheel_topic=none goes without)",
                *found[0])
    return found[0]


def readings_in_tf(message, link: tuple[str, str], topic: str) -> Iterator[tuple[float, np.ndarray]]:
    """(stamp, 4x4 parent_from_child) of a link in a message of tf."""
    for one in message.transforms:
        if (one.header.frame_id.strip("/"), one.child_frame_id.strip("/")) == link:
            if (pose := ros.pose_of(one, topic)) is not None:
                yield ros.stamp_of(one), pose


def wheel_readings(message, stamp_s: float, topics, topic: str) -> Iterator[tuple[float, np.ndarray]]:
    """(stamp, 4x4 pose) of the wheels in a message of their topic, or of tf where that has them; nothing of one
    without a pose."""
    if topic == topics.tf:
        yield from readings_in_tf(message, topics.odometry, topic)
    elif (pose := ros.pose_of(message, topic)) is not None:
        yield stamp_s, pose


def first_with_wheels(reader, topic: str, topics, most: int) -> tuple[list, list[tuple[float, np.ndarray]]]:
    """(stamp, message) of the first messages of a topic, `most` of them, and (stamp, 4x4 pose) of the wheels until then."""
    found: list = []
    wheels: list[tuple[float, np.ndarray]] = []
    for name, stamp, message in ros.stamped(reader, {topic, topics.wheel or topics.tf}):
        if name != topic:
            wheels += [one for one in wheel_readings(message, stamp, topics, name) if not wheels or one[0] > wheels[-1][0]]
        elif not found or stamp > found[-1][0]:
            found.append((stamp, message))
        if len(found) == most:
            break
    return found, wheels


def beside_wheels(found: Iterator, *, waits: bool, for_s: float = 0.0,
                  made: Made = lambda capture, wheels: capture) -> Iterator:
    """(Capture, pose of the wheels when it was taken or None) of views and wheels as a bag holds them. waits: a view stands
    back for the first reading after it (for_s: so much later), for as long as LATE views, so that it lies between two.
    made: what makes the view of it and the (stamp, pose) of the wheels about it."""
    wheels: deque = deque(maxlen=KEPT)  # (stamp, pose)
    views: deque = deque()  # and the last pose that came before each
    for capture, reading in chain(found, [(None, None)]):
        if reading is not None:
            if not wheels or reading[0] > wheels[-1][0]:
                wheels.append(reading)
        elif capture is not None:
            views.append((capture, wheels[-1][1] if wheels else None))
        over = capture is None and reading is None
        while views and (over or not waits or len(views) > LATE
                         or (wheels and wheels[-1][0] >= views[0][0].stamp_s + for_s)):
            capture, last = views.popleft()
            yield made(capture, wheels), _wheel_at(wheels, capture.stamp_s, last)


def _wheel_at(wheels: deque, stamp_s: float, last: np.ndarray | None) -> np.ndarray | None:
    """The pose of the wheels when a view was taken; the last one that came where its stamp is not among theirs (another
    clock, or the end); None before the first."""
    after = next((k for k, (stamp, _) in enumerate(wheels) if stamp >= stamp_s), 0)
    if after == 0:
        began = bool(wheels) and last is not None and 0.0 <= wheels[0][0] - stamp_s < SAME_CLOCK_S
        return wheels[0][1] if began else last
    (begin, first), (end, second) = wheels[after - 1], wheels[after]
    return between(first, second, (stamp_s - begin) / (end - begin))
