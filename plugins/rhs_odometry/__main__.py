"""Saved tracks run again through a monocular filter: `python -m rhs_odometry TRACKS FILTER [key=value ...]`.

TRACKS is a run folder (of a run with `odometry.save_tracks=true`), a tracks file, or synthetic:PLAN[:SEED] with PLAN one
of straight, corner, square. Prints the figures; --picture FILE.png draws the errors and the top view.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from rhs.api.errors import ConfigError, RhsError


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m rhs_odometry", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tracks", help="run folder, tracks file, or synthetic:straight|corner|square[:seed]")
    parser.add_argument("filter", help="corridor_ekf, section_ekf or tube_ekf")
    parser.add_argument("settings", nargs="*", help="key=value settings of the filter")
    parser.add_argument("--picture", type=Path, help="PNG to draw")
    chosen = parser.parse_args(words)
    try:
        return _run(chosen)
    except RhsError as error:
        print(f"rhs_odometry: {error}", file=sys.stderr)
        return error.exit_code


def _run(chosen: argparse.Namespace) -> int:
    from .tracks.replay import draw, figures, open_tracks, run_filter
    from .tracks.synthetic import named_tracks

    if chosen.tracks.startswith("synthetic:"):
        tracks = named_tracks(chosen.tracks.removeprefix("synthetic:"))
    else:
        tracks = open_tracks(Path(chosen.tracks))
    run = run_filter(chosen.filter, dict(_pair(word) for word in chosen.settings), tracks)
    for name, value in figures(run).items():
        print(f"{name:24s} {value:.4g}")
    if chosen.picture is not None:
        draw(run, f"{chosen.tracks} · {chosen.filter} {' '.join(chosen.settings)}", chosen.picture)
    return 0


def _pair(word: str) -> tuple[str, Any]:
    import yaml

    key, found, value = word.partition("=")
    if not found:
        raise ConfigError(f"{word}: expected key=value, for example motion=none")
    return key, yaml.safe_load(value)


if __name__ == "__main__":
    sys.exit(main())
