"""ORB-SLAM3's wheel or Open3D over a TUM folder, in a process without rhs (peers_rgbd.py runs it):
FOLDER orb_slam3|open3d_hybrid OUT SEED [VOCABULARY]."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

ORB = """%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: {fx}
Camera1.fy: {fy}
Camera1.cx: {cx}
Camera1.cy: {cy}
{lens}Camera.width: {width}
Camera.height: {height}
Camera.fps: 30
Camera.RGB: 1
Stereo.ThDepth: 40.0
Stereo.b: 0.07732
RGBD.DepthMapFactor: 1.0
ORBextractor.nFeatures: 1000
ORBextractor.scaleFactor: 1.2
ORBextractor.nLevels: 8
ORBextractor.iniThFAST: 20
ORBextractor.minThFAST: 7
Viewer.KeyFrameSize: 0.05
Viewer.KeyFrameLineWidth: 1.0
Viewer.GraphLineWidth: 0.9
Viewer.PointSize: 2.0
Viewer.CameraSize: 0.08
Viewer.CameraLineWidth: 3.0
Viewer.ViewpointX: 0.0
Viewer.ViewpointY: -0.7
Viewer.ViewpointZ: -1.8
Viewer.ViewpointF: 500.0
"""


def frames(folder: Path):
    """Stamp, RGB image, metres (0 unknown) of each view."""
    for line in (folder / "associations.txt").read_text().splitlines():
        stamp, color, _, depth = line.split()
        image = cv2.cvtColor(cv2.imread(str(folder / color)), cv2.COLOR_BGR2RGB)
        yield float(stamp), image, cv2.imread(str(folder / depth), cv2.IMREAD_UNCHANGED).astype(np.float32) / 5000.0


def main() -> None:
    folder, method, out = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3])
    camera = json.loads((folder / "camera.json").read_text())
    track = orb_slam3 if method == "orb_slam3" else open3d_hybrid
    print("\n" + json.dumps(track(folder, camera, out, sys.argv[5] if len(sys.argv) > 5 else "")))


def orb_slam3(folder: Path, camera: dict, out: Path, vocabulary: str) -> dict:
    import pyorbslam3

    note = ""
    if not vocabulary:
        try:
            vocabulary = pyorbslam3.vocabulary_path(quiet=True)
        except OSError:
            from peers_vocabulary import trained

            vocabulary, note = str(trained(folder)), "vocabulary trained on these frames"
    names = ("k1", "k2", "p1", "p2", "k3")
    lens = "".join(f"Camera1.{n}: {v}\n" for n, v in zip(names, camera["distortion"], strict=False))
    settings = folder / "orb_slam3.yaml"
    settings.write_text(ORB.format(lens=lens, **{k: v for k, v in camera.items() if k != "distortion"}))
    slam = pyorbslam3.Slam(vocabulary, str(settings), pyorbslam3.Sensor.RGBD)
    lines, views, begin = [], 0, time.process_time()
    reading_s = 0.0
    for stamp, image, metres in timed(frames(folder), spent := []):
        found = slam.track_rgbd(image, metres, stamp)
        views += 1
        if found.pose_valid:
            lines.append(tum(stamp, np.asarray(found.pose_wc)))
    reading_s = sum(spent)
    slam.shutdown()
    cpu_s = time.process_time() - begin - reading_s
    out.with_name(f"{out.name}_reported.txt").write_text("".join(lines))
    slam.save_trajectory_tum(str(out.with_name(f"{out.name}_settled.txt")))
    return {"views": views, "cpu_ms": 1e3 * cpu_s / views, "note": note}


def open3d_hybrid(folder: Path, camera: dict, out: Path, _: str) -> dict:
    """Frame to frame, colour and depth (Park, Zhou and Koltun, ICCV 2017), from the last motion."""
    import open3d as o3d

    matrix = [camera[k] for k in ("width", "height", "fx", "fy", "cx", "cy")]
    pinhole = o3d.camera.PinholeCameraIntrinsic(int(matrix[0]), int(matrix[1]), *matrix[2:])
    term, option = o3d.pipelines.odometry.RGBDOdometryJacobianFromHybridTerm(), o3d.pipelines.odometry.OdometryOption()
    pose, motion, last, lines, spent, begin = np.eye(4), np.eye(4), None, [], [], time.process_time()
    failed = 0
    for stamp, image, metres in timed(frames(folder), spent):
        now = o3d.geometry.RGBDImage.create_from_color_and_depth(
            o3d.geometry.Image(np.ascontiguousarray(image)), o3d.geometry.Image(metres), depth_scale=1.0, depth_trunc=6.0)
        if last is not None:
            good, found, _ = o3d.pipelines.odometry.compute_rgbd_odometry(now, last, pinhole, motion, term, option)
            failed += not good
            motion = found if good else motion
            pose = pose @ motion
        last = now
        lines.append(tum(stamp, pose))
    out.with_name(f"{out.name}_reported.txt").write_text("".join(lines))
    cpu_s = time.process_time() - begin - sum(spent)
    return {"views": len(lines), "cpu_ms": 1e3 * cpu_s / len(lines), "note": f"{failed} views failed" if failed else ""}


def timed(items, spent: list):
    """The items; CPU seconds of making each are added to `spent`."""
    items = iter(items)
    while True:
        begin = time.thread_time()
        item = next(items, None)
        spent.append(time.thread_time() - begin)
        if item is None:
            return
        yield item


def tum(stamp: float, pose: np.ndarray) -> str:
    """A line of a TUM trajectory: stamp, position, quaternion x y z w."""
    from scipy.spatial.transform import Rotation

    numbers = [*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()]
    return f"{stamp:.6f} " + " ".join(f"{v:.9f}" for v in numbers) + "\n"


if __name__ == "__main__":
    main()
