"""ROS 2 messages from rhs records: the home of rosbags' message types.

Positions in metres, angles in radians, stamps in whole nanoseconds. Covariances follow ROS: turned into the parent
frame. Heavy imports happen on first use.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from rhs.api.geometry import Camera, quaternion_xyzw, se2
from rhs.api.grid import OccupancyGrid
from rhs.api.packed_pictures import png_of
from rhs.api.records import Scan, Twist

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore


@cache
def typestore() -> Typestore:
    """The message definitions of ROS 2 Humble."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@cache
def definition(name: str) -> bytes:
    """The text of a message definition with its dependencies, as MCAP's `ros2msg` encoding wants it."""
    text, _ = typestore().generate_msgdef(name, ros_version=2)
    return text.encode()


def serialize(message: Any) -> bytes:
    """CDR bytes of a message."""
    return bytes(typestore().serialize_cdr(message, message.__msgtype__))


def deserialize(data: bytes, name: str) -> Any:
    """A message from its CDR bytes."""
    return typestore().deserialize_cdr(data, name)


def make(kind: str, /, **fields: Any) -> Any:
    """A message of type `package/msg/Name`."""
    return typestore().types[kind](**fields)


def nanoseconds(stamp_s: float) -> int:
    """Whole nanoseconds of a stamp, without the loss that multiplying a large float by 1e9 has."""
    whole = int(np.floor(stamp_s))
    return whole * 10**9 + round((stamp_s - whole) * 1e9)


def seconds(stamp_ns: int) -> float:
    """The stamp in seconds nearest to whole nanoseconds."""
    return stamp_ns / 10**9  # Python divides integers with one rounding


def header(stamp_ns: int, frame: str) -> Any:
    """std_msgs/Header."""
    stamp = make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(xyz: Sequence[float] | np.ndarray) -> Any:
    """geometry_msgs/Vector3 of (3,) metres or whatever they are."""
    return make("geometry_msgs/msg/Vector3", x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def point(xyz: Sequence[float] | np.ndarray) -> Any:
    """geometry_msgs/Point of (3,) metres."""
    return make("geometry_msgs/msg/Point", x=float(xyz[0]), y=float(xyz[1]), z=float(xyz[2]))


def quaternion(rotation: np.ndarray) -> Any:
    """geometry_msgs/Quaternion of a (3, 3) rotation."""
    x, y, z, w = quaternion_xyzw(rotation)
    return make("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w))


def pose(matrix: np.ndarray) -> Any:
    """geometry_msgs/Pose of a 4x4."""
    return make("geometry_msgs/msg/Pose", position=point(matrix[:3, 3]), orientation=quaternion(matrix[:3, :3]))


def pose_stamped(matrix: np.ndarray, stamp_ns: int, frame: str) -> Any:
    """geometry_msgs/PoseStamped of a 4x4 in a frame."""
    return make("geometry_msgs/msg/PoseStamped", header=header(stamp_ns, frame), pose=pose(matrix))


def pose_with_covariance(matrix: np.ndarray, covariance: np.ndarray) -> Any:
    """Pose whose 6x6 covariance, of a right perturbation in the body frame, is turned into the parent frame."""
    turn = (np.eye(2)[:, None, :, None] * matrix[:3, None, :3]).reshape(6, 6)  # np.kron, in a fifth of the time
    return make("geometry_msgs/msg/PoseWithCovariance", pose=pose(matrix),
                covariance=np.ascontiguousarray((turn @ covariance @ turn.T).reshape(36)))


def pose_with_covariance_stamped(matrix: np.ndarray, covariance: np.ndarray, stamp_ns: int, *, frame: str) -> Any:
    """geometry_msgs/PoseWithCovarianceStamped of a 4x4 and its 6x6 covariance in a frame."""
    return make("geometry_msgs/msg/PoseWithCovarianceStamped", header=header(stamp_ns, frame),
                pose=pose_with_covariance(matrix, covariance))


def odometry(matrix: np.ndarray, covariance: np.ndarray, stamp_ns: int, *, frame: str, child: str) -> Any:
    """nav_msgs/Odometry of a 4x4 and its covariance, frame to child; no velocity."""
    still = make("geometry_msgs/msg/Twist", linear=vector((0, 0, 0)), angular=vector((0, 0, 0)))
    twist = make("geometry_msgs/msg/TwistWithCovariance", twist=still, covariance=np.zeros(36))
    return make("nav_msgs/msg/Odometry", header=header(stamp_ns, frame), child_frame_id=child,
                pose=pose_with_covariance(matrix, covariance), twist=twist)


def transforms(stamp_ns: int, edges: list[tuple[str, str, np.ndarray]]) -> Any:
    """tf message of (parent, child, parent_from_child) edges."""
    items = [make("geometry_msgs/msg/TransformStamped", header=header(stamp_ns, parent), child_frame_id=child,
                  transform=make("geometry_msgs/msg/Transform", translation=vector(matrix[:3, 3]),
                                 rotation=quaternion(matrix[:3, :3])))
             for parent, child, matrix in edges]
    return make("tf2_msgs/msg/TFMessage", transforms=items)


def path(points_m: np.ndarray, stamp_ns: int, frame: str) -> Any:
    """nav_msgs/Path through (N, 2) points, each heading for the next."""
    points = np.asarray(points_m, float).reshape(-1, 2)
    yaws = np.arctan2(*np.diff(points, axis=0).T[::-1])
    yaws = np.append(yaws, yaws[-1:] if len(yaws) else 0.0)  # there the last one stays
    poses = [pose_stamped(se2(x, y, yaw), stamp_ns, frame) for (x, y), yaw in zip(points, yaws, strict=False)]
    return make("nav_msgs/msg/Path", header=header(stamp_ns, frame), poses=poses)


def occupancy_grid(grid: OccupancyGrid, stamp_ns: int, frame: str) -> Any:
    """nav_msgs/OccupancyGrid: 0..100 per cent, -1 unknown, row 0 at the smallest y."""
    unknown = np.isnan(grid.probability)
    percent = np.where(unknown, -1, np.round(np.where(unknown, 0.0, grid.probability) * 100.0)).astype(np.int8)
    corner = np.eye(4)
    corner[:2, 3] = grid.origin_m
    info = make("nav_msgs/msg/MapMetaData", map_load_time=header(stamp_ns, frame).stamp, origin=pose(corner),
                resolution=float(grid.resolution_m), width=grid.shape[1], height=grid.shape[0])
    return make("nav_msgs/msg/OccupancyGrid", header=header(stamp_ns, frame), info=info, data=percent.ravel())


def camera_info(camera: Camera, stamp_ns: int, frame: str) -> Any:
    """sensor_msgs/CameraInfo of a camera."""
    k = camera.matrix
    region = make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    distortion = (*camera.distortion, *[0.0] * 5)[: max(5, len(camera.distortion))]
    model = "plumb_bob" if len(distortion) == 5 else "rational_polynomial"
    return make("sensor_msgs/msg/CameraInfo", header=header(stamp_ns, frame), height=camera.height, width=camera.width,
                distortion_model=model, d=np.array(distortion, float), k=k.reshape(9), r=np.eye(3).reshape(9),
                p=np.hstack([k, np.zeros((3, 1))]).reshape(12), binning_x=0, binning_y=0, roi=region)


def compressed_image(image: np.ndarray, stamp_ns: int, frame: str, *, jpeg: int = 0) -> Any:
    """PNG of an (H, W, 3) uint8 RGB image, the file it was read from where that is known: what is recorded comes back bit
    for bit. jpeg: in its place a JPEG of that quality in per cent."""
    import cv2

    kind = "jpeg" if jpeg else "png"
    if not jpeg and (data := png_of(image)) is not None:
        packed = np.frombuffer(data, np.uint8)
    else:  # PNG filtered, not packed: zstd packs the chunk it comes to lie in as small as zlib would, ten times sooner
        how = [cv2.IMWRITE_JPEG_QUALITY, jpeg] if jpeg else \
            [cv2.IMWRITE_PNG_COMPRESSION, 0, cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB]
        done, packed = cv2.imencode(f".{kind}", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), how)
        if not done:
            raise ValueError(f"OpenCV could not encode the image as {kind.upper()}")
    return make("sensor_msgs/msg/CompressedImage", header=header(stamp_ns, frame), format=kind, data=packed.ravel())


def depth_image(depth_m: np.ndarray, stamp_ns: int, frame: str) -> Any:
    """32FC1 image of (H, W) metres, NaN unknown."""
    data = np.ascontiguousarray(depth_m, "<f4")
    return make("sensor_msgs/msg/Image", header=header(stamp_ns, frame), height=data.shape[0], width=data.shape[1],
                encoding="32FC1", is_bigendian=0, step=4 * data.shape[1], data=data.view(np.uint8).ravel())


def laser_scan(scan: Scan, stamp_ns: int, frame: str) -> Any:
    """LaserScan: as it is where bearings are evenly spaced, else the nearest beam on an even grid (for viewers)."""
    order = np.argsort(scan.bearings_rad, kind="stable")
    bearings, ranges = scan.bearings_rad[order], scan.ranges_m[order]
    first, last, step = (float(bearings[0]), float(bearings[-1]), 0.0) if len(bearings) else (0.0, 0.0, 0.0)
    if len(bearings) > 1:
        even = np.linspace(first, last, len(bearings))
        ranges, step = ranges[np.searchsorted(0.5 * (bearings[1:] + bearings[:-1]), even)], float(even[1] - even[0])
    return make("sensor_msgs/msg/LaserScan", header=header(stamp_ns, frame), angle_min=first, angle_max=last,
                angle_increment=step, time_increment=0.0, scan_time=0.0, range_min=0.0,
                range_max=float(scan.max_range_m), ranges=ranges.astype(np.float32),
                intensities=np.zeros(0, np.float32))


def point_cloud(columns: dict[str, np.ndarray], stamp_ns: int, frame: str) -> Any:
    """PointCloud2 with one field per column ((N,) float32, float64 or uint32)."""
    codes = {"f4": 7, "f8": 8, "u4": 6}
    kinds = [(name, np.asarray(values).dtype.newbyteorder("<")) for name, values in columns.items()]
    table = np.empty(len(next(iter(columns.values()))), dtype=kinds)
    fields, offset = [], 0
    for name, kind in kinds:
        table[name] = columns[name]
        fields.append(make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=codes[kind.str[1:]], count=1))
        offset += kind.itemsize
    return make("sensor_msgs/msg/PointCloud2", header=header(stamp_ns, frame), height=1, width=len(table),
                fields=fields, is_bigendian=False, point_step=table.dtype.itemsize, row_step=table.nbytes,
                data=table.view(np.uint8).ravel(), is_dense=False)


def scan_cloud(scan: Scan, stamp_ns: int, frame: str) -> Any:
    """The scan beam by beam, exact: points x, y, z (float32, NaN without a hit) with bearing and range (float64)."""
    reach = np.where(np.isfinite(scan.ranges_m), scan.ranges_m, np.nan)
    return point_cloud({
        "x": (scan.origin_xy_m[0] + reach * np.cos(scan.bearings_rad)).astype(np.float32),
        "y": (scan.origin_xy_m[1] + reach * np.sin(scan.bearings_rad)).astype(np.float32),
        "z": np.zeros(len(reach), np.float32),
        "bearing": np.asarray(scan.bearings_rad, np.float64), "range": np.asarray(scan.ranges_m, np.float64),
    }, stamp_ns, frame)


def depth_cloud(camera: Camera, depth_m: np.ndarray, image: np.ndarray | None, stamp_ns: int, *, frame: str) -> Any:
    """A thinned coloured cloud (about 2,000 points, camera frame) for viewers."""
    stride = max(1, int(np.ceil(np.sqrt(depth_m.size / 2000.0))))
    thin = slice(stride // 2, None, stride)
    z = depth_m[thin, thin].ravel()
    seen = np.isfinite(z)
    points = camera.points(_pixels(depth_m.shape, stride)[seen], z[seen]).astype(np.float32)
    columns = {"x": points[:, 0], "y": points[:, 1], "z": points[:, 2]}
    if image is not None:
        rgb = image[thin, thin].reshape(-1, 3)[seen].astype(np.uint32)
        columns["rgb"] = ((rgb[:, 0] << 16) | (rgb[:, 1] << 8) | rgb[:, 2]).view(np.float32)
    return point_cloud(columns, stamp_ns, frame)


@cache
def _pixels(shape: tuple[int, int], stride: int) -> np.ndarray:
    """(N, 2) float64 u, v of every so many pixels of an image, row by row."""
    v, u = np.mgrid[stride // 2:shape[0]:stride, stride // 2:shape[1]:stride]
    return np.stack([u.ravel(), v.ravel()], axis=1).astype(float)


def path_cloud(points_m: np.ndarray, stamp_ns: int, frame: str) -> Any:
    """The path as points 5 cm apart: Rerun shows no nav_msgs/Path, but every viewer shows clouds."""
    points = np.asarray(points_m, float).reshape(-1, 2)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])[: len(points)]
    along = np.arange(0.0, way[-1] if len(way) else 0.0, 0.05)
    x, y = (np.interp(along, way, points[:, k]).astype(np.float32) if len(along) else np.zeros(0, np.float32)
            for k in (0, 1))
    return point_cloud({"x": x, "y": y, "z": np.zeros_like(x)}, stamp_ns, frame)


def twist(command: Twist, stamp_ns: int, frame: str) -> Any:
    """TwistStamped of a command; its duration is kept in /rhs/step."""
    body = make("geometry_msgs/msg/Twist", linear=vector((command.forward_mps, 0, 0)),
                angular=vector((0, 0, command.turn_radps)))
    return make("geometry_msgs/msg/TwistStamped", header=header(stamp_ns, frame), twist=body)


def travel(dx_dy_dyaw: np.ndarray, stamp_ns: int, frame: str) -> Any:
    """Vector3Stamped of a wheel reading: x, y metres and yaw radians since the previous view."""
    return make("geometry_msgs/msg/Vector3Stamped", header=header(stamp_ns, frame), vector=vector(dx_dy_dyaw))


def text(value: str) -> Any:
    """std_msgs/String."""
    return make("std_msgs/msg/String", data=value)


def raw_array(array: np.ndarray) -> Any:
    """The bytes of an array; who writes it says beside it what they mean."""
    layout = make("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
    return make("std_msgs/msg/UInt8MultiArray", layout=layout, data=np.frombuffer(array.tobytes(), np.uint8))
