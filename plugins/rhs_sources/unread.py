"""Recordings of forms that are not read, and what makes one of them that is."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

GRAPH = "a graph of poses (g2o, TORO), which holds no scans: give the log that it was made of"
_IMAGES = "a folder with rgb/000001.png and depth/000001.png"
FILES = {
    ".svo": f"a recording of a ZED: export left images and depth as {_IMAGES}, or play it by zed_wrapper and record a bag",
    ".oni": f"a recording of OpenNI: export it as {_IMAGES}", ".klg": f"a log of Kintinuous: unpack it to {_IMAGES}",
    ".r3d": f"a recording of Record3D: export it as {_IMAGES}",
    ".pcap": "packets of a lidar: play them by its ROS driver and record the PointCloud2",
    ".rawlog": "a log of MRPT: convert it to a ROS bag or a CARMEN log",
    ".h5": f"a data file: export it as {_IMAGES}, or as a bag",
    ".active": "a bag that was not closed: rosbag reindex {file}, then name it .bag",
    ".lcm": "a log of LCM: convert it to a ROS bag, or its scans to a CARMEN log",
    ".rel": "relations, to judge a way by: source.relations={file} beside the source.path=LOG of their log",
    **dict.fromkeys((".g2o", ".graph", ".toro"), GRAPH),
    ".gfs": "GMapping's own log: give the CARMEN log that it was made of",
    ".csv": "a table: of scans write a CARMEN log, a line each: FLASER N ranges x y yaw x y yaw stamp host stamp",
    "hokuyo": "NCLT's scans of a flat laser: write a CARMEN log, a line each: FLASER N ranges x y yaw x y yaw stamp host "
              "stamp, and type source.laser_fov_deg=270 (hokuyo_4m: 240)",
    ".las": "a cloud of a map or a scan: write .pcd or .ply, one file a scan (CloudCompare -O {file} -C_EXPORT_FMT PLY "
            "-SAVE_CLOUDS)",
    ".npy": "arrays: of clouds type points.astype('float32').tofile('000000.bin'); of depth they are read beside rgb",
    ".xyz": "points as text: write .pcd, .ply or float32 x, y, z as .bin, one file a scan",
    ".heic": "photographs of a phone: write them as .jpg (mogrify -format jpg *.heic), or give its video",
    ".mat": f"arrays of MATLAB: write depth and colour as {_IMAGES}, clouds as float32 x, y, z in .bin, one file a scan",
    ".tfrecord": "records of TensorFlow (Waymo, Open X): write clouds as float32 x, y, z in .bin, images as .png, one file "
                 "each",
    ".feather": "a table of points (Argoverse): write float32 x, y, z as .bin, one file a scan",
    **dict.fromkeys((".ply", ".pcd", ".bin"), "one cloud: a recording is a folder of them, numbered; a .ply with faces is a "
                    "building: world={file}"),
    ".pkl": "objects of Python: write clouds as float32 x, y, z in .bin, images as .png, one file each",
    ".osf": "a recording of Ouster: by its SDK write a bag, or packets that its ROS driver plays",
    ".lvx": "a recording of Livox's viewer: roslaunch livox_ros_driver lvx_to_rosbag.launch lvx_file_path:={file}",
    ".vrs": f"a recording of Project Aria: export its images as {_IMAGES}",
    ".rrd": "a recording of Rerun: give the bag, the folder or the run.mcap that it was made of",
    ".xef": f"a recording of Kinect Studio: export it as {_IMAGES}",
    ".ulg": "a log of PX4, without images or scans: give the bag or the video that was recorded beside it",
    ".aedat4": f"events of a camera: make images of them, as {_IMAGES.replace(' and depth/000001.png', '')}",
    ".db": "a data base: of RTAB-Map, rtabmap-export or rtabmap-databaseViewer write its images",
}
FILES |= dict.fromkeys((".laz", ".e57"), FILES[".las"]) | {".relations": FILES[".rel"], ".pts": FILES[".xyz"]}
FILES |= {".svo2": FILES[".svo"], ".oniz": FILES[".oni"], ".pcapng": FILES[".pcap"], ".hdf5": FILES[".h5"]}
FILES[".lvx2"] = FILES[".lvx"]
FILES[".parquet"], FILES[".npz"] = FILES[".feather"], FILES[".npy"]
BESIDE = (".bin", ".csv", ".npy", ".npz", ".xyz", ".rel", ".relations")  # lie beside recordings of any form
VIDEO = ("h264", "h265", "hevc", "av1", "vp8", "vp9", "theora")
MESSAGES = {
    "VelodyneScan": "packets of a lidar are not read: play the bag by velodyne_pointcloud and record the PointCloud2",
    "PacketMsg": "packets of a lidar are not read: play the bag by ouster_ros and record the PointCloud2",
    "PointCloud": "the old PointCloud is not read: convert it (point_cloud_converter)",
    "CompressedVideo": "video is not read: republish it as images (image_transport republish) and record these",
    "FFMPEGPacket": "video is not read: republish it as images (image_transport republish) and record these",
    "Packet": "theora's video is not read: republish it as images (image_transport republish) and record these",
}


def of_file(path: Path) -> str:
    """What to do with such a file; empty where nobody knows."""
    named = {"lcmlog-": ".lcm", "hokuyo_": "hokuyo"}
    ending = next((kind for begin, kind in named.items() if path.name.startswith(begin)), path.suffix.lower())
    return FILES.get(ending, "").format(file=path.name)


def of_topics(found: Mapping[str, str]) -> str:
    """What to do with the messages of a bag (topic -> type), after a semicolon; empty where none of them is known."""
    kinds = {kind.rsplit("/", 1)[-1] for kind in found.values()}
    return "".join(f"; {MESSAGES[kind]}" for kind in sorted(kinds & set(MESSAGES)))
