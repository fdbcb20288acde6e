"""True poses of a bag: a topic of poses, the tf tree of a motion-capture system, or a file beside it (Newer College, M2DGR).
Only where the user names them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rhs.api.errors import ConfigError
from rhs.api.geometry import inverse

from ..replay_mounts import Mounts, tf_topics
from ..replay_stamps import Truth, ascending, typed_truth
from . import messages as ros


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


POSES = ("Odometry", "PoseStamped", "PoseWithCovarianceStamped", "TransformStamped")
CAMERA = "camera"  # of source.truth_of: the axes of the colour camera, right, down and ahead
MOST_LINKS = 50
NO_TRUTH = BagTruth((), np.eye(4))


def read_truth(reader, found: dict[str, str], settings, *, sees: tuple[str, str],
               body_from_frame: np.ndarray | None, links: dict, optical: np.ndarray | None) -> BagTruth:
    """The truth the user named by source.truth or source.truth_topic (poses of the body, or of source.truth_of) or
    source.truth_frame (tf down to the frame of the images, clouds or scans, `sees` their topic and it, which sits at the
    body where nothing is said). links: of tf that stand still; optical: 4x4 body_from_camera of the colour camera."""
    named = [f"source.{name}" for name in ("truth", "truth_topic", "truth_frame") if getattr(settings, name)]
    if len(named) > 1:
        raise ConfigError(f"{settings.path}: found {' and '.join(named)}; expected one of them")
    if settings.truth_of and (not named or settings.truth_frame):
        raise ConfigError("source.truth_of: expected with source.truth=FILE or source.truth_topic=NAME, whose poses are of "
                          "that frame; leave it out")
    frame = _posed(settings, sees[1], body_from_frame, links, optical)
    if (truth := typed_truth(settings)) is not None:
        return BagTruth((truth,), inverse(frame))
    if settings.truth_topic:
        topic, known = settings.truth_topic, sorted(t for t, kind in found.items() if kind.rsplit("/", 1)[-1] in POSES)
        if topic not in known:
            kind = f"{topic} holds {found[topic].rsplit('/', 1)[-1]}" if topic in found else f"no topic {topic}"
            raise ConfigError(f"{settings.path}: {kind}; found {', '.join(known) or 'no topic'} with true poses "
                              f"({', '.join(POSES)})")
        poses = [(stamp, pose) for _, stamp, message in ros.stamped(reader, [topic])
                 if (pose := ros.pose_of(message, topic)) is not None]
        return BagTruth((_track(poses, settings),), inverse(frame))
    if settings.truth_frame:
        return BagTruth(_from_tf(reader, settings, *sees),
                        np.eye(4) if body_from_frame is None else inverse(body_from_frame))
    return NO_TRUTH


def _posed(settings, sensor: str, body_from_sensor: np.ndarray | None, links: dict,
           optical: np.ndarray | None) -> np.ndarray:
    """4x4 body_from_frame of the frame that true poses are of. Raises ConfigError where nothing joins it to the sensor's."""
    wanted, here = settings.truth_of.strip("/"), np.eye(4) if body_from_sensor is None else body_from_sensor
    if not wanted:
        return np.eye(4)
    if wanted == CAMERA and optical is not None:
        return optical
    place = here if wanted == sensor.strip("/") else Mounts(links, sensor).of(wanted)
    if place is None:
        raise ConfigError(f"source.truth_of={wanted}: no fixed tf links join it to {sensor or 'the sensor'}; found "
                          f"{Mounts(links).listed()}{'' if optical is None else '; or type camera, for its own axes'}")
    return here if place is here else here @ place


def _track(poses: list[tuple[float, np.ndarray]], settings) -> Truth:
    poses = sorted(poses, key=lambda item: item[0])
    kept, rejected = ascending([stamp for stamp, _ in poses], settings.max_jump_s)
    stamps = np.array([poses[i][0] for i in kept])
    return Truth(stamps, np.array([poses[i][1] for i in kept]).reshape(-1, 4, 4), settings.max_truth_gap_s, rejected)


class _Fixed(Truth):
    """A pose that never changes."""

    def at(self, stamp_s: float) -> np.ndarray | None:
        return self.poses[0]


def _from_tf(reader, settings, sensor: str, frame: str) -> tuple[Truth, ...]:
    """The chain of transforms from the fixed frame down to that of a sensor, whose topic is named."""
    frame = frame.strip("/")
    links: dict[tuple[str, str], list] = {}  # (child, parent): a frame may have several, of odometry and of motion capture
    fixed: set[tuple[str, str]] = set()
    for topic, static in tf_topics(reader.topics, sensor):
        for _, arrived_s, message in ros.stamped(reader, [topic]):
            for t in message.transforms:
                link = t.child_frame_id.strip("/"), t.header.frame_id.strip("/")
                if (pose := ros.pose_of(t, topic)) is not None:
                    links.setdefault(link, []).append((ros.stamp_of(t) or arrived_s, pose))
                if static:
                    fixed.add(link)
    wanted = settings.truth_frame.strip("/")
    ways: dict[str, tuple[tuple[str, str], ...]] = {frame: ()}  # the links that lead up to each from the frame
    for _ in range(MOST_LINKS):
        ways = {parent: (*ways[child], (child, parent)) for child, parent in links if child in ways} | ways
    if wanted not in ways:
        known = ", ".join(sorted({name for link in links for name in link})) or "no tf at all"
        raise ConfigError(f"{settings.path}: no tf chain from {wanted} to {frame or 'the sensor'}; found {known}")
    tracks = [(link, _track(links[link], settings)) for link in reversed(ways[wanted])]
    return tuple(_Fixed(track.stamps_s, track.poses, 0.0) if link in fixed else track for link, track in tracks)
