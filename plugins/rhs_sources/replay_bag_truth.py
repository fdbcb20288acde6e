"""True poses in a bag: a topic of poses, or the tf tree of a motion-capture system. Only where the user names them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import Camera, inverse

from . import replay_bag_messages as ros
from .replay_stamps import Truth, ascending


@dataclass(frozen=True, eq=False)
class BagTruth:
    """Poses of frames along a chain world <- ... <- body, each at its own stamps; body_from_last 4x4 ends it."""

    chain: tuple[Truth, ...]
    last_from_body: np.ndarray

    def of_body(self, stamp_s: float) -> np.ndarray | None:
        """World_from_body at a stamp; None where a link of the chain is unknown."""
        if not self.chain:
            return None
        pose = np.eye(4)
        for link in self.chain:
            step = link.at(stamp_s)
            if step is None:
                return None
            pose = pose @ step
        return pose @ self.last_from_body


NO_TRUTH = BagTruth((), np.eye(4))


def read_truth(reader, found: dict[str, str], settings, camera: Camera) -> BagTruth:
    """The truth the user named by source.truth_topic (poses of the body) or source.truth_frame (tf to the camera)."""
    if settings.truth_topic:
        if settings.truth_topic not in found:
            listed = ", ".join(sorted(found)) or "no topic at all"
            raise ConfigError(f"{settings.path}: no topic {settings.truth_topic}; found {listed}")
        poses = [(ros.stamp_of(m), ros.pose_of(m, settings.truth_topic)) for m in _read(reader, {settings.truth_topic})]
        return BagTruth((_track(poses, settings),), np.eye(4))
    if settings.truth_frame:
        return BagTruth(_from_tf(reader, settings), inverse(camera.body_from_camera))
    return NO_TRUTH


def _read(reader, topics: set[str]):
    chosen = [c for c in reader.connections if c.topic in topics]
    for connection, _, raw in reader.messages(connections=chosen):
        yield reader.deserialize(raw, connection.msgtype)


def _track(poses: list[tuple[float, np.ndarray]], settings) -> Truth:
    poses = sorted(poses, key=lambda item: item[0])
    kept, rejected = ascending([stamp for stamp, _ in poses], settings.max_jump_s)
    stamps = np.array([poses[i][0] for i in kept])
    return Truth(stamps, np.array([poses[i][1] for i in kept]).reshape(-1, 4, 4), settings.max_truth_gap_s, rejected)


class _Fixed(Truth):
    """A pose that never changes."""

    def at(self, stamp_s: float) -> np.ndarray | None:
        return self.poses[0]


def _from_tf(reader, settings) -> tuple[Truth, ...]:
    """The chain of transforms from the fixed frame down to the frame of the colour images."""
    links: dict[str, tuple[str, list]] = {}
    fixed: set[str] = set()
    for topic in ("/tf", "/tf_static"):
        for message in _read(reader, {topic}):
            for t in message.transforms:
                child, parent = t.child_frame_id.strip("/"), t.header.frame_id.strip("/")
                links.setdefault(child, (parent, []))[1].append((ros.stamp_of(t), ros.pose_of(t, topic)))
                if topic == "/tf_static":
                    fixed.add(child)
    frame, wanted = _camera_frame(reader, settings), settings.truth_frame.strip("/")
    chain: list[Truth] = []
    while frame != wanted:
        if frame not in links or len(chain) > 50:
            known = ", ".join(sorted(set(links) | {p for p, _ in links.values()})) or "no tf at all"
            raise ConfigError(f"{settings.path}: no tf chain from {wanted} to the camera; found {known}")
        parent, poses = links[frame]
        track = _track(poses, settings)
        chain.insert(0, _Fixed(track.stamps_s, track.poses, 0.0) if frame in fixed else track)
        frame = parent
    return tuple(chain)


def _camera_frame(reader, settings) -> str:
    images = [c for c in reader.connections if c.msgtype.endswith("Image") and "depth" not in c.topic
              and settings.color_topic in ("", c.topic)]
    message = next(_read(reader, {images[0].topic}), None) if images else None
    return message.header.frame_id.strip("/") if message is not None else ""
