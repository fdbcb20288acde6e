"""Cut, damaged and foreign files: whole messages come out unchanged, loss is said, memory is bounded."""

import struct
import subprocess
import sys

import numpy as np
import pytest
from helpers.synthetic_run import CAMERA, make_steps

from rhs.api.errors import RecordingError
from rhs.recording.mcap_records import LIMIT_BYTES, MAGIC, Message
from rhs.recording.mcap_scan import Report, scan
from rhs.recording.reader import read
from rhs.recording.writer import Recorder


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The bytes of a finished recording of about a dozen chunks, and its messages."""
    path = tmp_path_factory.mktemp("scan") / "run.mcap"
    recorder = Recorder(path, "light", CAMERA)
    for step in make_steps(400):
        recorder.step(step)
    recorder.close()
    messages = list(read(path))
    return path.read_bytes(), messages


def messages_of(path, data):
    path.write_bytes(data)
    reading = read(path)
    return [(m.channel.topic, m.log_ns, m.data) for m in reading], reading.report


def is_subsequence(some, whole):
    rest = iter(whole)
    return all(any(item == other for other in rest) for item in some)


def test_a_whole_file_is_whole(tmp_path, recording):
    data, messages = recording
    found, report = messages_of(tmp_path / "a.mcap", data)
    assert len(found) == len(messages) > 2000 and report.chunks > 8
    assert report.whole and "damaged" not in report.line


def test_cut_at_every_hundredth_it_gives_every_whole_chunk(tmp_path, recording):
    data, messages = recording
    whole = [(m.channel.topic, m.log_ns, m.data) for m in messages]
    counts = []
    for cut in (len(data) * i // 100 for i in range(1, 100)):
        found, report = messages_of(tmp_path / "a.mcap", data[:cut])
        assert found == whole[: len(found)]
        assert not report.whole and str(cut) in report.line and len(report.line.splitlines()) == 1
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[49] > 0.3 * len(whole) and counts[-1] > 0.85 * len(whole)


@pytest.mark.parametrize("flips", [1, 3])
def test_flipped_bits_never_pass_in_silence(tmp_path, recording, flips):
    data, messages = recording
    whole = [(m.channel.topic, m.log_ns, m.data) for m in messages]
    rng = np.random.default_rng(flips)
    kept = []
    for _ in range(60):
        bad = bytearray(data)
        for bit in rng.integers(0, 8 * len(data), flips):
            bad[bit // 8] ^= 1 << (bit % 8)
        try:
            found, report = messages_of(tmp_path / "a.mcap", bytes(bad))
        except RecordingError:  # the first bytes were hit: not an MCAP file any more
            continue
        assert is_subsequence(found, whole)  # never a wrong message
        assert not report.whole, report
        kept.append(len(found) / len(whole))
    assert np.median(kept) > 0.7  # the other chunks are still read


def test_a_damaged_index_costs_nothing_but_is_said(tmp_path, recording):
    data, messages = recording
    bad = bytearray(data)
    bad[-200] ^= 1
    found, report = messages_of(tmp_path / "a.mcap", bytes(bad))
    assert len(found) == len(messages) and not report.whole and "index" in report.line


def test_a_damaged_first_chunk_loses_only_itself(tmp_path, recording):
    """Channels are described in the first chunk; the index at the end describes them again."""
    data, messages = recording
    bad = bytearray(data)
    bad[bad.index(b"zstd") + 100] ^= 0x10
    found, report = messages_of(tmp_path / "a.mcap", bytes(bad))
    assert len(found) > 0.8 * len(messages) and "checksum" in report.line or "unpack" in report.line
    assert "lost" in report.line


@pytest.mark.parametrize(("name", "data"), [
    ("empty.mcap", b""), ("eight.mcap", MAGIC), ("three.mcap", b"\x89MC"),
    ("picture.mcap", b"\x89PNG\r\n\x1a\n" + bytes(100)), ("text.mcap", b"hello world, this is text" * 10)])
def test_what_is_no_mcap_file_is_one_clear_line(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(RecordingError, match="not an MCAP file") as error:
        list(read(tmp_path / name))
    assert len(str(error.value).splitlines()) == 1 and name in str(error.value)


def test_a_folder_is_no_mcap_file(tmp_path):
    with pytest.raises(RecordingError, match="is a folder"):
        read(tmp_path)


def huge(opcode, length, body=b""):
    return MAGIC + struct.pack("<BQ", 1, 8) + bytes(8) + struct.pack("<BQ", opcode, length) + body


def bomb():
    """A chunk of 2 GB of zeros in a few kilobytes."""
    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    packed = b"".join(packer.compress(bytes(1 << 20)) for _ in range(2048)) + packer.flush()
    for claimed in (1000, 2 << 30):
        head = struct.pack("<QQQI", 0, 0, claimed, 1) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(packed))
        yield huge(6, len(head) + len(packed), head + packed)


@pytest.mark.parametrize("length", [1 << 31, 1 << 40, (1 << 63) + 5, (1 << 64) - 1])
@pytest.mark.parametrize("opcode", [3, 5, 6, 9, 12])
def test_a_huge_length_is_not_believed(tmp_path, opcode, length):
    found, report = messages_of(tmp_path / "a.mcap", huge(opcode, length, bytes(100)))
    assert not found and not report.whole and report.cut_at == 25


def test_bombs_stay_within_bounded_memory(tmp_path):
    code = ("import sys; from rhs.recording.reader import read; from rhs.base.provenance import peak_memory_mb\n"
            "r = read(sys.argv[1]); n = len(list(r))\n"
            "print(n, r.report.line)\n"
            "print(peak_memory_mb())\n")
    for number, data in enumerate(bomb()):
        path = tmp_path / f"{number}.mcap"
        path.write_bytes(data)
        done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, timeout=60)
        line, peak_mb = done.stdout.splitlines()
        assert "claims" in line and line.startswith("0 ")
        assert float(peak_mb) * 1024**2 < 2 * LIMIT_BYTES


def test_what_other_writers_do(tmp_path):
    """No chunks, lz4 chunks, no checksums, an attachment, JSON messages without a schema: all read or passed over."""
    from mcap.writer import CompressionType, Writer

    for number, options in enumerate([{"use_chunking": False}, {"compression": CompressionType.LZ4},
                                      {"compression": CompressionType.NONE, "enable_crcs": False}]):
        path = tmp_path / f"{number}.mcap"
        with path.open("wb") as file:
            writer = Writer(file, **options)
            writer.start()
            channel = writer.register_channel("/words", "json", 0)
            for i in range(10):
                writer.add_message(channel, i, b'{"a": 1}', i)
            writer.add_attachment(0, 0, "notes.txt", "text/plain", b"x" * 5000)
            writer.finish()
        reading = read(path)
        assert [m.data for m in reading] == [b'{"a": 1}'] * 10 and reading.report.whole


def test_a_private_record_is_passed_over_and_listed(tmp_path):
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        header = file.tell()
        file.write(struct.pack("<BQ", 0x90, 3) + b"abc")
        writer.add_message(writer.register_channel("/words", "json", 0), 1, b"{}", 1)
        writer.finish()
    reading = read(tmp_path / "a.mcap")
    assert len(list(reading)) == 1 and reading.report.whole
    assert reading.report.unknown == [f"a private record (code 144) at byte {header}"]


def test_two_readers_agree_with_the_package(tmp_path, recording):
    from mcap.reader import make_reader

    data, messages = recording
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    with path.open("rb") as file:
        theirs = [(c.topic, m.log_time, m.data) for _, c, m in make_reader(file).iter_messages(log_time_order=False)]
    assert theirs == [(m.channel.topic, m.log_ns, m.data) for m in messages]


def test_the_report_counts(tmp_path, recording):
    data, messages = recording
    path = tmp_path / "a.mcap"
    path.write_bytes(data)
    report = Report(path, len(data))
    assert sum(isinstance(item, Message) for item in scan(path, report)) == report.messages == report.promised
