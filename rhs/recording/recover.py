"""A new, indexed MCAP file from all that is whole in another."""

from __future__ import annotations

from pathlib import Path

from rhs.api.files import write_whole
from rhs.base.errors import RecordingError

from .mcap_file import McapWriter
from .mcap_records import Note
from .mcap_scan import Report, scan
from .reader import Reading


def recover(source: Path, target: Path) -> tuple[Report, int]:
    """Copy messages and notes byte for byte, in their order; returns the scan of the source and the count written.

    The new file is read back before it gets its name. Attachments are not copied.
    """
    report = Reading(source).report

    def write(path: Path) -> None:
        writer = McapWriter(path)
        for item in scan(source, report):
            if isinstance(item, Note):
                writer.note(item.name, item.values)
            else:
                channel, schema = item.channel, item.channel.schema
                writer.put_raw(channel.topic, item.data, item.log_ns, publish_ns=item.publish_ns, sequence=item.sequence,
                             definition=(schema.name, schema.encoding, schema.data), encoding=channel.encoding)
        if not report.whole:
            writer.note("rhs.recovered", {"what": report.line})
        writer.close()
        _check(path, report.messages)

    write_whole(target, write)
    return report, report.messages


def _check(path: Path, expected: int) -> None:
    reading = Reading(path)
    count = sum(1 for _ in reading)
    if count != expected or not reading.report.whole:
        raise RecordingError(f"{path} reads back as {count} of {expected} messages; the disk may be failing")
