"""`python -m rhs completion bash|zsh|fish`: what a shell needs to complete the words of the command `rhs`.

    eval "$(rhs completion bash)"          in ~/.bashrc (zsh: the same with zsh)
    rhs completion fish | source           in config.fish

The shell asks back with the line typed so far (`completion words LINE`) and gets the words that the last one may become.
"""

from __future__ import annotations

import contextlib
import dataclasses
import io
import re
import sys
import typing
from collections.abc import Iterable, Iterator, Sequence

from rhs.api import settings
from rhs.api.contracts import CHOICES, PLUGIN_KINDS
from rhs.api.errors import limits_of
from rhs.base.data_dirs import data_dir
from rhs.base.errors import ConfigError
from rhs.config import registry
from rhs.config.compose import Core
from rhs.worlds.random.names import FAMILIES, PREFIX

# Bash takes `=` and `:` for the end of a word, so it wants only what follows them.
BASH = """_rhs() {
    local word="${COMP_LINE:0:COMP_POINT}"
    mapfile -t COMPREPLY < <(rhs completion words "$word" 2>/dev/null)
    word="${word##* }"
    [[ $word == *=* && $COMP_WORDBREAKS == *=* ]] && COMPREPLY=("${COMPREPLY[@]#"${word%"${word##*=}"}"}")
    word="${word##*=}"
    [[ $word == *:* && $COMP_WORDBREAKS == *:* ]] && COMPREPLY=("${COMPREPLY[@]#"${word%"${word##*:}"}"}")
    [[ ${#COMPREPLY[@]} == 1 && ${COMPREPLY[0]} == *[=.] ]] && compopt -o nospace
}
complete -o default -F _rhs rhs
"""
ZSH = """_rhs() {
    local found=("${(@f)$(rhs completion words "${LBUFFER}" 2>/dev/null)}")
    compadd -S "" -- $found || _files
}
compdef _rhs rhs
"""
FISH = """complete -c rhs -f -a '(rhs completion words (commandline -cp) 2>/dev/null)'
"""
SHELLS = {"bash": BASH, "zsh": ZSH, "fish": FISH}
OPTIONS = ("-m", "--jobs", "--timeout", "--memory-mb", "--retries", "--fail-fast", "--resume", "--force", "--plugin",
           "--config-dir", "--cfg", "--debug", "--version", "--help")
TYPED = (*CHOICES, "engine")  # kinds that are chosen by kind=name
OF_FILES = ("--resume", "--plugin", "--config-dir")  # a file or a folder comes after these


def main(words: Sequence[str]) -> int:
    """The command."""
    if len(words) == 1 and words[0] in SHELLS:
        sys.stdout.write(SHELLS[words[0]])
        return 0
    if len(words) == 2 and words[0] == "words":
        sys.stdout.writelines(f"{word}\n" for word in completions(words[1]))
        return 0
    raise ConfigError(f"completion: say for which shell: {', '.join(SHELLS)}")


def completions(line: str) -> list[str]:
    """What the last word of a line may become, sorted; the line begins with the command itself. Nothing where a file or a
    folder is wanted: the shell knows those."""
    from .commands import COMMANDS, TOPICS

    typed = line.split(" ")
    word, before = typed[-1], [text for text in typed[1:-1] if text]
    key, equals, _ = word.partition("=")
    if word.startswith("-"):
        found: Iterable[str] = options_of(before[0]) if before and before[0] in COMMANDS else OPTIONS
    elif before[:1] == ["help"] or before == ["new"]:
        found = PLUGIN_KINDS if before == ["new"] else TOPICS
    elif before == ["cache"]:
        found = ("clear",)
    elif not word and (before[-1:] and before[-1] in OF_FILES or set(before[:1]) & {*COMMANDS}):
        found = ()
    elif equals:
        found = _values(key, word, before)
    elif "." in word:
        found = (f"{one}=" for one, _ in _leaves(key.partition(".")[0], before))
    else:
        found = [*_heads(before), *(COMMANDS if not before else ())]
    return sorted({text for text in found if text.startswith(word)})


def options_of(name: str) -> list[str]:
    """The options of a command, as its --help tells them."""
    from .commands import command

    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        if (ask := command([name, "--help"])) is not None:
            ask()
    return re.findall(r"(?<![\w-])--[a-z][a-z-]+", said.getvalue())


def _heads(before: Sequence[str]) -> Iterator[str]:
    """What may stand before the first `=` or `.`; the settings of a part or of a group are reached by its dot."""
    for kind in TYPED:
        yield from (f"{kind}=", f"{kind}.")
    yield from ("experiment=", "stack=")
    for key, _ in _leaves("", before):
        yield key.partition(".")[0] + ("." if "." in key else "=")


def _values(key: str, word: str, before: Sequence[str]) -> Iterator[str]:
    """`key=` with each value it may take; the last one of `key=a,b`."""
    if key in TYPED:
        known: Iterable[str] = registry.names(key)
    elif key in ("experiment", "stack"):
        known = [path.stem for path in (data_dir("conf") / key).glob("*.yaml")]
    elif key == "world":
        maps = ["maps"] if "task=planning" in before else []
        files = [path for folder in ("", *maps) for path in (data_dir("worlds") / folder).glob("*.yaml")]
        known = [*(path.stem for path in files), *(PREFIX + family for family in FAMILIES)]
    else:
        known = [value for one, values in _leaves(key.partition(".")[0], before) if one == key for value in values]
    typed = word[: max(word.rfind("="), word.rfind(",")) + 1]
    return (typed + name for name in known)


def _leaves(head: str, before: Sequence[str]) -> Iterator[tuple[str, Sequence[str]]]:
    """Every setting that stands under a head, and the words it may be: of the part chosen before or of every part of that
    kind; for what is no kind those of a run and of its task."""
    kind = head if head in TYPED and head != "task" else "task"
    names = [text.partition("=")[2] for text in before if text.startswith(f"{kind}=")]
    names = names or (["patrol"] if kind == "task" else registry.names(kind))
    if kind == "task":
        yield from _under(Core, "")
    for name in names:
        if name in registry.names(kind) and registry.failure(kind, name) is None:
            yield from _under(registry.load(kind, name), "" if kind == "task" else kind)


def _under(cls: type, owner: str) -> Iterator[tuple[str, Sequence[str]]]:
    """The settings of a class by their dotted names, each with the words it may be, where these can be told."""
    hints, words = typing.get_type_hints(cls), limits_of(cls, "words")
    for item in dataclasses.fields(cls):
        key, hint = settings.dotted(owner, item.name), hints[item.name]
        if dataclasses.is_dataclass(hint):
            yield from _under(hint, key)  # type: ignore[arg-type]
        elif item.init:
            yield key, ("false", "true") if hint is bool else words.get(item.name, ())
