"""The command line: `python -m rhs [options] key=value ...`. The only place that prints or exits.

Exit codes: 0 everything asked for was done; 1 it failed; 2 refused before anything ran; 3 finished, but something in it
failed or was lost, or the mission was not achieved; 130 and 143 interrupted.
"""

from __future__ import annotations

import os
import sys

from rhs.base.processes import adopt_orphans, allow_helpers, kill_strays, raises, steady

os.environ |= steady()  # before numpy is imported

import argparse
import atexit
import faulthandler
import gc
import io
import signal
import threading
import warnings
from contextlib import suppress
from pathlib import Path

from rhs.base.commands import Arguments, answered, plain
from rhs.base.errors import ConfigError, EngineError, RhsError
from rhs.base.system import ENDINGS

from .arguments import JOBS, TIMEOUT, Number, add, check, limits
from .commands import command, plugin_files
from .one_run import Terminated, one_run
from .streams import tell_errors_beside, warnings_in_lines

COLLECT_AFTER = 20_000  # new objects: what is loaded at the start is no garbage, and a run makes little
USAGE = "python -m rhs [options] key=value ..."
OF_ONE_RUN = ("timeout", "memory_mb")  # the others are for the jobs of a sweep
LIMITS = {"jobs": JOBS, "timeout": TIMEOUT, "fail_fast": Number(0, low=0, high=1_000_000),
          "memory_mb": Number(0.0, low=0.0, high=1e7, unit="MB"), "retries": Number(1, low=0, high=100)}


def main(words: list[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = sys.argv[1:] if words is None else words
    debug = "--debug" in words  # wherever it stands, before the name of a command too
    words = [word for word in words if word != "--debug"] + ["--debug"] * debug
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a terminal may lack a letter of a folder's name
    warnings.showwarning = warnings_in_lines()
    ends = [number for number in ENDINGS if signal.getsignal(number) is not signal.SIG_IGN]  # nohup
    terminate = raises(Terminated)
    before = {number: signal.signal(number, terminate) for number in ends}
    try:
        return answered(lambda: _asked(words), debug=debug)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _asked(words: list[str]) -> int:
    """A command, a run or a sweep."""
    files, rest = plugin_files(words)
    if files:
        from rhs.config.loose import load_files

        load_files(files, rest)
    if (ask := command(rest)) is not None:
        return ask()
    return _run(_arguments().parse_intermixed_args(rest))


def entry() -> int:
    """The console script `rhs`. What a part started ends with it: processes, and threads that would be waited for."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:  # while this was loaded
        signal.signal(signal.SIGINT, signal.default_int_handler)
    gc.set_threshold(COLLECT_AFTER)
    open_streams()
    if "--debug" not in sys.argv:
        tell_errors_beside()
    with suppress(RuntimeError, OSError, ValueError):  # there is no stderr
        faulthandler.enable(all_threads=False)  # a part that crashes the process is told with its file and line
    adopt_orphans()
    allow_helpers()
    try:
        code = main()
    except KeyboardInterrupt:  # a second one, while the first was answered
        code = 130
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # what is left is to end
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):  # a part took it away, or closed it
            stream.flush()
    if not any(word.startswith("live=") for word in sys.argv):  # a viewer stays open
        kill_strays(os.getpid())
    if any(not thread.daemon and thread is not threading.main_thread() for thread in threading.enumerate()):
        os._exit(code)
    if sys.getprofile() is None and sys.gettrace() is None:
        _leave(code)
    return code


def open_streams() -> None:
    """Whoever starts this without stdin, stdout or stderr (`2>&-`, a service) gets none of what is written there, and no
    file of a run takes their numbers, to which libraries write."""
    while (descriptor := os.open(os.devnull, os.O_RDWR)) < 3:
        os.set_inheritable(descriptor, True)  # what is started has them too
    os.close(descriptor)
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))


def _leave(code: int) -> None:
    """End without taking the interpreter apart, which takes 0.4 s after a run. Exit functions run, and what a part wrote
    to a file that it left open is in it."""
    atexit._run_exitfuncs()
    for one in gc.get_objects():
        if type(one) in (io.TextIOWrapper, io.BufferedWriter, io.BufferedRandom):
            with suppress(OSError, ValueError):  # a pipe that nobody reads, a file that is closed
                one.flush()
    os._exit(code)


def _arguments() -> argparse.ArgumentParser:
    parser = Arguments(prog="python -m rhs", usage=USAGE, add_help=False, allow_abbrev=False)
    parser.add_argument("-h", "--help", action="store_true")
    parser.add_argument("-m", "--multirun", action="store_true")
    parser.add_argument("--resume", nargs="?", const="")
    parser.add_argument("--config-dir", action="append", default=[])
    add(parser, {"version": False, "cfg": False, "force": False, "debug": False, **LIMITS})
    parser.add_argument("overrides", nargs="*")
    parser.set_defaults(**dict.fromkeys(LIMITS))  # None: not typed
    return parser


def _run(arguments: argparse.Namespace) -> int:
    if arguments.resume and "=" in arguments.resume and not Path(arguments.resume).is_dir():
        arguments.overrides.append(arguments.resume)  # `--resume key=value`: the folder is in output=
        arguments.resume = ""
    if arguments.cfg and "job" in arguments.overrides:
        arguments.overrides.remove("job")  # Hydra's habit: --cfg job
    if arguments.version:
        from importlib.metadata import version

        print(f"rhs {version('rhs')}")
        return 0
    if arguments.help:
        from .help_text import help_text

        print(help_text(arguments.overrides))
        return 0
    _check_hydra()
    folders = tuple(_config_dir(text) for text in arguments.config_dir)
    if arguments.multirun or arguments.resume is not None:
        return _sweep(arguments, folders)
    from rhs.config.compose import compose_config

    config = compose_config(arguments.overrides, folders=folders)
    if arguments.cfg:
        import yaml

        from rhs.config.compose import to_plain

        print(yaml.safe_dump(to_plain(config), sort_keys=False), end="")
        return 0
    typed = {name: getattr(arguments, name) for name in LIMITS if getattr(arguments, name) is not None}
    if stray := [name for name in typed if name not in OF_ONE_RUN]:
        raise ConfigError(f"--{stray[0].replace('_', '-')} is for the jobs of a sweep; add -m, or leave it out")
    check(arguments, {name: LIMITS[name] for name in typed})
    return one_run(config, arguments.debug, typed.get("timeout", 0.0), typed.get("memory_mb", 0.0))


def _sweep(arguments: argparse.Namespace, folders: tuple[Path, ...]) -> int:
    for name, number in LIMITS.items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, number.default)
    from rhs.config.loose import match
    from rhs.config.overrides import quoted
    from rhs.runfolder.folders import claim_sweep
    from rhs.sweeps import sweep

    resume, words = arguments.resume is not None, list(arguments.overrides)
    before: dict = {}
    if arguments.resume == "" and not any(word.startswith("output=") for word in words):
        raise ConfigError("--resume: which sweep? type python -m rhs --resume FOLDER")
    if arguments.resume:
        before = sweep.recall(Path(arguments.resume))
        typed = {word.partition("=")[0] for word in words}
        words = [word for word in before["words"] if word.partition("=")[0] not in {*typed, "output"}
                 and not ("engine" in typed and word.startswith("engine."))] + words
        match(words)
        folders = folders or tuple(map(Path, before["conf"]))
        words.append(f"output={quoted(arguments.resume)}")
    try:
        plan = sweep.plan(words, folders)
    except ConfigError as error:
        if before.get("plugins"):
            had = "; ".join(map(str, before["plugins"]))
            raise ConfigError(f"the sweep has {had}: add --plugin FILE; {error}") from error
        raise
    if arguments.cfg:
        print("\n".join(job.name for job in plan.jobs))
        return 0
    check(arguments, LIMITS)
    within = limits(arguments)
    with claim_sweep(plan.output, resume=resume) as claim:
        if (claim.folder / "sweep.json").exists() and not arguments.force:
            sweep.check_same(plan, claim.folder, sweep.recall(claim.folder))
        sweep.remember(plan, claim.folder)
        return _run_sweep(plan, claim.folder, within)


def _run_sweep(plan, folder: Path, limits) -> int:
    """Run the plan under one progress bar, then say what became of it."""
    from rhs.sweeps import running

    from . import say
    from .progress import Progress

    progress = Progress(len(plan))
    try:
        report = running.run_plan(plan, folder, limits, tell=progress.tell)
    except (KeyboardInterrupt, EngineError) as error:
        progress.close()
        if (had := getattr(error, "report", None)) is not None:  # none: the signal came beside the jobs
            print("\n".join(had.lines()))
        print(f"files: {folder}; go on by: python -m rhs --resume {folder}")
        raise
    progress.close()
    if set(+report.counts) == {"refused"}:
        raise ConfigError(f"{report.reasons.most_common(1)[0][0]} (all {len(plan)} jobs; files: {folder})")
    try:
        print(say.of_sweep(folder))
    except Exception as error:  # the account below is printed all the same
        said = str(error) if isinstance(error, RhsError) else f"{type(error).__name__}: {error}"
        print(f"no table: {plain(said)}")
    if report.repeated:
        print(f"{report.repeated} combinations gave a configuration that was there already; each ran once")
    print("\n".join(report.lines()))
    print(f"files: {folder}")
    if not report.complete:
        ended = set(+report.counts) == {"ok"}
        print(f"rhs: {report.failed} of {sum(report.counts.values())} jobs did not "
              + (f"do all that was asked; see python -m rhs table --rows {folder}" if ended else
                 f"end well; see job.log in their folders and {folder}/jobs.json"), file=sys.stderr)
    return 0 if report.complete else 3


def _config_dir(text: str) -> Path:
    path = Path(text).expanduser().absolute()
    if not path.is_dir():
        raise ConfigError(f"--config-dir {text}: there is no such folder")
    return path


def _check_hydra() -> None:
    """`pip --only-binary=:all:` silently picks an ancient Hydra; say so instead of failing later."""
    try:
        from hydra import __version__ as found
    except ImportError:
        raise ConfigError("hydra-core is not installed; type: pip install 'hydra-core>=1.3.8'") from None
    if tuple(int(part) for part in found.split(".")[:2]) < (1, 3):
        raise ConfigError(f"hydra-core {found} is too old; type: pip install 'hydra-core>=1.3.8'")
