"""Small ROS 1 and ROS 2 bags of a camera that moves, written with rosbags; for tests of reading them."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from rosbags.typesys import Stores, get_typestore

from rhs.api.geometry import Camera

WIDTH, HEIGHT, F = 64, 48, 50.0
CAMERA = Camera(WIDTH, HEIGHT, F, F, 31.5, 23.5)
KINDS = ("ros2_mcap", "ros2_sqlite", "ros1")


class BagFile:
    """One bag of a kind of KINDS; messages are put in by name of type and fields."""

    def __init__(self, folder: Path, kind: str) -> None:
        self.ros1 = kind == "ros1"
        self.store = get_typestore(Stores.ROS1_NOETIC if self.ros1 else Stores.ROS2_HUMBLE)
        if self.ros1:
            from rosbags.rosbag1 import Writer
            from rosbags.typesys import get_types_from_msg

            tf = get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage")
            self.store.register(tf)

            self.path = folder / "test.bag"
            self.writer = Writer(self.path)
        else:
            from rosbags.rosbag2 import StoragePlugin, Writer

            self.path = folder / "bag"
            plugin = StoragePlugin.MCAP if kind == "ros2_mcap" else StoragePlugin.SQLITE3
            self.writer = Writer(self.path, version=9, storage_plugin=plugin)
        self.connections: dict = {}
        self.clock_s: float | None = None  # when messages are said to arrive; None: at their stamp

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def make(self, name: str, /, **fields):
        return self.store.types[name](**fields)

    def put(self, topic: str, stamp_s: float, message) -> None:
        kind = message.__msgtype__
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        raw = self.store.serialize_ros1(message, kind) if self.ros1 else self.store.serialize_cdr(message, kind)
        arrived_s = stamp_s if self.clock_s is None else self.clock_s
        self.writer.write(self.connections[topic], round(arrived_s * 1e9), raw)

    def header(self, stamp_s: float, frame: str = "camera"):
        stamp = self.make("builtin_interfaces/msg/Time", sec=int(stamp_s), nanosec=round(stamp_s % 1 * 1e9))
        extra = {"seq": 0} if self.ros1 else {}
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **extra)

    def image(self, topic: str, stamp_s: float, pixels: np.ndarray, encoding: str, frame: str = "camera") -> None:
        data = np.ascontiguousarray(pixels)
        fields = dict(height=data.shape[0], width=data.shape[1], encoding=encoding, is_bigendian=0,
                      step=data.strides[0], data=data.view(np.uint8).ravel())
        self.put(topic, stamp_s, self.make("sensor_msgs/msg/Image", header=self.header(stamp_s, frame), **fields))

    def compressed(self, topic: str, stamp_s: float, pixels: np.ndarray, form: str) -> None:
        data = cv2.imencode(".png", pixels)[1].ravel()
        if "compressedDepth" in form:
            data = np.concatenate([np.frombuffer(struct.pack("<iff", 0, 0.0, 0.0), np.uint8), data])
        message = self.make("sensor_msgs/msg/CompressedImage", header=self.header(stamp_s), format=form, data=data)
        self.put(topic, stamp_s, message)

    def camera_info(self, topic: str, stamp_s: float, distortion=(0.0,) * 5, model: str = "plumb_bob",
                    camera: Camera = CAMERA, binning: int = 0, part: tuple[int, int, int, int] = (0, 0, 0, 0)) -> None:
        """part: x, y, width and height of the roi."""
        k, r = np.array([camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1.0]), np.eye(3).ravel()
        p = np.hstack([k.reshape(3, 3), np.zeros((3, 1))]).ravel()
        names = {"D": np.array(distortion, float), "K": k, "R": r, "P": p}
        names = names if self.ros1 else {n.lower(): v for n, v in names.items()}
        roi = self.make("sensor_msgs/msg/RegionOfInterest", x_offset=part[0], y_offset=part[1], height=part[3],
                        width=part[2], do_rectify=False)
        message = self.make("sensor_msgs/msg/CameraInfo", header=self.header(stamp_s), height=camera.height,
                            width=camera.width, distortion_model=model, binning_x=binning, binning_y=binning, roi=roi,
                            **names)
        self.put(topic, stamp_s, message)

    def pose(self, x: float, y: float, yaw: float):
        point = self.make("geometry_msgs/msg/Point", x=x, y=y, z=0.0)
        turn = self.make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=np.sin(yaw / 2), w=np.cos(yaw / 2))
        return self.make("geometry_msgs/msg/Pose", position=point, orientation=turn)

    def odometry(self, topic: str, stamp_s: float, x: float, y: float, yaw: float) -> None:
        zero = self.make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        twist = self.make("geometry_msgs/msg/Twist", linear=zero, angular=zero)
        pose = self.make("geometry_msgs/msg/PoseWithCovariance", pose=self.pose(x, y, yaw), covariance=np.zeros(36))
        spread = self.make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
        message = self.make("nav_msgs/msg/Odometry", header=self.header(stamp_s, "odom"), child_frame_id="base", pose=pose,
                            twist=spread)
        self.put(topic, stamp_s, message)

    def scan(self, topic: str, stamp_s: float, ranges) -> None:
        values = np.asarray(ranges, np.float32)
        message = self.make("sensor_msgs/msg/LaserScan", header=self.header(stamp_s, "laser"), angle_min=-1.0, angle_max=1.0,
                            angle_increment=2.0 / (len(values) - 1), time_increment=0.0, scan_time=0.1, range_min=0.1,
                            range_max=10.0, ranges=values, intensities=np.zeros(0, np.float32))
        self.put(topic, stamp_s, message)

    def cloud(self, topic: str, stamp_s: float, points: np.ndarray, times_ns: np.ndarray | None = None) -> None:
        """times_ns: of each point, in a field `t`, as Ouster's driver writes it."""
        kind = np.dtype([(n, "<f4") for n in "xyz"] + ([] if times_ns is None else [("t", "<u4")]))
        table = np.zeros(len(points), kind)
        for name, column in zip("xyzt", [*np.asarray(points).T, *([] if times_ns is None else [times_ns])], strict=False):
            table[name] = column
        fields = [self.make("sensor_msgs/msg/PointField", name=n, offset=4 * i, datatype=7 if n != "t" else 6, count=1)
                  for i, n in enumerate(kind.names or ())]
        message = self.make("sensor_msgs/msg/PointCloud2", header=self.header(stamp_s), height=1, width=len(table),
                            fields=fields, is_bigendian=False, point_step=kind.itemsize, row_step=table.nbytes,
                            data=table.view(np.uint8).ravel(), is_dense=True)
        self.put(topic, stamp_s, message)

    def transform(self, topic: str, stamp_s: float, parent: str, child: str, x: float, yaw: float = 0.0,
                  roll: float = 0.0) -> None:
        place = self.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0)
        a, b, c, d = np.cos(yaw / 2), np.sin(yaw / 2), np.cos(roll / 2), np.sin(roll / 2)
        turn = self.make("geometry_msgs/msg/Quaternion", x=a * d, y=b * d, z=b * c, w=a * c)
        moved = self.make("geometry_msgs/msg/Transform", translation=place, rotation=turn)
        one = self.make("geometry_msgs/msg/TransformStamped", header=self.header(stamp_s, parent), child_frame_id=child,
                        transform=moved)
        self.put(topic, stamp_s, self.make("tf2_msgs/msg/TFMessage", transforms=[one]))


def picture(k: int = 0) -> np.ndarray:
    """(H, W, 3) uint8 RGB: red grows with the number of the view."""
    out = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    out[:, :, 0] = 50 + k
    out[:, :, 2] = 7
    return out
