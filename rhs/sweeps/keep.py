"""What stays of each job of a sweep: its row always, its folder where that was asked for (`keep=all|failures|none`).

Where folders are not kept, rows go to a shard (rhs.runfolder.shards); a folder is removed once the disk has its row.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

from rhs.base.errors import ConfigError, RhsError
from rhs.config.overrides import Word
from rhs.metrics.success import with_success
from rhs.runfolder.row import CHOICES, read_row, sound
from rhs.runfolder.shards import Line, Shard, words_key

from .jobs import Job


def wanted(keep: str, row: object) -> bool:
    """Whether the folder of a job with this row is kept: of a failure, where it did not end well or did not succeed."""
    if not isinstance(row, dict) or keep == "all":
        return True
    return keep == "failures" and (row.get("status") != "ok" or row.get("success") == 0)


class Keeper:
    """Writes the rows of one sweeping process and removes the folders that are not wanted."""

    def __init__(self, sweep: Path, keep: str) -> None:
        self.sweep, self.keep = sweep, keep
        self.shard = Shard(sweep)
        self.broken: RhsError | None = None  # from then on nothing is removed
        self._unwanted: list[Path] = []

    def take_folder(self, job: Job) -> None:
        """The folder of a job that is over becomes a line."""
        folder = self.sweep / job.name
        try:
            row = read_row(folder / "row.json")
        except RhsError:
            return  # a job that could not even be started has none; whatever is there stays
        if not wanted(self.keep, row):
            self._unwanted.append(folder)
        self.take(line_of(job, row).text())

    def take(self, text: str) -> None:
        """One line. A disk that refuses it is remembered, and raised by `close`."""
        if self.broken is not None:
            return
        try:
            if self.shard.add(text):
                self._remove()
        except RhsError as error:
            self.broken = error

    def tick(self) -> None:
        """Time has passed."""
        if self.broken is None and self.shard.sync():
            self._remove()

    def close(self) -> None:
        """Have all of it on the disk. Raises RhsError when it is not."""
        try:
            self.shard.close()
        except RhsError as error:
            self.broken = self.broken or error
        if self.broken is not None:
            raise self.broken
        self._remove()

    def _remove(self) -> None:
        while self._unwanted:
            shutil.rmtree(self._unwanted.pop(), ignore_errors=True)


def line_of(job: Job, row: dict[str, object]) -> Line:
    """What a shard holds of a job."""
    return Line(job.name, words_key(job.words), job.varied, row)


def refused(words: Sequence[Word], swept: Sequence[str], error: ConfigError) -> Line:
    """What a shard holds of a job whose words do not fit each other."""
    chosen = [word for word in words if word.key in (*CHOICES, "seed")]
    columns = {word.key: word.value for word in chosen if isinstance(word.value, str | int)}
    row = sound(with_success({**columns, "status": "refused", "reason": str(error)}))
    told = ",".join(word.text for word in words if word.key in swept)
    key = words_key([word.text for word in words])
    return Line(f"{re.sub(r'[^A-Za-z0-9._=,+-]', '-', told).strip('.-')[:60]}_{key}", key, {}, row)
