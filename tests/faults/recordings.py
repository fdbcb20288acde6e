"""R01 to R10: recordings that are cut, damaged, foreign, bombs, or of runs that failed at once."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
from faults.bench import LIGHT, Bench, parts
from faults.catalogue import fault
from faults.files import chunk_bomb, png
from helpers.synthetic_run import make_steps

from rhs.api.geometry import camera_from_fov

CAMERA = camera_from_fov(96, 72, 60.0, height_m=1.0)
FAKE = parts()
SURVEY = ["task=survey", "source=replay", *LIGHT, "output=run"]


def recording(path: Path, count: int = 30) -> bytes:
    """A finished recording of several chunks."""
    from rhs.recording.writer import Recorder

    recorder = Recorder(path, "full", CAMERA)
    for step in make_steps(count, camera=CAMERA):
        recorder.step(step)
    recorder.close()
    return path.read_bytes()


def converted(bench: Bench, data: bytes, **expected: object) -> str:
    """What rhs.convert says of these bytes; the output is removed again."""
    bench.file("in.mcap", data)
    answer = bench.ask("in.mcap", "out.mcap", module="rhs.convert", **expected)  # type: ignore[arg-type]
    (bench.folder / "out.mcap").unlink(missing_ok=True)
    return answer.out + answer.err


def count_of(told: str) -> int:
    return int(told.split("out.mcap: ")[1].split()[0])


@fault("R01", "SIGKILL while recording, then the file is opened", "3; every whole chunk is read, and what is lost is told")
def killed_while_recording(bench: Bench) -> None:
    process = bench.start(
        *FAKE,
        "recording=full",
        "pictures=off",
        "source.views=2000",
        "source.image_width=320",
        "source.delay_s=0.005",
        "output=run",
    )

    def size() -> int:
        return max((path.stat().st_size for path in bench.folder.glob("run/run.mcap*")), default=0)

    def between_chunks() -> bool:
        """A chunk is written by several calls: killed between these, it is cut (R02)."""
        before = size()
        time.sleep(0.02)
        return size() == before > 40_000

    bench.wait(between_chunks)
    process.send_signal(signal.SIGKILL)
    process.wait()
    cut = next(bench.folder.glob("run/run.mcap*"))
    bench.file("cut.mcap", cut.read_bytes())
    answer = bench.ask("cut.mcap", "whole.mcap", module="rhs.convert", code=3, says="as a killed writer leaves it")
    assert int(answer.out.split("whole.mcap: ")[1].split()[0]) > 50
    assert "steps from" in bench.ask("recover", "run", code=0).out


@fault("R02", "a recording cut at any length", "3 (1 below its first bytes); where it was cut, never a MemoryError")
def cut_recording(bench: Bench) -> None:
    data = recording(bench.folder / "in.mcap", 90)
    counts = [
        count_of(converted(bench, data[: len(data) * share // 100], code=3, says="in.mcap")) for share in range(4, 100, 16)
    ]
    assert counts == sorted(counts) and counts[-1] > 0.5 * count_of(converted(bench, data, code=0))
    converted(bench, data[:5], code=1, says="not an MCAP file")


@fault("R03", "one to three bits flipped", "3; the checksum, and where; the other chunks are read")
def flipped_bits(bench: Bench) -> None:
    data = recording(bench.folder / "in.mcap")
    rng, whole = np.random.default_rng(0), count_of(converted(bench, data, code=0))
    kept = []
    for flips in (1, 1, 1, 2, 3):
        bad = bytearray(data)
        for bit in rng.integers(8 * 100, 8 * (len(data) - 100), flips):
            bad[bit // 8] ^= 1 << (bit % 8)
        kept.append(count_of(converted(bench, bytes(bad), code=3, says="in.mcap")))
    assert np.median(kept) > 0.5 * whole


@fault("R04", "bits flipped in the footer or the index", "3; read without the index, nothing is lost")
def flipped_index(bench: Bench) -> None:
    data = recording(bench.folder / "in.mcap")
    whole = count_of(converted(bench, data, code=0))
    for at in (-200, -30):
        bad = bytearray(data)
        bad[at] ^= 1
        assert count_of(converted(bench, bytes(bad), code=3, says="index")) == whole


@fault(
    "R05",
    "an empty file, 8 bytes, a picture, a folder, a pipe or a device called .mcap",
    "1 or 2: `not an MCAP file`, a device",
)
def no_recording(bench: Bench) -> None:
    for data in (b"", b"\x89MCAP0\r\n", png(20, 20), b"hello world, this is text" * 10):
        converted(bench, data, code=1, says="not an MCAP file")
        bench.ask(*SURVEY, "source.path=in.mcap", says="in.mcap")
    (bench.folder / "folder.mcap").mkdir()
    bench.ask("folder.mcap", "out.mcap", module="rhs.convert", says="folder.mcap")
    (bench.folder / "device.mcap").symlink_to("/dev/zero")
    import os

    os.mkfifo(bench.folder / "pipe.mcap")
    for name in ("device", "pipe"):
        bench.ask(f"{name}.mcap", "out.mcap", module="rhs.convert", says="is a device, pipe or socket")
        bench.ask(*SURVEY, f"source.path={name}.mcap", says="a FIFO or a device")


@fault(
    "R06",
    "channels without schema, of an unknown encoding, too few, another profile",
    "0: copied unread; 2 as a source, which channel is missing",
)
def foreign_recording(bench: Bench) -> None:
    from mcap.writer import Writer

    with (bench.folder / "in.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros99")
        schema = writer.register_schema("my/Type", "klingon", b"?")
        for topic, encoding, kind in (("/words", "json", 0), ("/riddle", "klingon", schema)):
            channel = writer.register_channel(topic, encoding, kind)
            for number in range(10):
                writer.add_message(channel, number, b'{"a": 1}', number)
        writer.finish()
    assert count_of(converted(bench, (bench.folder / "in.mcap").read_bytes(), code=0)) == 20
    bench.ask(*SURVEY, "source.path=in.mcap", says="in.mcap")


@fault("R07", "the output of a conversion is its input", "2; the input stays as it is")
def output_is_input(bench: Bench) -> None:
    recording(bench.folder / "in.mcap", 5)
    (bench.folder / "link.mcap").hardlink_to(bench.folder / "in.mcap")
    for name in ("in.mcap", "link.mcap"):
        bench.ask("in.mcap", name, "--force", module="rhs.convert", says="is the input itself")


@fault("R08", "a recovered recording is opened by other readers", "0; they count what was told")
def recovered_recording(bench: Bench) -> None:
    from mcap.reader import make_reader

    data = recording(bench.folder / "in.mcap")
    bench.file("cut.mcap", data[: len(data) * 6 // 10])
    answer = bench.ask("cut.mcap", "whole.mcap", module="rhs.convert", code=3, says="cut.mcap")
    with (bench.folder / "whole.mcap").open("rb") as file:
        reader = make_reader(file)
        assert sum(1 for _ in reader.iter_messages()) == int(answer.out.split("whole.mcap: ")[1].split()[0])
    bench.ask("whole.mcap", "again.mcap", module="rhs.convert", code=0)


@fault("R09", "lengths that lie, chunks that unpack without end", "1 (2 as a source), within 500 MB and 2 s; 3: damage")
def bombs(bench: Bench) -> None:
    bomb, empty = chunk_bomb(bytes(255 << 20), 40), chunk_bomb(bytes(9 * 1_000_000), 1)
    converted(bench, bomb, code=1, says="claim to unpack to")
    bench.ask(*SURVEY, "source.path=in.mcap", says="claim to unpack to")
    converted(bench, empty, code=3, says="a chunk holds a record of code 0")
    bench.ask(*SURVEY, "source.path=in.mcap", says="in.mcap")
    head = b"\x89MCAP0\r\n" + b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    for length in (1 << 31, (1 << 63) + 5):
        converted(bench, head + b"\x06" + length.to_bytes(8, "little") + bytes(100), code=3, says="is cut")


@fault(
    "R10",
    "recording is on and the run fails at its first view",
    "1; a finished recording of what there was, that says failed",
)
def recording_of_a_failure(bench: Bench) -> None:
    bench.ask(
        *parts(odometry="faulty"),
        "odometry.how=raise",
        "odometry.at=1",
        "recording=full",
        "pictures=off",
        "output=run",
        code=1,
        says="ValueError at step 0",
    )
    bench.ask("run/run.mcap", "out.mcap", module="rhs.convert", code=0)
    assert b"failed" in (bench.folder / "run" / "run.mcap").read_bytes()
