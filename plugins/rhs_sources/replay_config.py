"""Settings of `source=replay`: a recording led through the same loop as a simulated world."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar

from rhs.api.contracts import PartSettings, Source, SourceContext
from rhs.api.errors import ConfigError, check_range, one_of, within


@dataclass
class Replay(PartSettings):
    """A TUM RGB-D, 7-Scenes, KITTI, EuRoC or TartanAir folder, numbered images or point clouds, run.mcap, a ROS 2 or ROS 1
    bag, a video or a CARMEN laser log."""

    provides: ClassVar[frozenset[str]] = frozenset({"image", "depth", "gray", "scan", "wheel", "extras"})

    path: str = ""
    """Folder or file to read; relative paths count from where the command is typed."""
    camera: Any = "auto"
    """tum_fr1, tum_fr2, tum_fr3, icl_nuim, primesense, seven_scenes, bonn, [fx,fy,cx,cy] or [fx,fy,cx,cy,k1,k2,p1,p2,k3]
    in pixels and OpenCV's distortion, a file (camera.json, intrinsics.txt, camera_info.yaml), or auto: what the recording
    says, or the only such file in its folder."""
    depth_camera: list[float] = field(default_factory=list)
    """Of depth images that a camera beside the one of colour took, not registered to it: its [fx,fy,cx,cy] in pixels, or
    [fx,fy,cx,cy,x_m,y_m,z_m] with where it sits in the axes of the colour camera (right, down, ahead). Empty: depth is
    registered, but for camera=seven_scenes, or what a bag says. Of bags and folders of the forms tum and seven_scenes."""
    format: str = one_of("auto", "tum", "seven_scenes", "kitti", "kitti_raw", "tartan", "vkitti", "euroc", "run", "bag",
                         "carmen", "video", "frames", "sens", "clouds")
    """How to read the path: auto, tum, seven_scenes, kitti, kitti_raw, tartan, vkitti, euroc, run (run.mcap), bag,
    carmen, video, frames (numbered images), sens (ScanNet) or clouds; auto looks at the files."""
    depth_scale: float = within(0.0, 0.0, 1e6)
    """Steps of a 16-bit depth image in one metre; 0 takes what the camera's file says (depth_scale,
    DepthMapFactor), else the format's habit (TUM 5000, 7-Scenes and ROS 1000)."""
    max_depth_m: float = within(20.0, 0.1, 1e4)
    """Depth beyond this is unknown, metres; cameras of the Kinect kind say little beyond 10 m."""
    truth: str = ""
    """File of true poses, of the camera (of a CARMEN log or clouds, of the scanner; of a bag, of the body): stamp tx ty tz
    qx qy qz qw, or of numbered files the 12 numbers of KITTI a view; empty: groundtruth.txt, *.freiburg or poses.txt in the
    folder, TRUEPOS in a CARMEN log; corrected: the poses that somebody corrected in a CARMEN log."""
    rate_hz: float = within(0.0, 0.0, 1e4)
    """Views a second of numbered images, clouds and videos and of 7-Scenes, whatever their names and the container say;
    0: what these say, else 30, of clouds 10, and no speed is judged by that."""
    stereo: bool = False
    """Hand on the second camera of KITTI, EuRoC, TartanAir and bags as `right_image` and `right_camera`, as they were
    recorded; sensor=stereo sets it."""
    relations: str = ""
    """File of true relations between scans (stamp1 stamp2 x y z roll pitch yaw) to judge the way by; empty: LOG.relations
    beside a laser log."""
    max_difference_s: float = within(0.02, 0.0, 10.0)
    """Colour, depth and true pose belong together when their stamps differ by at most this, seconds (TUM's habit)."""
    max_truth_gap_s: float = within(0.1, 0.0, 1e4)
    """True poses are interpolated across gaps up to this long, seconds; beyond it the truth is unknown."""
    max_jump_s: float = within(60.0, 0.01, 1e9)
    """A stamp further than this ahead of the one before is a jump of the clock, seconds; rejected when alone."""
    start: int = within(0, 0, 1e9)
    """First recorded view to use."""
    stride: int = within(1, 1, 1e6)
    """Every how many of them."""
    count: int = within(0, 0, 1e9)
    """Number of views to use at most; 0 means all."""
    phase: str = one_of("survey", "patrol", "localise", "all")
    """Part of a run recorded by rhs to hand out: survey, patrol, localise or all."""
    views: str = one_of("auto", "scans", "clouds")
    """What makes a view of a bag that holds several: images, else clouds, else scans (auto), or scans or clouds alone, each
    when it was taken; sensor=laser and sensor=lidar set it. A bag without these is read as by auto."""
    color_topic: str = ""
    """Topic of a bag with colour or grey images; empty takes the only topic of a fitting type, none goes without."""
    right_topic: str = ""
    """Topic of a bag with the images of the second camera of a pair (sensor=stereo), color_topic the first; empty takes the
    one that is named alike (left and right, infra1 and infra2, cam0 and cam1)."""
    depth_topic: str = ""
    """Topic of a bag with depth images; empty and none as for color_topic."""
    info_topic: str = ""
    """Topic of a bag with CameraInfo; empty and none as for color_topic."""
    scan_topic: str = ""
    """Topic of a bag with LaserScan or MultiEchoLaserScan (its first echoes); empty and none as for color_topic."""
    wheel_topic: str = ""
    """Topic of a bag with Odometry of the wheels; empty and none as for color_topic, none of a CARMEN log too."""
    truth_topic: str = ""
    """Topic of true poses (PoseStamped, Odometry, TransformStamped); empty: a bag's truth is unknown."""
    truth_frame: str = ""
    """Fixed frame of a tf tree that a motion-capture system wrote; empty: tf is not taken for the truth."""
    truth_of: str = ""
    """What the poses of source.truth or source.truth_topic are of, in a bag: a frame of its tf, or camera: the colour
    camera, by its own axes (right, down, ahead), as SLAM programs write them; empty: the body."""
    body_frame: str = ""
    """Frame of a bag's tf tree that is the body; empty: the one whose motion the wheels tell, base_footprint, base_link, or
    the end of the fixed links above the sensor. Sensors sit where /tf_static (or /tf that stands still) puts them."""
    scan_mount: list[float] = field(default_factory=list)
    """Where the laser of a bag or a CARMEN log sits on the body: [x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg]; empty: what its
    tf says, else at the body."""
    camera_mount: list[float] = field(default_factory=list)
    """Where the camera sits on the body, looking along its own x: [x_m,y_m,z_m,roll_deg,pitch_deg,yaw_deg]; empty: what a
    bag's tf says, else at the body. Not of a run.mcap, which knows it."""
    deskew: bool = True
    """Put right the scans of a bag's laser whose beams go round while the robot turns, by the wheels, where the scans show
    that they do; clouds of a lidar: odometry.deskew."""
    views_late_s: float = within(0.0, -60.0, 60.0)
    """The views of a bag were taken so much earlier than their stamps say, seconds, as where a driver stamps them on
    arrival: wheels and true poses are looked up for then. What turns say of it is the column views_late_s."""
    extent_m: float = 0.0
    """Half the side of the square to map round the start, metres; a recording does not say how large its world is. 0: 10 m,
    with a lidar 200 m, and as much more as is seen."""
    laser_fov_deg: float = within(180.0, 1.0, 360.0)
    """Beams of a CARMEN laser cover this many degrees, centred ahead."""
    max_laser_m: float = within(30.0, 0.1, 1e3)
    """A laser reading of a CARMEN log at or beyond this means that nothing was hit, metres."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("", "extent_m", self.extent_m or 1.0, low=1.0, high=1e3, unit="m")
        from .replay_mounts import mount_of
        from .replay_register import check_depth_camera

        for name in ("scan_mount", "camera_mount"):
            mount_of(getattr(self, name), name)
        check_depth_camera(self.depth_camera)
        if not isinstance(self.camera, str):
            _check_intrinsics(self.camera)

    def suited_sensor(self) -> str:
        """The sensor of this recording, where it has no colour with depth; empty: the default one."""
        from .replay_sensor import suited_sensor

        return suited_sensor(self)

    def build(self, context: SourceContext) -> Source:
        from .replay import ReplaySource

        return ReplaySource(self, context.folder if context is not None else None)


def _check_intrinsics(values) -> None:
    try:
        numbers = [float(v) for v in values]
    except (TypeError, ValueError):
        numbers = []
    if len(numbers) not in (4, 8, 9):
        found = f"camera={values} is neither a preset nor four, eight or nine numbers"
        raise ConfigError(f"{found}; type source.camera=[fx,fy,cx,cy] or [fx,fy,cx,cy,k1,k2,p1,p2,k3]")
    if numbers[1] < 0.0:
        raise ConfigError(f"camera fy={numbers[1]:g}: an axis that looks up (ICL-NUIM's own); images have y "
                          f"down: type {-numbers[1]:g}")
    for name, value in zip(("fx", "fy"), numbers, strict=False):
        check_range("", f"camera {name}", value, low=1.0, high=1e5, unit="pixels")
    for name, value in zip(("cx", "cy"), numbers[2:4], strict=True):
        check_range("", f"camera {name}", value, low=-1e5, high=1e5, unit="pixels")
    for name, value in zip(("k1", "k2", "p1", "p2", "k3"), numbers[4:], strict=False):
        check_range("", f"camera {name}", value, low=-100.0, high=100.0)
