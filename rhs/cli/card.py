"""`python -m rhs card KIND=NAME [KIND.KEY=VALUE ...] [output=FOLDER]`: one page about one part, of any package.

    python -m rhs card localiser=sift_db
    python -m rhs --plugin my.py card planner=mine planner.samples=500
    python -m rhs card localiser=mine source=replay source.path=LOG,OTHER sensor=laser map=MAP.yaml  # on yours
    python -m rhs card odometry=mine source=replay source.path=FOLDER

Contract (rhs.testing), planted questions or drives with known truth, the same for everybody, ours beside it; calibration,
break points, CPU time, memory. With words of a run on recordings, a localiser (task=localise; a start every 15 m, unless
start= or restart_every_m= is typed) or an odometry is judged on these instead. Files: card.html (one page that needs no
other), card.json, on recordings the folders of the runs. Exit code 0 when it keeps its contract and no fault was found, 1
otherwise, 2 refused.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path

from rhs.api import settings
from rhs.base.commands import aligned
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.config.overrides import parse, plain_words
from rhs.testing.checks import CHECKED

HOME = Path("results") / "cards"


def main(words: Sequence[str]) -> int:
    """The command."""
    from rhs.card.card import card_of, table
    from rhs.card.page import page_of
    from rhs.reports.export import write_texts

    output = next((Path(word.partition("=")[2]) for word in words if word.startswith("output=")), None)
    words = [word for word in words if not word.startswith("output=")]
    kind = words[0].partition("=")[0] if words else ""
    question = [word for word in words[1:] if not word.startswith(f"{kind}.")]
    recorded = any(word.partition("=")[0] == "source" for word in question)
    kind, name, chosen = part_of([word for word in words if word not in question] if recorded else words, "card")
    folder = output or HOME / f"{kind}_{name}{'_on_recordings' if recorded else ''}"
    if recorded:
        from .card_recordings import card_on

        card = card_on(kind, name, chosen, [word for word in words[1:] if word not in question], question, folder)
    else:
        card = card_of(kind, name, chosen, tell=say)
    write_texts(folder, {"card.json": json.dumps(card.content, indent=1) + "\n", "card.html": page_of(card)})
    say("")
    for line in card.content["verdict"]:
        sys.stdout.write(f"{line}\n")
    names, rows = table(card.content)
    if rows:
        sys.stdout.write("\n" + "\n".join(aligned([names, *rows])) + "\n")
    sys.stdout.write(f"files: {folder}\n")
    return 0 if card.passes else 1


def part_of(words: Sequence[str], command: str) -> tuple[str, str, object]:
    """Kind, name and settings of the part that somebody types after a command. Raises ConfigError."""
    rest = plain_words(parse(list(words)))
    if not rest or rest[0].key not in CHECKED:
        wrong = "say which part" if not rest else (f"{rest[0].text} is no part whose contract can be checked"
                                                   f"{settings.nearest(rest[0].key, list(CHECKED))}")
        raise ConfigError(f"{command}: {wrong}; for example: python -m rhs {command} planner=prm; "
                          f"kinds: {', '.join(CHECKED)}")
    kind, name = rest[0].key, str(rest[0].value)
    cls = registry.load(kind, name)
    registry.check_requirements(kind, name, cls)
    stray = [word.text for word in rest[1:] if not word.key.startswith(f"{kind}.")]
    if stray:
        raise ConfigError(f"{command} {stray[0]}: expected settings of {kind}={name}, {kind}.KEY=VALUE")
    values: dict[str, object] = {}
    for word in rest[1:]:
        node = values
        *above, last = word.key.split(".")[1:]
        for key in above:
            node = node.setdefault(key, {})  # type: ignore[assignment]
        node[last] = word.value
    return kind, name, settings.make(cls, values, kind)


def say(what: str) -> None:
    """What is under way, where somebody looks at the terminal."""
    if sys.stderr.isatty():
        sys.stderr.write(f"\r\033[K{what}" + (" ..." if what else ""))
        sys.stderr.flush()
