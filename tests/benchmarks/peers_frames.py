"""Write the views of a recording as a TUM folder with its camera beside it (peers_rgbd.py runs it):

    python tests/benchmarks/peers_frames.py FOLDER source.path=RECORDING source.camera=tum_fr1
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import cv2
import numpy as np

from rhs.api.contracts import SourceContext
from rhs.api.randomness import generator
from rhs.api.trajectory import Trajectory, write_tum
from rhs.config.compose import compose_config


def main() -> int:
    folder, words = Path(sys.argv[1]), sys.argv[2:]
    parts = compose_config(["source=replay", "task=survey", *words])
    source = parts.source.settings.build(SourceContext(generator(0, "source"), None, folder))
    for name in ("rgb", "depth"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    lines, stamps, poses = [], [], []
    while (seen := source.lead()) is not None:
        if seen.image is None or seen.depth is None:
            sys.stderr.write("the recording holds no colour, or no depth\n")
            return 2
        stamp, name = f"{seen.stamp_s:.6f}", f"{len(lines):06d}.png"
        cv2.imwrite(str(folder / "rgb" / name), cv2.cvtColor(seen.image, cv2.COLOR_RGB2BGR))
        steps = np.rint(5000.0 * np.nan_to_num(seen.depth)).clip(0, 65535).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / name), steps)
        lines.append(f"{stamp} rgb/{name} {stamp} depth/{name}\n")
        truth = source.truth()
        if truth is not None:
            stamps.append(float(stamp))
            poses.append(truth @ source.camera.body_from_camera)
    (folder / "associations.txt").write_text("".join(lines))
    write_tum(folder / "groundtruth.txt", Trajectory(np.array(stamps), np.array(poses)))
    c = source.camera
    (folder / "camera.json").write_text(json.dumps({
        "width": c.width, "height": c.height, "fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy,
        "distortion": list(c.distortion), "readout_s": c.readout_s}))
    source.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
