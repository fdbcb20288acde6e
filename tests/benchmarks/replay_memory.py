"""What a whole replay holds and costs: `python tests/benchmarks/replay_memory.py --views 60 600 3000`.

The frames of a TUM folder are listed forth and back, at the pace they were taken, until there are so many views: a drive
without end, of which no file is copied (--coarse makes the pictures smaller first, for a cheaper one:
`--coarse 4 --views 20000` is a long drive at 160x120). Each is replayed by `python -m rhs source=replay source.path=FOLDER`
in a process of its own, with the words after `--`. A row each: the most memory that the process and its children held
together (PSS, sampled, so that a page they share counts once), the most of the process alone (VmHWM), its memory when 10,
25, 50, 75 and 100 % of the views are done, by how much it grows a view from the first quarter on, and processor time: all of
it over the views, that of a view alone (without start and end), and that of the odometry alone, asked in this process about
the first 300 views. Writes results/tables/replay_memory.csv.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
from shared import write

from rhs.api.contracts import Context
from rhs.api.randomness import generator
from rhs.config.compose import compose_config
from rhs.config.parts import build, build_part
from rhs.patrol.eyes import Eyes

SHARED = Path(os.environ.get("RHS_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
SAMPLE_S = 0.02
MARKS = (10, 25, 50, 75, 100)  # per cent of the views


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=Path, default=SHARED / "rgbd/tum_fr1_rpy_60", help="a folder of the TUM form")
    parser.add_argument("--views", type=int, nargs="+", default=[60, 600, 3000])
    parser.add_argument("--camera", type=float, nargs="+", help="fx fy cx cy and lens; as of freiburg1 where it is not said",
                        default=[517.3, 516.5, 318.6, 255.3, 0.2624, -0.9531, -0.0054, 0.0026, 1.1633])
    parser.add_argument("--coarse", type=int, default=1, help="every how many pixels of the pictures")
    parser.add_argument("--out", type=Path, default=Path("results/tables/replay_memory.csv"))
    parser.add_argument("words", nargs="*", help="of the run, after --: task=survey odometry=procrustes ...")
    chosen, rows = parser.parse_args(), []
    for views in chosen.views:
        with tempfile.TemporaryDirectory() as name:
            folder = forth_and_back(chosen.frames, Path(name) / "frames", views, chosen.coarse)
            camera = [f"{v / chosen.coarse if k < 4 else v:g}" for k, v in enumerate(chosen.camera)]
            words = [f"source.camera=[{','.join(camera)}]", *chosen.words]
            words.append(f"source.path={folder}")
            rows.append({"coarse": chosen.coarse, "views": views} | replayed(folder, Path(name) / "run", words)
                        | {"odometry_ms": odometry_ms(words, Path(name))})
        print(*(f"{key} {value:.4g} " for key, value in rows[-1].items()), flush=True)
    write(chosen.out, rows)


def forth_and_back(frames: Path, folder: Path, views: int, coarse: int) -> Path:
    """A TUM folder whose lists name the pictures of another again and again."""
    folder.mkdir()
    pairs = [line.split() for line in (frames / "associations.txt").read_text().splitlines() if not line.startswith("#")]
    for _, colour, _, depth in pairs:
        for file in (colour, depth):
            (folder / file).parent.mkdir(exist_ok=True)
            if coarse == 1:
                (folder / file).symlink_to(frames / file)
            else:
                cv2.imwrite(str(folder / file), cv2.imread(str(frames / file), cv2.IMREAD_UNCHANGED)[::coarse, ::coarse])
    lap = [*range(len(pairs)), *range(len(pairs) - 2, 0, -1)]
    step_s = (float(pairs[-1][0]) - float(pairs[0][0])) / (len(pairs) - 1)
    lines = [(f"{1000.0 + k * step_s:.6f}", pairs[lap[k % len(lap)]]) for k in range(views)]
    (folder / "rgb.txt").write_text("".join(f"{stamp} {pair[1]}\n" for stamp, pair in lines))
    (folder / "depth.txt").write_text("".join(f"{stamp} {pair[3]}\n" for stamp, pair in lines))
    return folder


def replayed(folder: Path, run: Path, words: list[str]) -> dict[str, float]:
    """One run of the command line, watched."""
    views = sum(1 for _ in (folder / "rgb.txt").open())
    marks: dict[int, tuple[float, float]] = {}  # per cent -> memory, and processor seconds so far
    together, most_mb, before_s, steps = 0.0, 0.0, sum(os.times()[2:4]), Steps(run)
    command = [sys.executable, "-m", "rhs", "source=replay", f"output={run}", *words]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    while process.poll() is None:
        together = max(together, sum(memory_mb(pid, "smaps_rollup", "Pss:") for pid in family(process.pid)))
        most_mb = max(most_mb, memory_mb(process.pid, "status", "VmHWM:"))
        done = steps.count()
        for mark in MARKS:
            if mark not in marks and 100 * done >= mark * views:
                marks[mark] = memory_mb(process.pid, "status", "VmRSS:"), processor_s(process.pid)
        time.sleep(SAMPLE_S)
    if process.returncode:
        raise SystemExit(process.stderr.read())
    cpu_s = sum(os.times()[2:4]) - before_s
    (_, first_s), (quarter_mb, _), (last_mb, last_s) = marks[MARKS[0]], marks[25], marks[100]
    return {"together_mb": together, "alone_mb": most_mb, **{f"at_{mark}_mb": mb for mark, (mb, _) in marks.items()},
            "grows_kb_per_view": 1e3 * (last_mb - quarter_mb) / (0.75 * views), "cpu_s": cpu_s,
            "cpu_ms_per_view": 1e3 * cpu_s / views, "view_ms": 1e3 * (last_s - first_s) / (0.9 * views)}


class Steps:
    """Steps done, by the file that grows with them."""

    def __init__(self, run: Path) -> None:
        self._run, self._read, self._count = run, 0, 0

    def count(self) -> int:
        for path in self._run.glob("steps.jsonl.tmp-*"):
            with path.open("rb") as file:
                file.seek(self._read)
                more = file.read()
            self._read, self._count = self._read + len(more), self._count + more.count(b"\n")
        return self._count


def odometry_ms(words: list[str], folder: Path, most: int = 300) -> float:
    """Processor milliseconds of the odometry for a view, the first ten left out: kernels are loaded then."""
    config = compose_config(["source=replay", "task=survey", *words])
    parts = build({kind: config.parts[kind] for kind in ("source", "sensor")}, seed=0, world=None, folder=folder,
                  features=config.features)
    eyes, seconds = Eyes(parts.source, parts.sensor, parts.who), []
    context = Context(generator(0, "odometry"), parts.source.camera, parts.source.facts, folder, config.features)
    part = build_part("odometry", config.parts["odometry"], context)
    while len(seconds) < most and (looked := eyes(parts.source.lead)) is not None:
        begin = time.process_time()
        part.update(looked.observation)
        seconds.append(time.process_time() - begin)
    parts.source.close()
    return 1e3 * sum(seconds[10:]) / len(seconds[10:])


def family(pid: int) -> list[int]:
    """A process and those it started."""
    try:
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    except OSError:
        return []
    return [pid, *(one for child in children for one in family(int(child)))]


def memory_mb(pid: int, file: str, name: str) -> float:
    """A figure of /proc/PID/FILE, 0 where the process is gone."""
    try:
        lines = Path(f"/proc/{pid}/{file}").read_text().splitlines()
    except OSError:
        return 0.0
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith(name)), 0.0)


def processor_s(pid: int) -> float:
    """User and system seconds of a process so far, 0 where it is gone."""
    try:
        values = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(values[11]) + int(values[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
