"""One of our odometries over a TUM folder (peers_rgbd.py runs it): FOLDER METHOD OUT SEED."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

from rhs.api.contracts import Context, FeatureSettings
from rhs.api.geometry import Camera, orthonormal
from rhs.api.randomness import generator
from rhs.api.records import Observation
from rhs.api.trajectory import Trajectory, write_tum
from rhs.config import registry


def main() -> None:
    folder, method, out, seed = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), int(sys.argv[4])
    known = json.loads((folder / "camera.json").read_text())
    camera = Camera(**known | {"distortion": tuple(known["distortion"])})
    context = Context(generator(seed, "odometry"), camera, None, folder, FeatureSettings())
    odometry = registry.load("odometry", method)().build(context)
    pose, poses, stamps, seconds = np.eye(4), [], [], []
    for number, line in enumerate((folder / "associations.txt").read_text().splitlines()):
        stamp, color, _, depth = line.split()
        image = cv2.cvtColor(cv2.imread(str(folder / color)), cv2.COLOR_BGR2RGB)
        metres = cv2.imread(str(folder / depth), cv2.IMREAD_UNCHANGED).astype(np.float32) / np.float32(5000.0)
        metres[metres == 0.0] = np.nan
        view = Observation(number, float(stamp), camera, image, metres)
        begin = time.process_time()
        motion = odometry.update(view)
        seconds.append(time.process_time() - begin)
        pose = orthonormal(pose @ motion.previous_from_body) if number else pose
        poses.append(pose)
        stamps.append(float(stamp))
    revision = odometry.revise()
    for name, found in (("reported", np.array(poses)), ("settled", None if revision is None else revision.poses)):
        if found is not None:
            write_tum(out.with_name(f"{out.name}_{name}.txt"), Trajectory(np.array(stamps), found @ camera.body_from_camera))
    print(json.dumps({"views": len(poses), "cpu_ms": 1e3 * float(np.mean(seconds[1:])), "note": ""}))


if __name__ == "__main__":
    main()
