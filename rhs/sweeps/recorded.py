"""recordings-v1: frozen recordings, known by the hash of what is in them, and how estimators are scored on them.

The files are nobody's to hand on: a recording says where it is from, and `--data FOLDER` where it lies. Wheels, cameras and
lasers are what they were; there is nothing to drive, so a run is a survey.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rhs.base.errors import ConfigError
from rhs.config.overrides import Word, parse, plain_words
from rhs.metrics.accuracy import nees_of

COMMON = ("task=survey", "source=replay", "recording=off", "pictures=off", "seed=0")
TOLERANCE_S = 0.02  # between an estimate and the truth it is compared with
CELLS = ("combination", "building", "seed", "status", "views", "tracked_share", "ate_m", "rpe_m", "nees", "relations_m",
         "revisits_m", "inconsistency", "cause")
MEANINGS = {
    "ended": "recordings that were read to their end",
    "tracked_share": "views whose motion was measured: least over recordings",
    "ate_m": "absolute trajectory error after closing, aligned: of each recording that has true poses",
    "rpe_m": "error of the motion from view to view, root mean square: of each of them",
    "nees": "squared error of the position as believed on the way, by its stated variance, per dimension, mean: 1 is "
            "honest, more is too sure; of each of them",
    "relations_m": "error of the published relations between scans, mean",
    "revisits_m": "the same of places seen again",
    "inconsistency": "share of what laser beams passed through that other scans call a wall, after closing: of each log",
}
OURS = {
    "procrustes": "odometry=procrustes", "orb": "odometry=orb", "keyframe": "odometry=keyframe", "gicp": "odometry=gicp",
    "scan_to_map+scan_graph": "sensor=laser odometry=scan_to_map loop_closer=scan_graph",
    "scan_to_map alone": "sensor=laser odometry=scan_to_map loop_closer=none",
    "wheels alone": "sensor=laser odometry=wheel loop_closer=none",
}


@dataclass(frozen=True)
class Recording:
    """path: in the data folder. sha256: of `content_hash`. sensor: who can be asked. words: how it is read. files: what else
    belongs to it. origin: where it is from, and how to make it."""

    name: str
    path: str
    sha256: str
    sensor: str
    words: str
    origin: str
    files: tuple[str, ...] = ()

    def read_from(self, data: Path) -> list[Word]:
        """The words that read it."""
        path = str(data / self.path)
        return [Word("source.path", path, f"source.path={path}"), *plain_words(parse(self.words.split()))]


RECORDINGS = (
    Recording("tum_fr1_rpy_60", "rgbd/tum_fr1_rpy_60",
              "15e90c70e954fb08e6931c5daa31cfe3ce82f6d6d77d775555c00b3d154124a9", "rgbd", "source.camera=tum_fr1",
              "TUM RGB-D freiburg1_rpy (CC BY 4.0): the first 60 pairs of associate.py, with rgb.txt, depth.txt, "
              "associations.txt, groundtruth.txt"),
    Recording("open3d_5", "rgbd/open3d_5",
              "d593f699bccc266ae3c752467022c1ef52e487001cc1bcf6fa4b112a776cbaac", "rgbd", "",
              "Open3D's test data (MIT): five pairs and odometry.log"),
    Recording("aces", "laser/aces.clf.bz2",
              "6e2c219c5e4f060ac152602f0c0eb979ca9ade4d7495165bbb7da4e7dce8638d", "laser", "",
              "Radish / MOLA test data (CC BY 3.0), and its relations (Kuemmerle et al. 2009)", ("laser/aces.relations",)),
    Recording("mit_csail", "laser/mit-csail.clf.bz2",
              "a4a90b4074228f947ee6183c0ccb790555ed7d0f951da4fb5b8e04fe5d41611e", "laser", "",
              "Radish / MOLA test data (CC BY 3.0)"),
)
BY_NAME = {one.name: one for one in RECORDINGS}


def content_hash(data: Path, recording: Recording) -> str:
    """SHA-256 of the names and bytes of its files, in the order of their names. Raises ConfigError where one is missing."""
    digest = hashlib.sha256()
    for name in (recording.path, *recording.files):
        path = data / name
        found = [path] if path.is_file() else sorted(one for one in path.rglob("*") if one.is_file())
        if not found:
            raise ConfigError(f"bench recordings-v1: nothing at {path} (--data FOLDER); put there: {recording.origin}")
        for one in found:
            inner = hashlib.sha256(one.read_bytes()).hexdigest()
            digest.update(f"{one.relative_to(data).as_posix()} {inner}\n".encode())
    return digest.hexdigest()


def check_data(data: Path, names: Sequence[str]) -> None:
    """Raises ConfigError, in one line, where a recording is missing or another than the frozen one."""
    for name in names:
        known = BY_NAME[name]
        if (found := content_hash(data, known)) != known.sha256:
            raise ConfigError(f"bench recordings-v1: {data / known.path}: found content {found[:16]}, expected "
                              f"{known.sha256[:16]}; it is {known.origin}")


def question_hash(name: str) -> str:
    """16 hex digits of everything an answer rests on: the recordings, how they are read, the columns."""
    text = json.dumps([name, [[one.name, one.path, one.files, one.sha256, one.sensor, one.words] for one in RECORDINGS],
                       COMMON, CELLS, TOLERANCE_S], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def asked_of(words: str) -> tuple[str, ...]:
    """Names of the recordings that a combination is asked about: those of its sensor (`sensor=`, or `rgbd`)."""
    sensor = next((word.partition("=")[2] for word in reversed(words.split()) if word.startswith("sensor=")), "rgbd")
    found = tuple(one.name for one in RECORDINGS if one.sensor == sensor or (sensor == "mono" and one.sensor == "rgbd"))
    if not found:
        raise ConfigError(f"bench recordings-v1: sensor={sensor}: there are recordings for rgbd, mono and laser")
    return found


def cells_of(combination: str, name: str, row: Mapping[str, Any], folder: Path) -> dict[str, str]:
    """A run as it stands in the table; figures in 9 digits, nothing where there is none."""
    figures = {"views": "survey_steps", "tracked_share": "tracked_share", "ate_m": "ate_rmse_m", "rpe_m": "rpe_trans_m",
               "relations_m": "relations_trans_m", "revisits_m": "revisits_trans_m", "inconsistency": "map_inconsistency"}
    values = {cell: row.get(column) for cell, column in figures.items()} | {"nees": nees_of(folder)}
    said = {cell: f"{value:.9g}" if isinstance(value, int | float) and np.isfinite(value) else ""
            for cell, value in values.items()}
    cause = " ".join(str(row.get("cause") or row.get("reason") or "").split())
    cells = {"combination": combination, "building": name, "seed": "0", "status": str(row["status"]), **said, "cause": cause}
    return {one: cells[one] for one in CELLS}


# --- the page -------------------------------------------------------------------------------------------------------

def scores(rows: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """The scores of one combination, as they stand on the page."""
    def each(cell: str) -> str:
        return ", ".join(f"{row['building']} {float(row[cell]):.3g}" for row in rows if row[cell]) or "-"

    tracked = [float(row["tracked_share"]) for row in rows if row["tracked_share"]]
    ended = sum(row["status"] == "ok" for row in rows)
    return {"ended": f"{ended} of {len(rows)}", "tracked_share": f"{min(tracked):.3g}" if tracked else "-",
            **{cell: each(cell) for cell in ("ate_m", "rpe_m", "nees", "relations_m", "revisits_m", "inconsistency")}}


def rank(rows: Sequence[Mapping[str, str]]) -> tuple[float, ...]:
    """Sorts best first: recordings ended, errors of the way (true poses, relations), walls looked through."""
    def mean(*cells: str) -> float:
        values = [float(row[cell]) for row in rows for cell in cells if row[cell]]
        return float(np.mean(values)) if values else np.inf

    return (-sum(row["status"] == "ok" for row in rows) / len(rows), mean("ate_m", "relations_m"), mean("inconsistency"))
