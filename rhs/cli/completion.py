"""`python -m rhs completion bash|zsh|fish`: what a shell needs to complete the words of the command `rhs`.

    eval "$(rhs completion bash)"          in ~/.bashrc (zsh: the same with zsh)
    rhs completion fish | source           in config.fish

The shell asks back with the line typed so far (`completion words LINE`) and gets the words that the last one may become.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence

from rhs.api import settings
from rhs.api.contracts import CHOICES
from rhs.base.data_dirs import data_dir
from rhs.base.errors import ConfigError
from rhs.config import registry
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
    """What the last word of a line may become, sorted; the line begins with the command itself."""
    from .commands import COMMANDS

    typed = line.split(" ")
    word, before = typed[-1], [text for text in typed[1:-1] if text]
    if word.startswith("-"):
        found: Iterator[str] = iter(OPTIONS)
    elif "=" in word:
        found = _values(word)
    elif "." in word:
        found = _settings(word, before)
    else:
        found = iter([*_keys(), *(COMMANDS if not before else ())])
    return sorted({text for text in found if text.startswith(word)})


def _keys() -> list[str]:
    """What may stand before `=`; a part's settings are reached by its dot."""
    from rhs.config.compose import Core

    kinds = [text for kind in CHOICES for text in (f"{kind}=", f"{kind}.")]
    settings_of_a_run = [f"{item.name}=" for item in dataclasses.fields(Core) if item.name != "features"]
    return [*kinds, "experiment=", "stack=", *settings_of_a_run]


def _values(word: str) -> Iterator[str]:
    """`key=` with each value it may take; the last one of `key=a,b`."""
    key, _, value = word.partition("=")
    before = value.rpartition(",")
    known = registry.names(key) if key in CHOICES else []
    if key in ("experiment", "stack"):
        known = [path.stem for path in (data_dir("conf") / key).glob("*.yaml")]
    elif key == "world":
        known = [*(path.stem for path in data_dir("worlds").glob("*.yaml")), *(PREFIX + family for family in FAMILIES)]
    for name in known:
        yield f"{key}={before[0]}{before[1]}{name}"


def _settings(word: str, before: Sequence[str]) -> Iterator[str]:
    """`kind.setting=` of the part chosen before, or of every part of that kind."""
    kind = word.partition(".")[0]
    if kind not in CHOICES:
        return
    chosen = [text.partition("=")[2] for text in before if text.startswith(f"{kind}=")] or registry.names(kind)
    for name in chosen:
        if name in registry.names(kind) and registry.failure(kind, name) is None:
            yield from (f"{kind}.{key}=" for key in _flat(settings.defaults(registry.load(kind, name))))


def _flat(values: dict, owner: str = "") -> Iterator[str]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, settings.dotted(owner, key))
        else:
            yield settings.dotted(owner, key)
