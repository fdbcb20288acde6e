"""`python -m rhs COMMAND ...`: everything but runs and sweeps."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Callable, Sequence
from importlib import import_module

from rhs.api.contracts import PLUGIN_KINDS
from rhs.api.settings import nearest
from rhs.base.errors import ConfigError

# command -> (module, what it does). Each module's main(arguments) returns the exit code.
COMMANDS = {
    "table": ("rhs.reports.table", "the table of run folders"),
    "compare": ("rhs.cli.commands", "paired differences between the values of a part or setting: compare planner FOLDER"),
    "report": ("rhs.reports.report", "pictures and pages of run and sweep folders"),
    "evaluate": ("rhs.cli.evaluate", "the figures of a run again, or ATE and RPE of two trajectories"),
    "convert": ("rhs.cli.convert", "convert recordings: recover a cut one, to and from TUM folders"),
    "blame": ("rhs.cli.blame", "how much each part of the chain cost a run: blame RUN"),
    "break": ("rhs.cli.break_point", "the level of a setting at which half of the runs fail: break sensor.KEY=1..16 ..."),
    "atlas": ("rhs.cli.atlas", "the same for several settings and combinations, in one picture: atlas combos.yaml"),
    "sensitivity": ("rhs.cli.sensitivity", "which settings of a part matter when halved or doubled: sensitivity odometry=x"),
    "gate": ("rhs.cli.gate", "did a change help? compared in pairs with the runs of a folder: gate FOLDER planner=mine"),
    "verify": ("rhs.cli.verify", "run it again and compare the rows: verify RUN"),
    "recover": ("rhs.cli.recover", "the row and table of a run that was killed: recover RUN"),
    "worlds": ("rhs.cli.worlds", "list the buildings; worlds --pictures FOLDER draws their plans"),
    "cache": ("rhs.cli.cache", "the surveys that sweeps keep for later ones: cache, cache clear"),
    "check": ("rhs.cli.check", "does a plugin keep its contract? check planner=mine"),
    "card": ("rhs.cli.card", "a page about one part: contract, faults, accuracy, calibration, cost: card planner=mine"),
    "bench": ("rhs.cli.bench", "a frozen benchmark with reproducible rows: bench planning-v1 --mine planner=mine"),
    "new": ("rhs.cli.new", "write a package with a plugin to start from: new planner my_planner"),
    "completion": ("rhs.cli.completion", "tab completion of the command `rhs`: completion bash | zsh | fish"),
    "help": ("rhs.cli.commands", "help KIND | settings | columns | COLUMN | events | statuses | kinds | commands"),
}

TOPICS = ("commands", "columns", "events", "statuses", "settings", "kinds", *PLUGIN_KINDS)
EXPLAINED = ("blame", "cache", "check", "card", "new", "completion", "compare")  # --help prints their docstring
PLAIN = ("cache", "new", "completion", "help")  # without options


def command(words: Sequence[str]) -> Callable[[], int] | None:
    """What these words ask for, or None when they describe a run. Raises ConfigError for a word that is neither."""
    if not words or words[0].startswith("-") or "=" in words[0] or words[0].startswith(("~", "+")):
        return None
    name, rest = words[0], [word for word in words[1:] if word != "--debug"]
    if name in PLUGIN_KINDS:
        raise ConfigError(f"{name} is a kind of part: type {name}=NAME, or python -m rhs help {name} for those there are")
    if name not in COMMANDS:
        from rhs.config.overrides import check_no_path

        check_no_path(name)
        raise ConfigError(f"{name}: neither a command nor key=value{nearest(name, list(COMMANDS))}; "
                          f"commands: {', '.join(COMMANDS)}")
    asked = any(word in ("-h", "--help") for word in rest)
    if name == "help":
        return lambda: show_help([] if asked else rest)
    if asked and name in EXPLAINED:
        return lambda: _explain(name)
    if name in PLAIN and (option := next((word for word in rest if word.startswith("-")), "")):
        raise ConfigError(f"{name}: unknown option {option}; see python -m rhs {name} --help")
    if name == "compare":
        return lambda: compare(rest)
    return lambda: int(import_module(COMMANDS[name][0]).main(rest))


def plugin_files(words: list[str]) -> tuple[list[str], list[str]]:
    """(files after --plugin, the other words)."""
    files, rest = [], []
    waiting = iter(words)
    for word in waiting:
        if word == "--plugin":
            files.append(next(waiting, ""))
        elif word.startswith("--plugin="):
            files.append(word.partition("=")[2])
        else:
            rest.append(word)
    return files, rest


def _explain(name: str) -> int:
    """Print the docstring of a command that has no options."""
    said = compare.__doc__ if name == "compare" else import_module(COMMANDS[name][0]).__doc__
    sys.stdout.write(textwrap.dedent(said or "").replace("`", "").rstrip() + "\n")
    return 0


def compare(words: Sequence[str]) -> int:
    """`python -m rhs compare KEY FOLDER ...`: paired differences between the values of a part or setting, same seeds.

    It is `python -m rhs table FOLDER ... --compare KEY`; python -m rhs table --help has the rest.
    """
    from rhs.reports.table import main

    if len(words) < 2 or words[0].startswith("-"):
        found = f"found {' '.join(words)}; " if words else ""
        raise ConfigError(f"compare: {found}say what and where, for example: python -m rhs compare planner results/sweeps")
    return main([*words[1:], "--compare", words[0]])


def show_help(words: Sequence[str]) -> int:
    """`help TOPIC`, or what a column, an event or a status of that name means."""
    from rhs.config.dictionary import lines

    topic = words[0] if words else "commands"
    if len(words) > 1:
        raise ConfigError(f"help {' '.join(words)}: one word at a time; type python -m rhs help {words[1]}")
    if topic == "commands":
        for name, (_, meaning) in COMMANDS.items():
            sys.stdout.write(f"  python -m rhs {name:<12} {meaning}\n")
        sys.stdout.write("  python -m rhs --help       options of a run, parts to choose from\n")
        return 0
    from rhs.config import registry

    if topic == "kinds":
        for kind in PLUGIN_KINDS:
            sys.stdout.write(f"  {kind:<12}{', '.join(registry.names(kind)) or 'none registered'}\n")
        return 0
    from .help_text import KINDS, help_text, settings_text

    parts = [f"{kind}={topic}" for kind in KINDS if topic in registry.names(kind)]
    if parts and topic not in (*PLUGIN_KINDS, "settings"):
        sys.stdout.write(help_text(parts) + "\n")
        return 0
    if topic == "settings" or topic in PLUGIN_KINDS:
        sys.stdout.write(settings_text(KINDS if topic == "settings" else [topic]) + "\n")
        return 0
    wanted = {"columns": "", "events": "Events", "statuses": "tatus"}.get(topic)
    told = [line for line in lines() if (line[1] == topic if wanted is None else wanted in line[0])]
    if not told:
        raise ConfigError(f"help {topic}: there is no such help{nearest(topic, [*TOPICS, *(line[1] for line in lines())])} "
                          f"(there is {', '.join(TOPICS)}, and the name of each part)")
    section = ""
    for title, name, meaning in told:
        if title != section:
            sys.stdout.write(f"{'' if not section else chr(10)}{title}\n")
            section = title
        for number, line in enumerate(textwrap.wrap(meaning, 82) or [""]):
            sys.stdout.write(f"  {name if number == 0 else '':<32} {line}\n")
    return 0
