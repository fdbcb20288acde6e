"""Which topics of a bag are colour, depth, clouds, scans and wheels: the user's word first, else the only fitting one."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping
from dataclasses import dataclass
from os.path import commonprefix

from rhs.api.errors import ConfigError
from rhs.api.settings import nearest
from rhs.api.stereo import RIGHT_CAMERA, RIGHT_IMAGE

from ..unread import of_topics
from .depth import SAID_REGISTERED

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
CLOUDS = ("PointCloud2", "CustomMsg")  # the last is Livox's
KINDS = {"color": ("Image", "CompressedImage"), "depth": ("Image", "CompressedImage", *CLOUDS),
         "info": ("CameraInfo",), "scan": ("LaserScan", "MultiEchoLaserScan"), "wheel": ("Odometry",)}  # of typed topics
METRIC, PICTURES = ("16UC1", "32FC1"), ("rgb8", "bgr8", "8UC3", "rgba8", "bgra8")  # encodings of depth; of its pictures
NOTHING: Mapping[str, str] = {}
LEFT = (("left", "right"), ("infra1", "infra2"), ("infrared_1", "infrared_2"), ("cam0", "cam1"), ("cam_0", "cam_1"),
        ("camera0", "camera1"), ("camera_0", "camera_1"), ("fisheye1", "fisheye2"), ("image_0", "image_1"),
        ("cam1", "cam2"))  # in the names of a pair
NEITHER = ("disparity", "confidence")  # in the names of images that are neither colour nor metres
PAINTED = re.compile(r"segment|semantic|instance|label|mask|detect|annotat|overlay|debug", re.I)  # what no camera took
TRUE = re.compile(r"truth|mocap|vicon|optitrack|qualisys|(?<![a-z])gt(?![a-z])", re.I)  # in those of poses not to go by
log = logging.getLogger("rhs.replay")


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
    right: str = ""  # of the second camera of a pair, and its CameraInfo
    right_info: str = ""
    shift: int = 0  # of grey images of 16 bits, down to 8
    odometry: tuple[str, str] = ("", "")  # parent and child of the wheels' link in tf, where no topic has them

    def provide(self) -> frozenset[str]:
        """What the views will hold, in the words of a part's needs."""
        held = {"image": self.color, "gray": self.color, "depth": self.depth or (self.cloud if self.color else ""),
                "scan": self.scan, "wheel": self.wheel or self.tf, "cloud": self.around, RIGHT_IMAGE: self.right,
                RIGHT_CAMERA: self.right}
        return frozenset(word for word, topic in held.items() if topic)

    @property
    def around(self) -> str:
        """The topic of a lidar: clouds that no camera goes with."""
        return "" if self.color else self.cloud

    @property
    def sees(self) -> str:
        """The topic whose messages are the views."""
        return self.color or self.around or self.scan

    @property
    def beside(self) -> str:
        """The topic whose messages go with those of colour."""
        return self.depth or self.cloud or self.right

    def used(self) -> set[str]:
        return {t for t in (self.color, self.depth, self.cloud, self.scan, self.wheel, self.tf, self.right) if t}


def choose_topics(found: dict[str, str], settings, where: str, encodings: Mapping[str, str] = NOTHING) -> Topics:
    """Which of the topics (name -> type) are colour, depth, ...; the user's word first, else the only fitting one.
    encodings: of topics of raw images: depth is called so, or is in metres (OAK's /stereo/image_raw), and no picture."""
    images = [t for t, kind in found.items() if kind in IMAGES and not any(word in t.lower() for word in NEITHER)]
    images = [t for t in images if not ("depth" in t.lower() and encodings.get(t) in PICTURES)]
    deep = [t for t in images if "depth" in t.lower() or encodings.get(t) in METRIC]
    plain = [t for t in images if t not in deep and "/ir" not in t.lower() and "infra" not in t.lower()]

    def pick(name: str, fitting: list[str], beside: str = "") -> str:
        wanted = getattr(settings, f"{name}_topic")
        if wanted == "none":
            return ""
        if wanted and found.get(wanted, "").rsplit("/", 1)[-1] not in KINDS[name]:
            raise ConfigError(f"{where}: {_unfit(name, wanted, found)}")
        return wanted or _best(name, fitting, where, beside)

    def of(*kinds: str) -> list[str]:
        return [t for t, kind in found.items() if kind.rsplit("/", 1)[-1] in kinds]

    wheel = pick("wheel", _no_truth(of("Odometry"), found, settings, where))
    if settings.stereo:
        left, right = _two_eyes(_taken([t for t in images if t not in deep], [], where), settings, where)
        infos, scan = of("CameraInfo"), pick("scan", of(*KINDS["scan"]))
        told = [next(iter(near), "") if len(near := _beside(eye, infos)) == 1 else "" for eye in (left, right)]
        if told[0] == told[1]:  # of one of the two
            told = ["" if eye not in _beside(told[0], [left, right]) else told[0] for eye in (left, right)]
        return Topics(left, info=told[0], scan=scan, wheel=wheel, right=right, right_info=told[1])
    alone = {"scans": ("LaserScan", "MultiEchoLaserScan"), "clouds": CLOUDS}.get(settings.views, ())
    if of(*alone):
        plain, deep = [], []
    color = pick("color", plain if settings.color_topic else _taken(plain, of("CameraInfo"), where))
    depth, scan = pick("depth", [t for t in deep if t != color], color), pick("scan", of(*KINDS["scan"]))
    scan = "" if settings.views == "clouds" and of(*alone) else scan
    clouds = of(*CLOUDS) if not depth and settings.depth_topic != "none" and (color or not scan) else []
    if not color and not scan and len(clouds) > 1:
        raise ConfigError(f"{where}: several clouds; type source.depth_topic=NAME of {', '.join(clouds)}")
    cloud = depth if depth and found[depth].endswith(CLOUDS) else (clouds[0] if len(clouds) == 1 else "")
    depth = "" if cloud == depth else depth
    if not color and not scan and not cloud:
        if seen := [t for t in images if t not in deep]:
            raise ConfigError(f"{where}: no images of colour, but infrared ones; type source.color_topic={seen[0]} to go by "
                              "them")
        raise ConfigError(f"{where}: no colour image topic, no LaserScan and no PointCloud2; found {_listed(found)}"
                          f"{of_topics(found)}")
    if color and not depth and not cloud and settings.depth_topic != "none" and (len(clouds) > 1 or _perhaps_depth(found)):
        raise ConfigError(f"{where}: no depth topic; type source.depth_topic=NAME (or none); found {_listed(found)}")
    infos = of("CameraInfo")
    info = pick("info", infos, color) if color else ""
    deep = _beside(depth, infos) if depth else []
    return Topics(color, depth, cloud, info, scan, wheel, deep[0] if len(deep) == 1 else "")


def _taken(images: list[str], infos: list[str], where: str) -> list[str]:
    """Of several topics of images those that a camera took: no painted ones by their names, and, where some topics have a
    CameraInfo in their own folder, these alone, which is said; all where that leaves none."""
    images = [topic for topic in images if not PAINTED.search(topic)] or images
    folders = {info.rpartition("/")[0] for info in infos}
    own = [topic for topic in images if topic.removesuffix("/compressed").rpartition("/")[0] in folders]
    if own and len(own) < len(images):
        log.warning("%s: of the topics of images %s a CameraInfo goes with %s alone, and the others are left out "
                    "(source.color_topic=NAME)", where, ", ".join(images), ", ".join(own))
    return own or images


def true_odometry(found: Mapping[str, str], settings) -> list[str]:
    """The topics of Odometry that are the truth, as it was typed or as their names say; none that was typed for the
    wheels."""
    return [topic for topic, kind in found.items() if kind.endswith("/Odometry") and topic != settings.wheel_topic
            and (topic == settings.truth_topic or TRUE.search(topic))]


def _no_truth(odometry: list[str], found: dict[str, str], settings, where: str) -> list[str]:
    """Of the topics of Odometry those that may be wheels, what else is left out being said. Raises ConfigError where the
    truth was typed for the wheels."""
    if settings.truth_topic and settings.wheel_topic == settings.truth_topic:
        raise ConfigError(f"{where}: source.wheel_topic and source.truth_topic are both {settings.wheel_topic}: an estimate "
                          "made of the truth says nothing; type source.wheel_topic=none, or the topic of the wheels")
    true = true_odometry(found, settings)
    if true and not settings.truth_topic and not settings.wheel_topic:
        log.warning("%s: by its name the truth, and not taken for wheels (source.truth_topic=%s judges by it, "
                    "source.wheel_topic=%s goes by it)", ", ".join(true), true[0], true[0])
    return [topic for topic in odometry if topic not in true]


def _two_eyes(images: list[str], settings, where: str) -> tuple[str, str]:
    """The topics of a pair of cameras: as they were typed, else the only two that are named alike but for LEFT. Raises
    ConfigError."""
    for name in ("color", "right"):
        if (wanted := getattr(settings, f"{name}_topic")) and wanted not in images:
            raise ConfigError(f"{where}: source.{name}_topic={wanted}{nearest(wanted, images)}; found "
                              f"{', '.join(sorted(images)) or 'no images'}; expected a topic of images")
    pairs = [(one, other) for one in images for left, right in LEFT if left in one.lower()
             for other in images if other != one and other.lower() == one.lower().replace(left, right)]
    pairs = [(left, right) for left, right in pairs if settings.color_topic in ("", left)]
    raw = [pair for pair in pairs if not pair[0].endswith("/compressed")] or pairs
    pairs = [pair for pair in raw if "rect" in pair[0]] or raw  # whose lenses were undone
    if settings.right_topic:
        pairs = [(settings.color_topic or next((left for left, _ in pairs), ""), settings.right_topic)]
    if len(pairs) != 1 or not pairs[0][0] or pairs[0][0] == pairs[0][1]:
        found = f"{len(pairs)} pairs of cameras" if len(pairs) > 1 else "no two cameras named alike (left and right)"
        raise ConfigError(f"{where}: found {found} among {', '.join(sorted(images)) or 'no images'}; type "
                          "source.color_topic=LEFT source.right_topic=RIGHT")
    return pairs[0]


def _perhaps_depth(found: dict[str, str]) -> bool:
    """Whether some topic may hold depth in a form or under a name that is not known."""
    return any(kind.endswith("DisparityImage") or kind in IMAGES and any(word in t.lower() for word in ("depth", *NEITHER))
               for t, kind in found.items())


def _beside(topic: str, others: list[str]) -> list[str]:
    """Of other topics (of CameraInfo, of depth) those whose names have the most folders in common with a topic's."""
    def shared(other: str) -> int:
        return len(commonprefix([topic.split("/"), other.split("/")]))

    most = max(map(shared, others), default=0)
    return [other for other in others if shared(other) == most]


def _unfit(name: str, wanted: str, found: dict[str, str]) -> str:
    """What is wrong with the topic that was typed, and which there are."""
    fitting = [t for t, kind in found.items() if kind.rsplit("/", 1)[-1] in KINDS[name]]
    held = f"{wanted} holds {found[wanted].rsplit('/', 1)[-1]}" if wanted in found else f"no topic {wanted}"
    return (f"{held}{nearest(wanted, fitting)}; found {', '.join(sorted(fitting)) or _listed(found)}; expected "
            f"source.{name}_topic=NAME of {' or '.join(KINDS[name])}")


def _best(name: str, fitting: list[str], where: str, beside: str) -> str:
    """The only fitting topic; of several one registered to colour, of the same camera as the topic `beside`, or the raw one
    of a raw-compressed pair."""
    if name == "depth":
        fitting = [t for t in fitting if any(word in t for word in SAID_REGISTERED)] or fitting
    fitting = _beside(beside, fitting) if beside else fitting
    fitting = [t for t in fitting if not t.endswith(("/compressed", "/compressedDepth"))] or fitting
    if len(fitting) > 1:
        raise ConfigError(f"{where}: several {name} topics; type source.{name}_topic=NAME of {', '.join(fitting)}")
    return fitting[0] if fitting else ""


def _listed(found: dict[str, str]) -> str:
    return ", ".join(f"{t} ({kind.rsplit('/', 1)[-1]})" for t, kind in sorted(found.items())) or "no topic at all"
