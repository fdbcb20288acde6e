"""Which files are a bag, and opening them."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

from rhs.api.errors import ConfigError
from rhs.recording.mcap_records import MAGIC
from rhs.recording.mcap_scan import open_scan

from .foxglove import McapBag

PART_S = 5.0  # between the end of a part and the beginning of the next; a recorder that splits loses less
LIVOX = {"CustomPoint": "uint32 offset_time\nfloat32 x\nfloat32 y\nfloat32 z\nuint8 reflectivity\nuint8 tag\nuint8 line",
         "CustomMsg": "std_msgs/Header header\nuint64 timebase\nuint32 point_num\nuint8 lidar_id\nuint8[3] rsvd\n"
                      "CustomPoint[] points"}  # which .db3 files do not say
SPLIT, SPLIT_TIME = re.compile(r"(.*)_(\d+)\.\w+"), re.compile(r"_?\d{4}(-\d\d){5}$")


def is_bag(path: Path) -> bool:
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(_parts(path))
    return path.suffix in (".bag", ".mcap", ".db3")


def _parts(folder: Path) -> list[Path]:
    """The files of a bag in a folder without metadata.yaml: a lone one, or those that were split (walk_0.bag, walk_1.bag;
    ROS 1 puts the time of each before its number)."""
    for ending in ("mcap", "bag"):
        files = list(folder.glob(f"[!.]*.{ending}"))
        if len(files) == 1:
            return files
        split = sorted((int(part[2]), SPLIT_TIME.sub("", part[1]), file) for file in files
                       if (part := SPLIT.fullmatch(file.name)))
        if files and [number for number, *_ in split] == [*range(len(files))] and len({name for _, name, _ in split}) == 1:
            return [file for *_, file in split]
    return []


def opened(path: Path):
    """An open AnyReader, or ConfigError in the user's words."""
    from rosbags.highlevel import AnyReader

    files = _parts(path) if path.is_dir() and not (path / "metadata.yaml").is_file() else [path]
    file = files[0]
    if file.suffix == ".db3":
        raise ConfigError(f"{path}: a .db3 file alone cannot be read; give the folder that holds its "
                          "metadata.yaml (where that is lost: ros2 bag reindex FOLDER)")
    try:
        for one in files if file.suffix == ".mcap" else ():
            open_scan(one)[0].close()  # refuses what would unpack without end
        if len(files) == 1 and file.suffix == ".mcap" and (foreign := _of_others(file)) is not None:
            return foreign
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE)
        for driver in ("livox_ros_driver", "livox_ros_driver2"):
            store.register({name: kind for word, text in LIVOX.items()
                            for name, kind in get_types_from_msg(text, f"{driver}/msg/{word}").items()})
        reader = AnyReader(files, default_typestore=store)
        reader.open()
    except Exception as error:  # the library raises many kinds for damaged files
        if other := _other_messages(file):
            raise ConfigError(f"{path}: {other}") from error
        short = " ".join(str(error).split())[:120]
        hint = _hint(path, file, short)
        raise ConfigError(f"{path}: cannot be read as a bag ({type(error).__name__}: {short}){hint}") from error
    _check_parts(reader, files)
    return reader


def _hint(path: Path, file: Path, short: str) -> str:
    """What to type for a bag that cannot be opened, by what the library said (short)."""
    if "files are missing" in short:
        return f"; put them back, or type: ros2 bag reindex {path}"
    if "metadata" in short:
        return f"; its metadata.yaml is broken; type: rm {path / 'metadata.yaml'}; ros2 bag reindex {path}"
    if file.suffix == ".bag":
        return f"; if it was cut: rosbag reindex {file.name}"
    parts = sorted([*path.glob("*.mcap"), *path.glob("*.db3")]) if path.is_dir() else [file]
    cut = next((part for part in parts if part.suffix == ".mcap" and not _is_closed(part)), None)
    if cut is not None:
        then = " and put it in its place" if len(parts) > 1 else ""
        return f"; if it was cut: python -m rhs convert {cut} whole.mcap{then}"
    named = next((part for part in parts if part.suffix == ".db3" and str(part) in short), None)
    return "" if named is None else (f"; if it was cut: sqlite3 {named} .dump | sed 's/^ROLLBACK.*/COMMIT;/' | sqlite3 "
                                     "whole.db3 and put it in its place")


def _is_closed(file: Path) -> bool:
    """Whether an MCAP file ends as one that was written to its end does."""
    with file.open("rb") as stream:
        stream.seek(0, 2)
        stream.seek(max(0, stream.tell() - len(MAGIC)))
        return stream.read() == MAGIC


def _of_others(file: Path) -> McapBag | None:
    """An MCAP file of Foxglove's messages or those of ROS 1; None of another, or one that is broken."""
    with suppress(Exception):  # said where it is read as a bag of ROS 2
        return McapBag(file)
    return None


def _other_messages(file: Path) -> str:
    """Of an MCAP file that is whole and of no ROS 2, what its messages are and what makes one that is read; else empty."""
    from mcap.reader import make_reader

    if file.suffix != ".mcap":
        return ""
    try:
        with file.open("rb") as stream:
            reader = make_reader(stream)
            profile, summary = reader.get_header().profile, reader.get_summary()
    except Exception:  # damaged: said by who asked
        return ""
    if summary is None:
        return ""
    kinds = sorted({c.message_encoding for c in summary.channels.values()})
    if profile == "ros1" or "ros1" in kinds:
        return "found messages of ROS 1 in MCAP; give the .bag that it was made of"
    if kinds == ["cdr"] and profile != "ros2":
        return (f"found the profile {profile!r} in MCAP; expected ros2: play it (ros2 bag play {file.name}) and record that "
                "(ros2 bag record -a -s mcap)")
    if not kinds or kinds == ["cdr"]:
        return ""
    schemas = sorted({schema.name for schema in summary.schemas.values()})
    return (f"found messages in {', '.join(kinds)}; expected those of ROS (cdr): record them by ros2 bag record -s mcap; it "
            f"holds {', '.join(schemas[:4])}")


def _check_parts(reader, files: list[Path]) -> None:
    """Refuse bags that are numbered as the parts of one are, and are recordings of their own."""
    parts = sorted((part.start_time, part.end_time, {c.topic for c in part.connections}) for part in reader.readers)
    for (_, end, topics), (begin, _, others) in zip(parts[:-1], parts[1:], strict=True):
        apart_s = 1e-9 * (begin - end)
        if not -PART_S <= apart_s <= PART_S or not topics & others:
            reader.close()
            raise ConfigError(f"{files[0].parent}: found {files[0].name} to {files[-1].name}, two of them {apart_s:.1f} s "
                              f"apart or without a common topic: recordings of their own? type source.path={files[0]}")
