"""What a recording costs and what it keeps: `python tests/benchmarks/recordings.py [RUN.mcap] [--out results/tables]`.

Without an argument it makes a run of world square_small first (about a minute). Times are CPU times of one process.
Three tables in one CSV: cost of writing and reading a view; share of messages kept when the file is cut at every
hundredth; flipped bits that were noticed.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from rhs.api.errors import RecordingError
from rhs.api.geometry import se2
from rhs.api.records import Belief, Motion, Observation, Step, Tracking
from rhs.recording.reader import RecordedView, read, read_head
from rhs.recording.writer import Recorder

FLIPS = 60


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", nargs="?", type=Path)
    parser.add_argument("--out", type=Path, default=Path("results/tables"))
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        path = chosen.recording or make_run(Path(name))
        rows = [*cost(path, Path(name)), *cuts(path, Path(name)), *flips(path, Path(name))]
    chosen.out.mkdir(parents=True, exist_ok=True)
    with (chosen.out / "recordings.csv").open("w", newline="") as file:
        table = csv.DictWriter(file, ["what", "value", "unit", "n"], lineterminator="\n")
        table.writeheader()
        table.writerows({"what": w, "value": f"{v:.4g}", "unit": u, "n": n} for w, v, u, n in rows)
    print((chosen.out / "recordings.csv").read_text())


def make_run(folder: Path) -> Path:
    import rhs

    rhs.run(["world=square_small", "recording=full", f"output={folder / 'run'}"])
    return folder / "run" / "run.mcap"


def step_of(view: RecordedView, camera) -> Step:
    seen = view.capture
    observation = Observation(seen.index, seen.stamp_s, camera, seen.image, seen.depth, seen.scan, seen.command, seen.travel)
    pose = np.array(view.plain["map_from_body"])
    return Step(seen.index, view.phase, seen.stamp_s, observation, Motion(se2(0, 0, 0), np.eye(6) * 1e-4, Tracking.OK),
                Belief(pose, np.eye(6) * 1e-4), seen.scan, view.truth, None, 0, "", None, {})


def timed_ms(work: Callable[[], object]) -> float:
    begin = time.process_time()
    work()
    return 1e3 * (time.process_time() - begin)


def cost(path: Path, folder: Path):
    """CPU milliseconds and kilobytes per view."""
    head = read_head(path)
    assert head is not None
    views = list(read(path).views())[:100]
    steps = [step_of(view, head.camera) for view in views]
    size = f"{head.camera.width}x{head.camera.height}"
    for level in ("full", "light"):
        target = folder / f"{level}.mcap"
        recorder = Recorder(target, level, head.camera, head.facts)
        recorder.step(steps[0])  # imports
        spent = timed_ms(lambda: [recorder.step(step) for step in steps])  # noqa: B023
        recorder.close()
        yield f"write {level} {size}", spent / len(steps), "ms CPU per view", len(steps)
        yield f"size {level} {size}", target.stat().st_size / 1e3 / (len(steps) + 1), "kB per view", len(steps)
    yield f"read full {size}", timed_ms(lambda: list(read(folder / "full.mcap").views())) / len(steps), "ms CPU per view", \
        len(steps)


def cuts(path: Path, folder: Path):
    """Share of the messages whose bytes were there at all that are still handed out, cut at every hundredth."""
    data, whole = path.read_bytes(), sum(1 for _ in read(path))
    shares, said = [], 0
    for cut in (len(data) * i // 100 for i in range(5, 100)):
        (folder / "cut.mcap").write_bytes(data[:cut])
        reading = read(folder / "cut.mcap")
        shares.append(sum(1 for _ in reading) / (whole * cut / len(data)))
        said += not reading.report.whole
    yield "messages kept of a cut file, least", min(shares), "share", len(shares)
    yield "messages kept of a cut file, mean", float(np.mean(shares)), "share", len(shares)
    yield "cuts reported", said / len(shares), "share", len(shares)


def flips(path: Path, folder: Path):
    """One random bit flipped: noticed, and messages still handed out (all of them unchanged)."""
    data, rng = bytearray(path.read_bytes()), np.random.default_rng(0)
    whole = {(m.channel.topic, m.log_ns, m.data) for m in read(path)}
    noticed, kept, wrong = 0, [], 0
    for bit in rng.integers(0, 8 * len(data), FLIPS):
        data[bit // 8] ^= 1 << (bit % 8)
        (folder / "flip.mcap").write_bytes(data)
        try:
            reading = read(folder / "flip.mcap")
            found = [(m.channel.topic, m.log_ns, m.data) for m in reading]
            noticed += not reading.report.whole
            wrong += sum(item not in whole for item in found)
            kept.append(len(found) / len(whole))
        except RecordingError:
            noticed += 1
        data[bit // 8] ^= 1 << (bit % 8)
    yield "single flipped bits noticed", noticed / FLIPS, "share", FLIPS
    yield "messages kept after a flipped bit, median", float(np.median(kept)), "share", len(kept)
    yield "wrong messages handed out", float(wrong), "messages", FLIPS


if __name__ == "__main__":
    main()
